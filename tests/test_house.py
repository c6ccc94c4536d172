"""Rules of the house: sizes of files and functions, verbs of docstrings, the field's words."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "meal_bayes"
LONGEST_FILE, LONGEST_FUNCTION, MOST_PARAMETERS = 350, 60, 8
Function = ast.FunctionDef | ast.AsyncFunctionDef

# First verbs of docstrings of functions.
_VERBS = """
    Add Advance Answer Append Apply Ask Assign Average Blend Bound Build Calibrate Call Cast
    Change Check Choose Clear Clip Close Collect Combine Compare Compile Compute Condition
    Convert Copy Count Create Decide Decode Delete Describe Detect Differentiate Divide Download
    Draw Drop Encode End Enumerate Escape Estimate Evaluate Execute Expand Explain Explore
    Export Extend Extract Fetch Find Fit Flatten Flush Follow Forget Format Freeze Generate Get
    Group Grow Handle Hash Ignore Import Increment Index Infer Initialize Insert Integrate
    Interpolate Invert Iterate Join Keep Label Learn List Load Lock Log Map Marginalize Mark
    Maximize Measure Merge Minimize Modify Move Multiply Name Normalize Open Order Overwrite
    Pack Pad Parse Perceive Permute Pick Pin Plan Plot Pool Predict Prepare Print Project
    Propagate Prune Raise Rank Read Rebuild Record Recover Redirect Reduce Refit Refuse Register
    Reject Remove Rename Render Repeat Replace Replay Report Resample Reset Reshape Resolve
    Restore Resume Return Round Run Sample Save Scale Score Search Select Send Separate Serve
    Set Show Shuffle Simulate Solve Sort Split Start Stop Store Subtract Sum Summarize Switch
    Sync Tabulate Test Train Transform Translate Trim Try Turn Unpack Update Use Validate Verify
    Visit Wait Warn Weight Wrap Write Yield
"""
VERBS = frozenset(_VERBS.split())

# Words of ours alone, as they stand in identifiers; docs/concepts use the field's.
_PRIVATE = """
    affinity asking believable curiosity gave heard kinds luck macros marks moment moments recipe
    recipes screen story surroundings tells telling told walked world
"""
PRIVATE = frozenset(_PRIVATE.split())

# What users call with settings by name.
MANY_PARAMETERS = frozenset(
    {"gym/environment.py:__init__", "learner/api.py:ask", "learner/learner.py:__init__"}
)


def files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def functions(path: Path) -> Iterator[Function]:
    return (node for node in ast.walk(tree_of(path)) if isinstance(node, Function))


def is_property(function: Function) -> bool:
    return any("property" in ast.unparse(one) for one in function.decorator_list)


def parameters(function: Function) -> list[str]:
    """Return the names of the parameters, without `self` and `cls`."""
    arguments = function.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    return [one.arg for one in every if one.arg not in ("self", "cls")]


def long_functions(path: Path) -> list[str]:
    return [
        f"{name_of(path)}:{one.lineno} {one.name} has {one.end_lineno - one.lineno + 1} lines"
        for one in functions(path)
        if one.end_lineno - one.lineno >= LONGEST_FUNCTION
    ]


def wide_functions(path: Path) -> list[str]:
    return [
        f"{name_of(path)}:{one.lineno} {one.name} has {len(parameters(one))} parameters"
        for one in functions(path)
        if len(parameters(one)) > MOST_PARAMETERS
        and f"{name_of(path)}:{one.name}" not in MANY_PARAMETERS
    ]


def odd_verbs(path: Path) -> list[str]:
    return [
        f"{name_of(path)}:{one.lineno} {one.name}: {doc.splitlines()[0]}"
        for one in functions(path)
        if (doc := ast.get_docstring(one)) and not is_property(one)
        if doc.split()[0].rstrip(",.:;") not in VERBS
    ]


def identifiers(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and name of what a file defines, and the file's own name."""
    yield 0, path.stem
    for node in ast.walk(tree_of(path)):
        if isinstance(node, Function | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def private_words(path: Path) -> list[str]:
    return sorted(
        {
            f"{name_of(path)}:{line} {name}"
            for line, name in identifiers(path)
            if PRIVATE & set(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().split("_"))
        }
    )


RULES = {
    "functions": long_functions,
    "parameters": wide_functions,
    "verbs": odd_verbs,
    "words": private_words,
}


def test_no_file_is_longer_than_the_limit():
    lines = {name_of(path): len(path.read_text("utf-8").splitlines()) for path in files()}
    assert {name: count for name, count in lines.items() if count > LONGEST_FILE} == {}


@pytest.mark.parametrize("rule", RULES)
def test_every_file_keeps_the_rule(rule):
    assert [found for path in files() for found in RULES[rule](path)] == []


@pytest.mark.parametrize(
    ("rule", "code"),
    [
        ("functions", "def f():\n" + "    x = 1\n" * LONGEST_FUNCTION),
        ("parameters", "def f(self, a, b, c, d, e, f, g, h, i): ..."),
        ("verbs", 'def f():\n    """Give the sum."""'),
        ("words", "def f(n_kinds): ..."),
        ("words", "class LuckDraw: ..."),
        ("words", "x.told = 1"),
    ],
)
def test_a_break_of_a_rule_is_found(rule, code, monkeypatch):
    path = PACKAGE / "broken.py"
    monkeypatch.setitem(globals(), "tree_of", lambda _: ast.parse(code))
    assert len(RULES[rule](path)) == 1
