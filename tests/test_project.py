"""What holds the project together: imports without circles, one door for skips, pinned versions."""

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def sources(*folders: str) -> Iterator[tuple[str, str]]:
    """Yield the path and the text of each Python file, by its path as a whole."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


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
    past.pop("tests/test_project.py")
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
    project = PROJECT["project"]
    extras = project["optional-dependencies"]
    needed = [*project["dependencies"], *extras["test"], *extras["docs"], *extras["dev"]]
    names = {re.split(r"[<>=\[; ]", requirement)[0].lower() for requirement in needed}
    assert names - pinned == set()
    both = re.findall(r"^(?:h5py|h5netcdf)==.*", lines, re.MULTILINE)
    assert len(both) == 2
    assert not any(";" in line for line in both)  # for every Python


def test_hooks_run_the_formatter_that_the_ci_runs() -> None:
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    (version,) = re.findall(r"ruff-pre-commit\n +rev: v(.+)", hooks)
    assert f"\nruff=={version}\n" in (ROOT / "constraints.txt").read_text(encoding="utf-8")
