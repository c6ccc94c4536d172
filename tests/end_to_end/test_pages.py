"""README and site do what they say: blocks run, commands exist, tables are those measured."""

import contextlib
import doctest
import io
import re
import runpy
import shlex
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import click
import pytest
from click.testing import CliRunner

import meal_bayes
from meal_bayes.cli import main

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = (README, ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md")))
EXAMPLES = {path.read_text(encoding="utf-8") for path in (ROOT / "examples").glob("*.py")}
_FENCE = re.compile(r'^```(\w*)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"\d+\.\d*")
_SNIPPET = re.compile(r'^--8<-- "(.+)"\n', re.MULTILINE)
PACKAGE = Path(meal_bayes.__file__).parent
MAKER = runpy.run_path(str(ROOT / "benchmarks" / "readme.py"))


class Block(NamedTuple):
    """A code block, and the text between the block before it and itself."""

    language: str
    title: str  # of a file that the reader writes, "" for others
    content: str
    before: str


def blocks(page: Path) -> list[Block]:
    """Return the code blocks of a page, in order, with the files that they include."""
    text = page.read_text(encoding="utf-8")
    results = []
    end = 0
    for match in _FENCE.finditer(text):
        content = _SNIPPET.sub(lambda name: (ROOT / name[1]).read_text("utf-8"), match[3])
        results.append(Block(match[1], match[2] or "", content, text[end : match.start()]))
        end = match.end()
    return results


def runs(block: Block) -> bool:
    """Return whether a block runs on its page; other tests run whole files, and "py" with data."""
    return block.language == "console" or (
        block.language == "python" and block.content not in EXAMPLES
    )


def play(page: Path) -> None:
    """Run the blocks of a page in the working folder, one after another, as a reader would.

    A text block right below is what that prints, "..." in it whatever differs between machines.
    """
    names: dict[str, object] = {"__name__": "__main__"}
    parts = blocks(page)
    for part, after in zip(parts, [*parts[1:], None], strict=True):
        if part.title:
            Path(part.title).parent.mkdir(exist_ok=True)
            Path(part.title).write_text(part.content, encoding="utf-8")
            continue
        if not runs(part):
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            if part.language == "console":
                printed.write("".join(map(run_command, part.content.splitlines())))
            else:
                exec(compile(part.content, str(page), "exec"), names)
        if after is not None and after.language == "text" and not after.before.strip():
            check_output(after.content, printed.getvalue())


def check_output(shown: str, printed: str) -> None:
    """Compare what a page shows with what was printed, but for spaces at the ends of lines.

    Numbers with a point may differ by 2 %, as with another release of a library.
    """
    lines = "".join(f"{line.rstrip()}\n" for line in printed.splitlines())
    words, expected = (_NUMBER.sub("#", text) for text in (lines, shown))
    assert doctest.OutputChecker().check_output(expected, words, doctest.ELLIPSIS), lines
    assert _numbers(lines) == pytest.approx(_numbers(shown), rel=0.02, abs=0.02), lines


def _numbers(text: str) -> list[float]:
    return [float(number) for number in _NUMBER.findall(text)]


def run_command(line: str) -> str:
    """Run a line of a console block, which must end well; return what it prints."""
    prompt, name, *arguments = shlex.split(line)
    assert (prompt, name) == ("$", "meal-bayes"), line
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, f"{line}\n{result.output}"
    return result.stdout


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working folder with what a reader of the repository has beside the pages."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    (tmp_path / "logs").mkdir()
    shutil.copy(ROOT / "logs" / "sample.mcap", tmp_path / "logs")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("MEAL_BAYES_OFFLINE", "1")
    # The last place: packages that robots have, where they are not installed.
    monkeypatch.setattr(sys, "path", [*sys.path, str(ROOT / "tests" / "stand_ins")])
    return tmp_path


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.long] * (page.parent.name in ("how-to", "tutorials")))
        for page in PAGES
        if any(map(runs, blocks(page)))
    ],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_every_block_runs(page: Path, folder: Path) -> None:
    play(page)


def test_blocks_are_of_known_languages() -> None:
    """What a shell block does needs another machine, a screen, or the network; it does not run."""
    for page in PAGES:
        for block in blocks(page):
            assert block.language in {"python", "py", "console", "sh", "text", "toml", "csv"} or (
                page == README and block.content.startswith("pip install")
            ), (page, block.content)


def test_the_readme_shows_two_commands_first() -> None:
    first, second = (block.content.strip() for block in blocks(README)[:2])
    assert (first, second) == (
        "pip install . && meal-bayes demo",
        "pip install '.[test]' && pytest",
    )


def test_the_readme_shows_the_robot_as_it_is() -> None:
    (shown,) = (block.content for block in blocks(README) if block.language == "python")
    assert shown == text_of(ROOT / "examples" / "own_robot.py")
    assert shown in EXAMPLES


def test_measured_blocks_are_those_of_the_kept_rows() -> None:
    for name, entry in MAKER["BLOCKS"].items():
        text = MAKER["block"](text_of(entry.page), name)
        assert text.strip() == MAKER["shown"](name).strip(), name


def test_every_command_shown_exists() -> None:
    shown = set()
    for page in PAGES:
        shown |= {
            *re.findall(r"`(meal-bayes [^`\n]+)`", text_of(page)),
            *re.findall(r"^ *(?:\$ )?(meal-bayes .+)$", text_of(page), re.MULTILINE),
        }
    assert len(shown) > 30
    for line in shown:
        check_command([word for word in shlex.split(line)[1:] if word not in ("...", "LOG")])


def check_command(arguments: list[str]) -> None:
    """Follow the words of a command line through the groups, and look its options up."""
    command: click.Command = main
    while isinstance(command, click.Group) and arguments and arguments[0] != "COMMAND":
        word = arguments.pop(0)
        assert word in command.commands, f"no command {word!r}"
        command = command.commands[word]
    known = {"--help", *(name for parameter in command.params for name in parameter.opts)}
    for word in arguments:
        assert not word.startswith("--") or word in known, f"no option {word!r}"


def test_every_reference_is_listed() -> None:
    key = re.compile(r"[\[ ]([A-Z][a-z]+(?:19|20)\d\d[a-z]?)(?=[,\]])")
    listed = set(re.findall(r"^- \[(\w+)\]", text_of(DOCS / "references.md"), re.MULTILINE))
    sources = [*PAGES, *PACKAGE.rglob("*.py")]
    cited = {name for path in sources for name in key.findall(text_of(path))}
    assert len(listed) > 9
    assert cited - listed == set()


def test_every_path_named_exists() -> None:
    places = (ROOT, PACKAGE)
    count = 0
    for page in PAGES:
        for name in re.findall(r"`((?:[a-z_]+/)+[\w.*]*)`", text_of(page)):
            mine = name.startswith(("recordings/", "logs/", "posterior/"))  # the reader's own
            assert mine or any(list(place.glob(name.rstrip("/"))) for place in places), (page, name)
            count += 1
    assert count > 40


def test_every_link_leads_to_a_file_of_the_repository() -> None:
    """Where they are read as files; `mkdocs build --strict` checks the links of the site."""
    links = [
        (page, name)
        for page in PAGES
        for name in re.findall(r"\]\((?!\w+:|#)([^)#\s]+)", text_of(page))
    ]
    assert len(links) > 80
    assert [link for link in links if not (link[0].parent / link[1]).exists()] == []
