"""`meal-bayes reproduce` as a reader types it, and what is committed: pages made from results."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import meal_bayes
from meal_bayes.cli import main
from meal_bayes.cli.reproduce import checkout
from meal_bayes.planners import POMCP, warm_up
from paper_repro import frame, pages
from paper_repro.statements import OUTCOMES, PROTOCOLS, UNDECIDED, verdict

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "paper_repro"
PACKAGE = Path(meal_bayes.__file__).resolve().parents[1]
NEED_RECORDINGS = {"fig4", "table2", "table3", "table4", "eq7", "fig10", "fig11", "fig12", "eq10",
                   "pomdpsol"}  # fmt: skip


def reproduce(*arguments, cwd=ROOT, **variables):
    path = os.pathsep.join([str(PACKAGE), os.environ.get("PYTHONPATH", "")])
    if "MEAL_BAYES_DATA_URL" not in os.environ:
        variables.setdefault("MEAL_BAYES_OFFLINE", "1")  # a test downloads nothing
    return subprocess.run(
        [sys.executable, "-P", "-m", "meal_bayes", "reproduce", *map(str, arguments)],
        cwd=cwd, env={**os.environ, "PYTHONPATH": path, **variables}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip


@pytest.mark.long
def test_all_items_quickly(tmp_path):
    before = {path: path.stat().st_mtime_ns for path in FOLDER.rglob("*.[jmp]*") if path.is_file()}
    warm_up(POMCP())  # the first run on a machine does, in half a minute
    done = reproduce("all", "--quick", "--json", "--jobs", 2, "--logs", tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    items = {result["item"]: result for result in told["items"]}
    assert {*items, *told["skipped"]} == set(frame.items())
    assert set(told["skipped"]) <= NEED_RECORDINGS
    if "MEAL_BAYES_DATA_URL" in os.environ:
        assert set(told["skipped"]) <= {"pomdpsol"}  # where no pomdpsol is
    for item, result in items.items():
        assert result["tables"][0]["rows"], item
        assert result["verdict"], item
        assert "--quick" in result["command"]
        for name in result["figures"]:
            assert (tmp_path / "paper_repro" / name).stat().st_size > 1000
    after = {path: path.stat().st_mtime_ns for path in before}
    assert after == before
    again = reproduce("fig8", "table4", "--quick", "--json", "--logs", tmp_path)
    for result in json.loads(again.stdout)["items"]:  # from the logs, offline and online
        assert result == items[result["item"]]


@pytest.mark.long
def test_without_the_items_one_line_says_where_they_are(tmp_path):
    done = reproduce("table5", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "call this in a checkout" in done.stderr
    done = reproduce("table5", "--quick", "--logs", tmp_path)
    assert done.returncode == 0
    assert "consistent (1 stands, 7 by construction)" in done.stdout
    assert "| shake | no | 0.060 | 0.059 |" in done.stdout


def test_the_items_are_found_here_and_above(tmp_path, monkeypatch):
    monkeypatch.chdir(FOLDER / "items")
    assert checkout() == ROOT
    monkeypatch.chdir(tmp_path)
    with pytest.raises(click.UsageError, match="source code"):
        checkout()
    (tmp_path / "paper_repro").mkdir()  # a folder of that name is not enough
    with pytest.raises(click.UsageError):
        checkout()


@pytest.fixture
def in_checkout(monkeypatch):
    """Return a function that runs the command in this process, without recordings."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("MEAL_BAYES_OFFLINE", "1")

    def invoke(*arguments):
        return CliRunner().invoke(main, ["reproduce", *map(str, arguments)], catch_exceptions=False)

    return invoke


def test_what_is_not_asked_for_is_told(in_checkout, tmp_path):
    done = in_checkout("fig10", "--repeats", 0, "--quick", "--json", "--logs", tmp_path)
    assert json.loads(done.stdout)["skipped"] == {"fig10": "none of its online runs is asked for"}


@pytest.mark.parametrize(
    ("words", "option"), [(("table3", "--json"), "--json"), (("readme",), "readme")]
)
def test_a_dry_run_prints_and_writes_no_more(in_checkout, monkeypatch, words, option):
    monkeypatch.setattr(pages, "write_pages", pytest.fail)
    done = in_checkout(*words, "--dry-run")
    assert done.exit_code == 2
    assert f"leave out {option}" in done.stderr


