"""What is committed: pages made from results, and the results' bars."""

import json
import tomllib
from pathlib import Path

import pytest

from paper_repro import frame, pages
from paper_repro.statements import OUTCOMES, PROTOCOLS, UNDECIDED, verdict

FOLDER = Path(frame.__file__).parent
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
    found, index = committed(item), (FOLDER / "README.md").read_text(encoding="utf-8")
    page = (RESULTS / f"{item}.md").read_text(encoding="utf-8")
    assert f"[{item}](results/{item}.md)" in index
    assert found["sentence"] in index
    assert f"meal-bayes reproduce {item}" in page
    assert f"**{found['verdict']}**" in page
    for name in found["figures"]:
        assert f"({name})" in page
        assert (RESULTS / name).is_file()


@pytest.mark.parametrize("item", ITEMS)
def test_statements_have_all_that_they_rest_on(item):
    found, page = committed(item), (RESULTS / f"{item}.md").read_text(encoding="utf-8")
    assert found["verdict"] == verdict(found["statements"])
    for one in found["statements"]:
        assert one["where"]
        assert one["protocol"] in PROTOCOLS
        assert one["outcome"] in {None, *OUTCOMES}
        if one["outcome"] is None:
            continue
        assert one["rule"] in page
        assert one.get("needed") is None or one["outcome"] == UNDECIDED
        if one["level"] is not None:
            assert one["units"].split()[1] in ("objects", "splits")
            assert one["level"] <= 0.05


def test_every_departure_has_an_effect_or_a_reason():
    departures = tomllib.loads((FOLDER / "errata.toml").read_text(encoding="utf-8"))["departure"]
    page = (FOLDER / "ERRATA.md").read_text(encoding="utf-8")
    for number, entry in departures.items():
        (row,) = (line for line in page.splitlines() if line.startswith(f"| {number} |"))
        assert entry["text"] in row
        assert entry["unmeasured"] in row or "](results/" in row


def test_fitted_numbers_are_not_counted():
    outcomes = {one["text"]: one["outcome"] for one in committed("table5")["statements"]}
    assert list(outcomes.values()).count("by construction") == 7
    assert outcomes["after the last shake (no) the belief is 0.06"] == "stands"
    fig7 = {one["text"]: one["outcome"] for one in committed("fig7")["statements"]}
    assert fig7["the trial costs 167 s"] == "by construction"
    fig5 = committed("fig5")["statements"]
    assert {one["outcome"] for one in fig5} == {"by construction"}


def test_the_page_of_results_shows_the_papers_numbers():
    text = (FOLDER.parent / "docs" / "results" / "index.md").read_text(encoding="utf-8")
    paper = tomllib.loads((FOLDER / "paper_values.toml").read_text(encoding="utf-8"))["table3"]
    for n, title in (("2", "ROC36, two attributes"), ("3", "ROC36, three attributes")):
        table = text.partition(f"**{title}**")[2].partition("trials an agent")[0]
        for agent, values in paper[n].items():
            (row,) = (line for line in table.splitlines() if line.startswith(f"| {agent} |"))
            accuracy, cost = row.strip("| ").split(" | ")[-2:]
            assert (float(accuracy), float(cost)) == (values["accuracy"], values["cost"])
