"""Which blocks of measured numbers are old: those that other code or data made."""

import dataclasses
import json
import sys
from pathlib import Path

import pytest

from meal_bayes.trial_log import read_outcomes
from meal_bayes.trials import TrialOutcomes

ROOT = Path(__file__).resolve().parents[2]
CODE = '''"""A module."""
def halved(x):
    """Return the half."""  # it is
    if x < 0:
        raise ValueError(f"{x} is below 0")
    return x / 2
'''
TABLE = "[costs]\nlook = 0.5\n"


@pytest.fixture
def readme(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    sys.modules.pop("readme", None)
    import readme  # noqa: PLC0415  a script that imports its siblings

    return readme


@pytest.fixture
def made(readme, tmp_path):
    """Return what computes the digest of a project of two files, with some of them replaced."""

    def of(command="meal-bayes run", **files):
        root = tmp_path / str(len(list(tmp_path.iterdir())))
        contents = {
            "posterior/grid.py": CODE,
            "domain/toy.toml": TABLE,
            "cli/run.py": CODE,
            **files,
        }
        for name, text in contents.items():
            path = root / "meal_bayes" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return readme.made_by(command, root)

    return of


def test_a_changed_function_setting_or_table_is_seen(made):
    first = made()
    assert len(first) == 12
    for files in (
        {"posterior/grid.py": CODE.replace("x / 2", "x / 3")},
        {"posterior/grid.py": CODE.replace("x < 0", "x <= 0")},
        {"domain/toy.toml": TABLE.replace("0.5", "0.6")},
        {"posterior/new.py": "x = 1"},
    ):
        assert made(**files) != first
    assert made("meal-bayes run --seed 1") != first


def test_a_changed_comment_docstring_message_or_page_is_not(made):
    first = made()
    for files in (
        {"posterior/grid.py": CODE.replace("# it is", "# of x")},
        {"posterior/grid.py": CODE.replace("Return the half", "Halve")},
        {"posterior/grid.py": CODE.replace("is below 0", "is negative")},
        {"posterior/grid.py": CODE.replace("x / 2", "(x /\n        2)")},
        {"domain/toy.toml": "# costs, s\n" + TABLE},
        {"cli/run.py": "x = 1"},
    ):
        assert made(**files) == first


def test_a_function_that_moves_to_another_file_makes_no_table_old(made):
    second = "def doubled(x):\n    return 2 * x\n"
    first = made(**{"posterior/grid.py": CODE + second})
    moved = {"posterior/grid.py": CODE, "posterior/double.py": f"import math\n\n\n{second}"}
    assert made(**moved) == first


def test_what_a_script_imports_from_its_folder_counts(readme, tmp_path):
    def digest(number, **changed):
        root = tmp_path / str(number)
        scripts = {"run": "from models import x", "models": "import tools", "tools": ""}
        for name, text in {**scripts, "other": "", **changed}.items():
            path = root / "benchmarks" / f"{name}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{text}\ny = 1\n", encoding="utf-8")
        (root / "meal_bayes").mkdir()
        return readme.made_by("python benchmarks/run.py", root)

    first = digest(0)
    assert digest(1, other="x = 2") == first
    for number, name in enumerate(("run", "models", "tools"), 2):
        assert digest(number, **{name: "from models import x\nimport tools\nx = 2"}) != first


