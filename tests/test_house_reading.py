"""What CONTRIBUTING says of how a line reads, held by every file."""

import ast
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("meal_bayes", "paper_repro", "benchmarks", "examples")
MOST_BY_PLACE = 5  # arguments of a call that names none
# Kernels take arrays by place, as numba compiles a signature each; columns of a bar have no names.
MANY_BY_PLACE = {
    "meal_bayes/cli/console.py",
    "meal_bayes/planners/jit.py",
    "meal_bayes/planners/open_loop/values.py",
    "meal_bayes/planners/open_loop/yes_or_no.py",
}


def sources(*folders: str) -> Iterator[tuple[str, str]]:
    """Yield the path and the text of each Python file."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def paired_assignments(text: str) -> list[int]:
    """Return the lines of `a, b = x, y`, but for those that swap or read what they assign."""
    lines = []
    for node in ast.walk(ast.parse(text)):
        if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple)):
            continue
        for target in node.targets:
            if isinstance(target, ast.Tuple):
                assigned = {ast.unparse(name) for name in target.elts}
                read = {
                    ast.unparse(name)
                    for name in ast.walk(node.value)
                    if isinstance(name, ast.Name | ast.Attribute | ast.Subscript)
                }
                if not assigned & read:
                    lines.append(node.lineno)
    return lines


def multiplied_texts(text: str) -> list[int]:
    """Return the lines that multiply a text by what is neither a number nor a length."""
    lines = []
    for node in ast.walk(ast.parse(text)):
        if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult)):
            continue
        for side, times in ((node.left, node.right), (node.right, node.left)):
            is_text = isinstance(side, ast.JoinedStr) or (
                isinstance(side, ast.Constant) and isinstance(side.value, str)
            )
            is_number = isinstance(times, ast.Constant | ast.BinOp) or (
                isinstance(times, ast.Call) and ast.unparse(times.func) in {"len", "int"}
            )
            if is_text and not is_number:
                lines.append(node.lineno)
    return lines


def skipped_prose(text: str) -> list[int]:
    """Return the lines behind which formatting is skipped though no table ends there."""
    ends = {
        node.end_lineno
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.List | ast.Tuple | ast.Dict | ast.Set)
        and node.end_lineno > node.lineno
    }
    lines = enumerate(text.splitlines(), 1)
    skips = [number for number, line in lines if line.rstrip().endswith("# fmt: " + "skip")]
    return [number for number in skips if not {number, number - 1} & ends]


def crowded_calls(text: str) -> list[int]:
    """Return the lines of calls with more arguments by place than a reader counts."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call)
        and sum(not isinstance(argument, ast.Starred) for argument in node.args) > MOST_BY_PLACE
    ]


def lines_of(rule: Callable[[str], list[int]], *folders: str) -> set[str]:
    """Return path and line of what breaks a rule."""
    return {f"{path}:{line}" for path, text in sources(*folders) for line in rule(text)}


@pytest.mark.parametrize(
    ("rule", "folders"),
    [
        (paired_assignments, (*FOLDERS, "tests")),
        (multiplied_texts, FOLDERS),
        (skipped_prose, FOLDERS),
    ],
)
def test_one_thing_a_line(rule: Callable[[str], list[int]], folders: tuple[str, ...]) -> None:
    assert lines_of(rule, *folders) == set()


def test_arguments_beyond_five_have_names() -> None:
    crowded = lines_of(crowded_calls, *FOLDERS)
    assert {place for place in crowded if place.partition(":")[0] not in MANY_BY_PLACE} == set()
    assert {place.partition(":")[0] for place in crowded} == MANY_BY_PLACE


@pytest.mark.parametrize(
    ("rule", "broken", "held"),
    [
        (paired_assignments, "a, b = 1, x", "a, b = b, a"),
        (paired_assignments, "a, b = 1, x", "a, b = f(x)"),
        (multiplied_texts, "t = 'x' * done", "t = 'x' * len(n)"),
        (multiplied_texts, "t = (n > 1) * f'{n}s'", "t = '-' * 3"),
        (skipped_prose, "f(\n  a,\n)  # fmt: " + "skip", "x = [\n  1,\n]  # fmt: " + "skip"),
        (crowded_calls, "f(1, 2, 3, 4, 5, 6)", "f(1, 2, 3, 4, 5, z=6)"),
    ],
)
def test_what_breaks_a_rule_is_seen(
    rule: Callable[[str], list[int]], broken: str, held: str
) -> None:
    assert rule(broken)
    assert rule(held) == []
