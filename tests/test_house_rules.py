"""What CONTRIBUTING says of sizes, lines, imports, skips and the CI, held by every file."""

import ast
import re
import shlex
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("meal_bayes", "paper_repro", "benchmarks", "examples")
FILE_LINES = 350
FUNCTION_LINES = 60
MOST_BY_PLACE = 5  # arguments of a call that names none
# Kernels take arrays by place, as numba compiles a signature each; columns of a bar have no names.
MANY_BY_PLACE = {
    "meal_bayes/cli/console.py",
    "meal_bayes/planners/jit.py",
    "meal_bayes/planners/open_loop/values.py",
    "meal_bayes/planners/open_loop/yes_or_no.py",
}


def sources(*folders: str) -> Iterator[tuple[str, str]]:
    """Yield the path and the text of each Python file, by its path as a whole."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def long_functions(text: str) -> list[tuple[str, int]]:
    """Return the functions that are too long, with their lines, docstrings left out."""
    results = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0]
            documented = ast.get_docstring(node, clean=False) is not None
            lines = node.end_lineno - node.lineno + 1
            lines -= (first.end_lineno - first.lineno + 1) * documented
            if lines > FUNCTION_LINES:
                results.append((node.name, lines))
    return results


def test_no_file_is_longer_than_350_lines() -> None:
    folders = (*FOLDERS, "tests")
    lines = {path: len(text.splitlines()) for path, text in sources(*folders)}
    assert len(lines) == sum(1 for folder in folders for _ in (ROOT / folder).rglob("*.py"))
    assert len(lines) > 400
    assert {path: count for path, count in lines.items() if count > FILE_LINES} == {}


def test_no_function_is_longer_than_60_lines() -> None:
    found = {path: long_functions(text) for path, text in sources(*FOLDERS)}
    assert {path: functions for path, functions in found.items() if functions} == {}


@pytest.mark.parametrize(("statements", "too_long"), [(59, False), (60, True)])
def test_a_long_function_is_seen(statements: int, too_long: bool) -> None:
    body = '    """Do.\n\n    It does.\n    """\n' + "    x = 1\n" * statements
    within = "class A:\n" + "".join(f"    {line}\n" for line in f"def f():\n{body}".splitlines())
    assert bool(long_functions(f"def f():\n{body}")) is too_long
    assert bool(long_functions(within)) is too_long


def imports(path: str, text: str) -> set[str]:
    """Return the modules of the package that a file imports, also for type checkers alone."""
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {str(node.module)} | {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.removeprefix("meal_bayes.") for name in names}


def circles(graph: dict[str, set[str]]) -> set[tuple[str, ...]]:
    """Return the groups of modules of one room each of which imports, in steps, each other."""
    reached = {module: {module} for module in graph}
    for _ in graph:
        for module, targets in graph.items():
            room = module.partition(".")[0]
            for target in targets & graph.keys():
                if target.partition(".")[0] == room:
                    reached[module] |= reached[target]
    groups = {
        tuple(sorted(other for other in reached[module] if module in reached[other]))
        for module in graph
    }
    return {group for group in groups if len(group) > 1}


def test_no_files_of_a_room_import_each_other() -> None:
    """Import contracts see rooms; this sees the files of each, and what only type checkers import.

    A package's own `__init__` collects names of its modules, and is left out.
    """
    graph = {}
    for path, text in sources("meal_bayes"):
        module = path.removeprefix("meal_bayes/").removesuffix(".py").replace("/", ".")
        if not module.endswith("__init__"):
            graph[module] = imports(path, text)
    assert circles(graph) == set()


def test_a_circle_is_seen() -> None:
    chain = {"a.x": {"a.y"}, "a.y": {"a.z", "b.x"}, "a.z": set(), "b.x": {"a.x"}}
    assert circles(chain) == set()  # one over two rooms is what the contracts see
    assert circles(chain | {"a.z": {"a.x"}}) == {("a.x", "a.y", "a.z")}


def test_tests_skip_by_one_door() -> None:
    """`missing` in tests/conftest.py, which fails where what is missing is required."""
    past = {
        path: found
        for path, text in sources("tests")
        if (found := re.findall(r"\b(?:importorskip|skipif|(?:pytest|unittest)\.skip\w*)\b", text))
    }
    assert past.pop("tests/conftest.py") == ["pytest.skip"]
    past.pop("tests/test_house_rules.py")
    assert past == {}


def test_variables_that_require_something_are_set_somewhere() -> None:
    """One that is read and never set requires nothing, and one that nobody reads neither."""
    name = re.compile(r"MEAL_BAYES_REQUIRE_[A-Z]+")
    read = set(name.findall((ROOT / "tests" / "conftest.py").read_text(encoding="utf-8")))
    frame = (ROOT / ".ci" / "run", *(ROOT / ".github" / "workflows").glob("*.yml"))
    made = re.compile(rf"({name.pattern})(?:=|: *\"?)1")
    assert {found for path in frame for found in made.findall(path.read_text("utf-8"))} == read


def test_the_site_is_checked_the_same_on_a_laptop_and_where_it_is_published() -> None:
    """Quiet, MkDocs counts no warnings, and `--strict` has nothing to fail for."""
    workflow = (ROOT / ".github" / "workflows" / "docs.yml").read_text(encoding="utf-8")
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for text in (workflow, script):
        (command,) = re.findall(r"mkdocs build.*", text)
        assert {"--strict"} <= set(shlex.split(command.replace('"$work/site"', "site")))
        assert not re.search(r"--quiet|-q\b", command)


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_dependency_groups_are_the_extras_of_the_same_names() -> None:
    """Installers read the one or the other."""
    extras = PROJECT["project"]["optional-dependencies"]
    groups = PROJECT["dependency-groups"]
    included = [{"include-group": "test"}, {"include-group": "docs"}]
    assert groups == {
        "test": extras["test"],
        "docs": extras["docs"],
        "dev": included + extras["dev"],
    }


def test_what_the_ci_installs_is_pinned() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").lower().replace("_", "-")
    pinned = set(re.findall(r"^([a-z0-9.-]+)==", lines, re.MULTILINE))
    extras = PROJECT["project"]["optional-dependencies"]
    needed = [*extras["test"], *extras["docs"], *extras["dev"]]
    names = {re.split(r"[<>=\[]", requirement)[0].lower() for requirement in needed}
    assert names - pinned == set()


def test_hooks_run_the_formatter_that_the_ci_runs() -> None:
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    (version,) = re.findall(r"ruff-pre-commit\n +rev: v(.+)", hooks)
    assert f"\nruff=={version}\n" in (ROOT / "constraints.txt").read_text(encoding="utf-8")


def test_workflows_run_what_pages_and_the_ci_run() -> None:
    """No step of theirs is a command of its own, which a laptop would never try."""
    folder = ROOT / ".github" / "workflows"
    text = "\n".join(path.read_text("utf-8") for path in sorted(folder.glob("*.yml")))
    commands = set(re.findall(r"^ +(?:- )?run: (?!\|)(.+)$", text, re.MULTILINE))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert commands == {
        "pip install '.[docs]'",
        "mkdocs build --strict",
        "pip install '.[test]'",
        "meal-bayes demo",
        'pytest -m "not statistical and not real_data"',
        'npm install --prefix "$RUNNER_TEMP/npm" @mcap/core@2.2.2 fzstd@0.1.1',
        "sudo apt-get install --yes --no-install-recommends mesa-vulkan-drivers",
        'MEAL_BAYES_DATA_URL="$HOME/recordings" .ci/run '
        "python${{ matrix.python }} ${{ matrix.versions }}",
    }
    assert "pip install '.[test]' && pytest" in readme
    assert "mkdocs build --strict" in script
    words = set(re.findall(r"versions: (\w+)", text))
    assert words == {"pinned", "newest"}
    assert all(f"{word})" in script for word in words)


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