def test_results_are_carried_over_if_only_the_package_changed(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import digests  # noqa: PLC0415  a script that imports its siblings

    scripts = {
        "before": "runs = 1",
        "other package": "runs = 1",
        "other constant": "runs = 2",
        "other function": "runs = 1\ndef run():\n    return runs\n",
    }
    roots = [tmp_path / name for name in scripts]
    for root, number, script in zip(roots, (2, 3, 3, 3), scripts.values(), strict=True):
        for name, text in {
            "meal_bayes/grid.py": CODE.replace("x / 2", f"x / {number}"),
            "benchmarks/run.py": script,
        }.items():
            path = root / name
            path.parent.mkdir(parents=True)
            path.write_text(text, encoding="utf-8")
    words = "python benchmarks/run.py"
    before, package, script, function = (digests.made_by(words, root) for root in roots)
    made = {"code": before}
    for tried in (False, True):
        assert not digests.carry_over(made, words, roots[0], roots[2], tried=tried)
    # A function beside the package may differ if its results were tried, and are equal.
    assert not digests.carry_over(made, words, roots[0], roots[3])
    assert digests.carry_over({"code": before}, words, roots[0], roots[3], tried=True)
    assert function not in (before, package)
    assert not digests.carry_over({"code": script}, words, roots[0], roots[1])
    assert made == {"code": before}
    assert digests.carry_over(made, words, roots[0], roots[1])
    assert made == {"code": package, "same_as": [before]}
    assert not digests.carry_over(made, words, roots[0], roots[1])


@pytest.mark.parametrize(
    ("again", "carried"), [([], []), (["a"], ["b"])], ids=["none named", "one to be made again"]
)
def test_if_logs_differ_the_results_of_such_runs_are_named(again, carried, monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import digests  # noqa: PLC0415  a script that imports its siblings

    kept = tmp_path / "benchmarks" / "readme.json"
    kept.parent.mkdir()
    kept.write_text('{"a": {"command": "run"}, "b": {"command": "run"}}')
    (tmp_path / "provenance.json").write_text("{}")
    logs = {str(tmp_path): "of before", str(digests.ROOT): "of now"}
    monkeypatch.setattr(digests, "digests", lambda root, *of: {"/".join(of): logs[str(root)]})
    monkeypatch.setattr(digests, "made_by", lambda words, root: str(root))
    monkeypatch.setattr(digests, "beside_package", lambda words, root: str(root))
    monkeypatch.setattr(digests, "quick_results", lambda root, file: {"b": "equal"})
    monkeypatch.setattr(digests, "carry_over", lambda made, *_, **how: made.update(how) or True)
    files = [str(tmp_path / f"{name}.json") for name in ("now", "before")]
    words = ["digests.py", *files, "--carry-over", str(tmp_path)]
    monkeypatch.setattr("sys.argv", [*words, *(["--again", *again] if again else [])])
    monkeypatch.setattr(digests, "KEPT", (kept, tmp_path / "provenance.json"))
    assert digests.main() == 1
    assert [name for name, made in json.loads(kept.read_text()).items() if "tried" in made] == (
        carried
    )
    # Logs of a code that is in a file are not made again.
    monkeypatch.setattr(digests, "digests", None)
    assert digests.main() == 1
    # Nor are they if the package is the same.
    monkeypatch.setattr(digests, "made_by", lambda words, root: "same")
    monkeypatch.setattr(digests, "all_digests", None)
    assert digests.main() == 0
    # Items of the paper are run only if what they share has changed, and are then carried over.
    assert json.loads(kept.read_text())["b"]["tried"]
    monkeypatch.setattr(digests, "beside_package", lambda words, root: "same")
    monkeypatch.setattr(digests, "quick_results", None)
    assert digests.main() == 0


@pytest.fixture
def fresh(readme, monkeypatch):
    """Let all rows be of this code; return what says that other code made some of them."""
    monkeypatch.setattr(readme, "check_demo", lambda: 0)
    codes = {
        readme.MEASUREMENTS[name].command: kept["code"] for name, kept in readme.kept().items()
    }
    rows = readme.kept()
    for name, kept in rows.items():
        kept["command"] = readme.MEASUREMENTS[name].command
    for name in set(readme.MEASUREMENTS) - set(rows):  # which was not measured yet
        command = readme.MEASUREMENTS[name].command
        rows[name] = {"command": command, "code": "none yet"}
        codes[command] = "none yet"
    monkeypatch.setattr(readme, "kept", lambda: rows)
    monkeypatch.setattr(readme, "shown", lambda name: text_of(readme, name))
    monkeypatch.setattr(readme, "made_by", codes.__getitem__)

    def old(name):
        codes[readme.MEASUREMENTS[name].command] = "changed"

    return old


def text_of(readme, name):
    return readme.block(readme.BLOCKS[name].page.read_text(encoding="utf-8"), name)


def test_a_block_that_other_code_made_fails_a_release_and_is_named(readme, fresh, capsys):
    assert readme.check(release=True) == 0
    fresh(readme.BELIEFS)
    capsys.readouterr()
    assert readme.check(release=False) == 0
    assert readme.check(release=True) == 1
    (listed, _) = capsys.readouterr().out.splitlines()
    assert listed.startswith("docs/results/beliefs.md: other code made beliefs")
    assert "python benchmarks/readme.py --only beliefs" in listed
    # What one command makes: what is old alone, or what is named, or everything.
    assert readme.measurements_of(readme.MEASUREMENTS, again=False) == [readme.BELIEFS]
    assert readme.measurements_of(["answers"], again=True) == [readme.ANSWERS]
    assert readme.measurements_of(["summary"], again=True) == list(readme.RUNS)


def test_a_block_names_the_code_that_ran_if_its_rows_were_carried_over(readme, monkeypatch):
    rows = readme.kept()
    rows["online"] |= {"code": "now", "same_as": ["ran", "between"]}
    monkeypatch.setattr(readme, "kept", lambda: rows)
    assert readme.shown("online").endswith("Made by code `ran`.")


def test_a_block_that_is_not_what_was_measured_fails_every_check(readme, monkeypatch, capsys):
    monkeypatch.setattr(readme, "check_demo", lambda: 0)
    monkeypatch.setattr(readme, "is_old", lambda _: False)
    entries = readme.kept()
    entries[readme.BELIEFS]["rows"][0]["nll"] += 1
    monkeypatch.setattr(readme, "kept", lambda: entries)
    assert readme.check(release=False) == 1
    assert "block beliefs" in capsys.readouterr().out


def test_rows_have_paired_intervals_and_declining_among_the_others(readme):
    outcomes = read_outcomes(ROOT / "logs" / "sample.mcap")
    first = outcomes.of_agent("bayes")
    second = dataclasses.replace(first, agent=first.agent * 0 + "morc", reward=first.reward - 5.0)
    rows = [{"agent": "morc", "reward": 1.0}, {"agent": "bayes", "reward": 6.0}]
    declining, morc, ours = readme.with_paired(rows, TrialOutcomes.join([first, second]))
    assert declining["agent"] == readme.DECLINING
    assert declining["ours_more"] == pytest.approx(first.reward.mean())
    assert morc["ours_more"] == pytest.approx(5.0)
    assert ours["reward_low"] <= first.reward.mean() <= ours["reward_high"]
