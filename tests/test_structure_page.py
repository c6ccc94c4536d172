"""The page that says where things are: each file is there, and has the names beside it."""

import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "concepts" / "structure.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    """Return the text below a heading, up to the next one."""
    return re.split(r"^## ", PAGE.split(f"## {title}\n")[1], flags=re.MULTILINE)[0]


def rows(title: str) -> list[list[str]]:
    """Return the cells of the rows of a section's tables, without their heads."""
    lines = section(title).splitlines()
    tables = [i for i, line in enumerate(lines) if line.startswith("|---")]
    heads = {i - 1 for i in tables}
    return [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for i, line in enumerate(lines)
        if line.startswith("| ") and i not in heads
    ]


def paths(cell: str) -> list[str]:
    """Return the paths in a cell; one without a folder lies beside the one before."""
    found = []
    for path in re.findall(r"`([\w/*]+(?:\.\w+|/))`", cell):
        folder = found[-1].rpartition("/")[0] if found and "/" not in path else ""
        found.append(f"{folder}/{path}".lstrip("/"))
    return found


def files(path: str) -> list[Path]:
    """Return the files that a path means, of the package or of the repository."""
    pattern = f"{path}**/*.*" if path.endswith("/") else path
    return [*(ROOT / "meal_bayes").glob(pattern), *ROOT.glob(pattern)]


def defines(text: str, name: str) -> bool:
    """Return whether a file defines a function, class, variable, field or key."""
    pattern = rf"^\s*(?:(?:def|class) {name}\b|{name} ?[:=])|[{{ ]{name} ="
    return re.search(pattern, text, re.MULTILINE) is not None


def steps(title: str) -> Iterator[tuple[str, str]]:
    """Yield the last part of each name of a picture, and the path beside it."""
    for line in section(title).splitlines():
        if found := re.match(r"[ |]+([\w.]+)\S*(?: \S+)*? {2,}([\w/]+\.py)\b", line):
            yield found[1].rpartition(".")[2], found[2]


CHANGES = rows("Where to change what")
LIVES = [*steps("The life of a percept"), *steps("The life of a decision")]


def test_the_page_is_read() -> None:
    assert len(CHANGES) > 90
    assert len(LIVES) > 20
    assert all(len(row) == 3 for row in CHANGES)


@pytest.mark.parametrize("row", CHANGES, ids=lambda row: row[0][:40])
def test_what_is_to_change_is_where_the_table_says(row: list[str]) -> None:
    _, places, names = row
    assert paths(places)
    assert all(files(path) for path in paths(places))
    texts = [
        file.read_text(encoding="utf-8")
        for path in paths(places)
        for file in files(path)
        if file.suffix in (".py", ".toml", ".html")
    ]
    missing = [
        name
        for name in re.findall(r"`(\w+)`", names)
        if not any(defines(text, name) for text in texts)
    ]
    assert missing == []


@pytest.mark.parametrize(("name", "path"), LIVES)
def test_each_step_of_a_life_is_in_the_file_beside_it(name: str, path: str) -> None:
    assert defines((ROOT / "meal_bayes" / path).read_text(encoding="utf-8"), name)


def test_files_of_the_reading_path_and_those_that_look_alike_are_there() -> None:
    cells = (row[0] for row in rows("Files that look alike"))
    named = list(chain.from_iterable(map(paths, (section("A reading path of an hour"), *cells))))
    assert len(named) > 30
    assert [path for path in named if not files(path)] == []
