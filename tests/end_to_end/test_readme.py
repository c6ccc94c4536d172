"""The README does what it says: its pages run, its commands exist, its references are listed."""

import json
import re
import runpy
import shlex
from pathlib import Path
from typing import NamedTuple

import click
import pytest

from meal_bayes.cli import main

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
PACKAGE = ROOT / "meal_bayes"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A code block, and the text between the block before it and itself."""

    kind: str
    content: str
    before: str


def blocks(section: str) -> list[Block]:
    """Take the code blocks of one section, in order."""
    text = README.read_text(encoding="utf-8")
    (body,) = re.findall(rf"^## {section}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    found, end = [], 0
    for match in FENCE.finditer(body):
        found.append(Block(match[1], match[2], body[end : match.start()]))
        end = match.end()
    return found


def play(section: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> int:
    """Write the files that a section names, run its Python; a text block tells what it prints."""
    ran = 0
    parts = blocks(section)
    for number, part in enumerate(parts):
        if part.kind in ("toml", "csv"):
            name = re.findall(r"`([\w./]+)`", part.before)[-1]
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(part.content, encoding="utf-8")
        elif part.kind == "python":
            script = folder / f"block_{number}.py"
            script.write_text(part.content, encoding="utf-8")
            runpy.run_path(str(script), run_name="__main__")
            printed = capsys.readouterr().out
            after = parts[number + 1] if number + 1 < len(parts) else None
            if after is not None and after.kind == "text" and not after.before.strip():
                assert printed == after.content
            ran += 1
    return ran


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_python_examples_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert play("Python", folder, capsys) == 3
    assert list((folder / "logs").rglob("*.mcap"))


def test_own_data_and_own_robot_are_answered(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert play("Your own data", folder, capsys) == 1
    assert {path.name for path in folder.rglob("*.csv")} == {
        "labels.csv", "look_color.csv", "lift_force.csv"
    }  # fmt: skip
    assert play("Your own robot", folder, capsys) == 1
    assert (folder / "logs" / "kitchen" / "00000-my_bottle.mcap").is_file()
    assert (folder / "kitchen.mind").is_file()


def test_a_text_block_that_differs_is_seen(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = folder / "wrong.md"
    wrong.write_text("## Page\n```python\nprint(1)\n```\n\n```text\n2\n```\n", encoding="utf-8")
    monkeypatch.setitem(globals(), "README", wrong)
    with pytest.raises(AssertionError):
        play("Page", folder, capsys)


def test_the_two_commands_stand_as_a_newcomer_types_them() -> None:
    shown = [part.content.strip() for part in blocks("Start")]
    assert "pip install . && meal-bayes demo" in shown
    assert "pip install '.[test]' && pytest" in shown


def test_measured_tables_are_those_of_the_kept_rows() -> None:
    maker = runpy.run_path(str(ROOT / "benchmarks" / "readme.py"))
    kept = maker["measured"]()
    assert kept, "no rows are kept: python benchmarks/readme.py --only results"
    text = README.read_text(encoding="utf-8")
    for run in (*maker["RUNS"], maker["PAPER_RUN"]):
        assert (run.command in kept) == (f"**{run.title}**" in text)
        if run.command in kept:
            assert maker["table_of"](run, kept[run.command]) in text
    shown = maker["block"](text, "beliefs").strip()
    assert shown == maker["beliefs_table"](kept[maker["BELIEFS"]])


def test_learning_curves_are_those_reproduced() -> None:
    maker = runpy.run_path(str(ROOT / "benchmarks" / "readme.py"))
    told = json.loads(maker["LEARNING"].read_text(encoding="utf-8"))
    shown = maker["block"](README.read_text(encoding="utf-8"), "online").strip()
    assert shown == maker["online_block"](told).strip()


def test_every_command_shown_exists() -> None:
    text = README.read_text(encoding="utf-8")
    shown = {
        *re.findall(r"`(meal-bayes [^`\n]+)`", text),
        *re.findall(r"^(meal-bayes .+)$", text, re.MULTILINE),
    }
    assert len(shown) > 4
    for line in shown:
        check_command(shlex.split(line)[1:])


def test_a_wrong_command_is_seen() -> None:
    with pytest.raises(AssertionError, match="no command 'fly'"):
        check_command(["fly"])
    with pytest.raises(AssertionError, match="no option '--wings'"):
        check_command(["run", "offline", "--wings", "2"])


def check_command(arguments: list[str]) -> None:
    """Follow the words of a command line through the groups, and look its options up."""
    command: click.Command = main
    while isinstance(command, click.Group):
        word = arguments.pop(0)
        assert word in command.commands, f"no command {word!r}"
        command = command.commands[word]
    known = {name for parameter in command.params for name in parameter.opts}
    for word in arguments:
        assert not word.startswith("--") or word in known, f"no option {word!r}"


def test_every_reference_is_listed() -> None:
    key = re.compile(r"[\[ ]([A-Z][a-z]+(?:19|20)\d\d[a-z]?)(?=[,\]])")
    readme = README.read_text(encoding="utf-8")
    listed = set(re.findall(r"^- \[(\w+)\]", readme, re.MULTILINE))
    sources = "".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    cited = {*key.findall(readme), *key.findall(sources)}
    assert len(listed) > 9
    assert cited - listed == set()


def test_every_path_named_exists() -> None:
    readme = README.read_text(encoding="utf-8")
    # recordings/ is the reader's own folder
    named = re.findall(r"`((?!recordings/)(?:[a-z_]+/)+[\w.*]*)`", readme)
    assert len(named) > 15
    for name in named:
        assert list(ROOT.glob(name.rstrip("/"))) or list(PACKAGE.glob(name.rstrip("/"))), name
