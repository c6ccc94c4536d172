"""The commands that pages show start where the package is installed from its wheel, as documented.

An editable install would not do: it puts the checkout itself on the path, and hides what a wheel
lacks.
"""

import json
import os
import re
import shlex
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *(ROOT / name / "README.md" for name in ("benchmarks", "paper_repro", "logs")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Programs of others: the CI runs what is said of them, or no test can (a network, a scheduler).
OTHERS = {"pip", "git", "pytest", "cd", "dask", "rerun", "zip", ".ci/run"}
ELSEWHERE = {"examples/policy_gradient.py"}  # it has no --help; tests/examples runs it


def shown() -> list[list[str]]:
    """Return the command lines of the pages, as words."""
    lines = []
    for language, block in re.findall(FENCE, TEXT):
        if language in ("sh", "console", ""):
            whole = block.replace("\\\n", " ")
            lines += [line.strip().removeprefix("$ ") for line in whole.splitlines()]
    lines += re.findall(r"`((?:python\d?|meal-bayes) [^`\n]+)`", TEXT)
    page = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    for script, sentence in re.findall(r"^\| `(\w+\.py)` \| (.+) \|$", page, re.MULTILINE):
        options = re.findall(r"`(--[a-z-]+)", sentence)
        lines.append(" ".join([f"python benchmarks/{script}", *options]))
    commands = []
    for line in lines:
        for part in re.split(r" && | \| | > ", line.partition("#")[0]):
            words = [word for word in shlex.split(part) if not re.match(r"[A-Z_]+=", word)]
            if words:
                commands.append(words)
    return commands


COMMANDS = shown()
SCRIPTS = sorted({words[1] for words in COMMANDS if words[0].startswith("python")})
WHERE = """
import importlib.util, meal_bayes
print(meal_bayes.__file__, importlib.util.find_spec("paper_repro"))
"""
HELP = """
import contextlib, io, json, pathlib, runpy, sys, traceback

said = {}
for script in sys.argv[1:]:
    out = io.StringIO()
    sys.argv = [script, "--help"]
    sys.path[0] = str(pathlib.Path(script).parent)
    try:
        with contextlib.redirect_stdout(out):
            runpy.run_path(script, run_name="__main__")
        code = 0
    except SystemExit as end:
        code = end.code or 0
    except Exception:
        code = traceback.format_exc()
    said[script] = code, out.getvalue()
print(json.dumps(said))
"""
GROUPS = {"run", "log", "data"}
OURS = sorted(
    {
        " ".join(words[1:3] if words[1] in GROUPS else words[1:2])
        for words in COMMANDS
        if words[0] == "meal-bayes" and words[1:2] not in ([], ["COMMAND"])
    }
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a function that runs Python in the checkout, where the wheel is installed."""
    folder = tmp_path_factory.mktemp("installed")
    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(folder / "dist"))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    (folder / "meal-bayes").write_text("from meal_bayes.cli import main\nmain()\n")  # as pip does
    (folder / "where").write_text(WHERE)
    (folder / "help").write_text(HELP)
    libraries = [path for path in sys.path if path and not Path(path).is_relative_to(ROOT)]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(folder / "site"), *libraries]),
        "MEAL_BAYES_DATA_DIR": str(folder / "cache"),
        "MEAL_BAYES_OFFLINE": "1",
    }

    def start(script, *words):
        # -S: an editable install would put the checkout on the path.
        script = ROOT / script if "/" in script else folder / script
        return subprocess.run(
            [sys.executable, "-S", str(script), *words],
            cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip

    return start


def test_every_command_is_of_a_program_that_is_known():
    assert {words[0] for words in COMMANDS} == {"python", "meal-bayes"} | OTHERS
    assert len(SCRIPTS) > 15
    assert len(OURS) > 15


def test_every_benchmark_stands_in_the_table():
    scripts = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "benchmarks").glob("*.py")
        if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
    }
    assert scripts - set(SCRIPTS) == set()


@pytest.fixture(scope="module")
def helped(run):
    """Return the exit code and the text of each script's --help, of one process."""
    done = run("help", *(script for script in SCRIPTS if script not in ELSEWHERE))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.long
@pytest.mark.parametrize("script", sorted({*SCRIPTS} - ELSEWHERE))
def test_a_script_starts_and_has_the_options_that_are_shown(helped, script):
    code, text = helped[script]
    assert code == 0, code
    for words in COMMANDS:
        if words[1:2] == [script]:
            for word in words[2:]:
                assert not word.startswith("--") or word in text, word


@pytest.mark.long
@pytest.mark.parametrize("words", OURS)
def test_a_command_starts(run, words):
    done = run("meal-bayes", *words.split(), "--help")
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_the_paper_is_reproduced_from_the_checkout(run, tmp_path):
    """The package is installed; the items lie in the checkout."""
    done = run("meal-bayes", "reproduce", "eq7", "--quick", "--logs", str(tmp_path))
    assert done.returncode == 0, done.stderr


def test_it_is_the_wheel_that_runs(run):
    package, paper = run("where").stdout.split()
    assert not Path(package).is_relative_to(ROOT)
    assert paper == "None"
