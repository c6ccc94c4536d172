"""What is committed: pages made from results, and the results' bars."""

import json
import tomllib
from pathlib import Path

import pytest

from paper_repro import frame, pages
from paper_repro.statements import OUTCOMES, UNDECIDED, verdict

FOLDER = Path(frame.__file__).parent
RESULTS = FOLDER / "results"


def committed(item):
    path = RESULTS / f"{item}.json"
    assert path.is_file(), f"{item} is not run in full: meal-bayes reproduce {item}"
    return json.loads(path.read_text(encoding="utf-8"))


def test_the_pages_are_those_of_the_results():
    items = frame.items()
    for name, text in {"README.md": pages.readme(items), "ERRATA.md": pages.errata(items)}.items():
        assert (FOLDER / name).read_text(encoding="utf-8") == text, (
            f"paper_repro/{name} is not that of the results; make it: meal-bayes reproduce readme"
        )


@pytest.mark.parametrize("item", frame.items())
def test_every_item_is_shown_with_its_command_verdict_and_figures(item):
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert f"meal-bayes reproduce {item}" in page
    found = committed(item)
    assert f"**{found['verdict']}**" in page
    for name in found["figures"]:
        assert f"(results/{name})" in page
        assert (RESULTS / name).is_file()


@pytest.mark.parametrize("item", frame.items())
def test_statements_have_five_keys_and_known_outcomes(item):
    found = committed(item)
    assert found["verdict"] == verdict(found["statements"])
    for one in found["statements"]:
        assert set(one) == {"text", "recorded", "published", "repeats", "needed"}
        assert {one["recorded"], one["published"]} <= {None, *OUTCOMES}
        assert (one["needed"] is None) or UNDECIDED in (one["recorded"], one["published"])


@pytest.mark.parametrize("item", frame.items())
def test_every_outcome_has_its_rule_on_the_page(item):
    found, page = committed(item), (FOLDER / "README.md").read_text(encoding="utf-8")
    rests = [table for table in found["tables"] if table["title"] == "what the statements rest on"]
    rows = [(row[0], row[1], row[2], row[6]) for table in rests for row in table["rows"]]
    for one in found["statements"]:
        for side in ("recorded", "published"):
            if one[side] is not None:
                (rule,) = (r[2] for r in rows if r[:2] == (one["text"], side) and r[3] == one[side])
                assert rule
                assert rule in page
    for word in (*OUTCOMES, "not reproduced", "reproduced", "undecided"):
        assert f"*{word}*" in page


def test_every_departure_has_an_effect_or_a_reason():
    departures = tomllib.loads((FOLDER / "errata.toml").read_text(encoding="utf-8"))["departure"]
    page = (FOLDER / "ERRATA.md").read_text(encoding="utf-8")
    for number, entry in departures.items():
        (row,) = (line for line in page.splitlines() if line.startswith(f"| {number} |"))
        assert entry["text"] in row
        assert entry["unmeasured"] in row or "README.md#" in row


def test_fitted_numbers_are_not_counted():
    outcomes = {one["text"]: one["recorded"] for one in committed("table5")["statements"]}
    assert list(outcomes.values()).count("by construction") == 5
    assert outcomes["after the last shake (no) the belief is 0.06"] == "stands"
    fig7 = {one["text"]: one["recorded"] for one in committed("fig7")["statements"]}
    assert fig7["the trial costs 167 s"] == "by construction"
    assert fig7["its reward is 333"] == "stands"
    fig5 = [one for one in committed("fig5")["statements"] if "succeed" in one["text"]]
    assert {one["recorded"] for one in fig5} == {"by construction"}


def test_the_page_of_results_shows_the_papers_numbers():
    text = (FOLDER.parent / "docs" / "results" / "index.md").read_text(encoding="utf-8")
    paper = tomllib.loads((FOLDER / "paper_values.toml").read_text(encoding="utf-8"))["table3"]
    for n, title in (("2", "ROC36, two attributes"), ("3", "ROC36, three attributes")):
        table = text.partition(f"**{title}**")[2].partition("trials an agent")[0]
        for agent, values in paper[n].items():
            (row,) = (line for line in table.splitlines() if line.startswith(f"| {agent} |"))
            accuracy, cost = row.strip("| ").split(" | ")[-2:]
            assert (float(accuracy), float(cost)) == (values["accuracy"], values["cost"])