def test_missing_recordings_are_told_in_a_line(in_checkout, tmp_path, monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", "")
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path))
    done = in_checkout("table2", "--quick", "--logs", tmp_path)
    assert done.exit_code == 0, done.stderr
    assert "table2 is skipped" in done.stderr


RESULTS = FOLDER / "results"
ITEMS = [item for item in frame.items() if (RESULTS / f"{item}.json").is_file()]  # run in full


def committed(item):
    return json.loads((RESULTS / f"{item}.json").read_text(encoding="utf-8"))


def test_the_pages_are_those_of_the_results():
    items = frame.items()
    for name, text in {"README.md": pages.readme(items), "ERRATA.md": pages.errata(items)}.items():
        assert (FOLDER / name).read_text(encoding="utf-8") == text, (
            f"paper_repro/{name} is not that of the results; make it: meal-bayes reproduce readme"
        )


@pytest.mark.parametrize("item", ITEMS)
def test_every_item_is_shown_with_its_command_verdict_and_figures(item):
    result = committed(item)
    index = (FOLDER / "README.md").read_text(encoding="utf-8")
    page = (RESULTS / f"{item}.md").read_text(encoding="utf-8")
    assert f"[{item}](results/{item}.md)" in index
    assert result["sentence"] in index
    assert f"meal-bayes reproduce {item}" in page
    assert f"**{result['verdict']}**" in page
    for name in result["figures"]:
        assert f"({name})" in page
        assert (RESULTS / name).is_file()


@pytest.mark.parametrize("item", ITEMS)
def test_statements_have_all_that_they_rest_on(item):
    result = committed(item)
    page = (RESULTS / f"{item}.md").read_text(encoding="utf-8")
    assert result["verdict"] == verdict(result["statements"])
    for row in result["statements"]:
        assert row["where"]
        assert row["protocol"] in PROTOCOLS
        assert row["outcome"] in {None, *OUTCOMES}
        if row["outcome"] is None:
            continue
        assert row["rule"] in page
        assert row.get("needed") is None or row["outcome"] == UNDECIDED
        if row["level"] is not None:
            assert row["units"].split()[1] in ("objects", "splits", "trials")
            assert row["level"] <= 0.05


def test_every_departure_has_an_effect_or_a_reason():
    departures = tomllib.loads((FOLDER / "errata.toml").read_text(encoding="utf-8"))["departure"]
    page = (FOLDER / "ERRATA.md").read_text(encoding="utf-8")
    for number, entry in departures.items():
        (row,) = (line for line in page.splitlines() if line.startswith(f"| {number} |"))
        assert entry["text"] in row
        reason = entry.get("effect") or entry["unmeasured"]
        assert reason in row or "](results/" in row


def test_fitted_numbers_are_not_counted():
    outcomes = {row["text"]: row["outcome"] for row in committed("table5")["statements"]}
    assert list(outcomes.values()).count("by construction") == 7
    assert outcomes["after the last shake (no) the belief is 0.06"] == "stands"
    fig7 = {row["text"]: row["outcome"] for row in committed("fig7")["statements"]}
    assert fig7["the trial costs 167 s"] == "by construction"
    fig5 = committed("fig5")["statements"]
    assert {row["outcome"] for row in fig5} == {"by construction"}


def test_the_page_of_results_shows_the_papers_numbers():
    text = (FOLDER.parent / "docs" / "results" / "index.md").read_text(encoding="utf-8")
    paper = tomllib.loads((FOLDER / "paper_values.toml").read_text(encoding="utf-8"))["table3"]
    for n, title in (("2", "ROC36, two attributes"), ("3", "ROC36, three attributes")):
        table = text.partition(f"**{title}**")[2].partition("trials an agent")[0]
        for agent, values in paper[n].items():
            (row,) = (line for line in table.splitlines() if line.startswith(f"| {agent} |"))
            accuracy, cost = row.strip("| ").split(" | ")[-2:]
            assert (float(accuracy), float(cost)) == (values["accuracy"], values["cost"])
