"""What is committed: pages made from results, and the results' bars."""

import json
import tomllib
from pathlib import Path

SCRIPTS = Path(__file__).resolve().parents[2] / "paper_repro"
RESULTS = SCRIPTS / "results"


def committed(item):
    path = RESULTS / f"{item}.json"
    assert path.is_file(), f"{item} is not run in full: meal-bayes reproduce {item}"
    return json.loads(path.read_text(encoding="utf-8"))


def test_the_pages_are_those_of_the_results(scripts):
    items = scripts.reproduction.ITEMS
    made = {"README.md": scripts.pages.readme(items), "ERRATA.md": scripts.pages.errata(items)}
    for name, text in made.items():
        assert (SCRIPTS / name).read_text(encoding="utf-8") == text, (
            f"paper_repro/{name} is not that of the results; make it: meal-bayes reproduce readme"
        )


def test_every_item_is_shown_with_its_command_and_verdict(scripts):
    page = (SCRIPTS / "README.md").read_text(encoding="utf-8")
    for item in scripts.reproduction.ITEMS:
        assert f"meal-bayes reproduce {item}" in page
        told = committed(item)
        assert f"**{told['verdict']}**" in page
        for name in told["figures"]:
            assert f"(results/{name})" in page
            assert (RESULTS / name).is_file()


def test_verdicts_are_those_of_the_claims(scripts):
    found = [path for path in RESULTS.glob("*.json") if path.name != "timing.json"]
    assert found
    for path in found:
        told = json.loads(path.read_text(encoding="utf-8"))
        claims = [scripts.frame.Claim(**claim) for claim in told["claims"]]
        assert told["verdict"] == scripts.frame.verdict(claims), path.name


def test_every_departure_has_an_effect_or_a_reason():
    departures = tomllib.loads((SCRIPTS / "errata.toml").read_text(encoding="utf-8"))["departure"]
    page = (SCRIPTS / "ERRATA.md").read_text(encoding="utf-8")
    for number, entry in departures.items():
        (row,) = (line for line in page.splitlines() if line.startswith(f"| {number} |"))
        assert entry["text"] in row
        assert entry["unmeasured"] in row or "README.md#" in row


def test_no_number_stands_without_its_error(scripts):
    """Wherever agents are measured the paper's column, ours, and their errors are there."""
    told = committed("table3")
    (table, paired) = told["tables"]
    for row in table["rows"]:
        assert all(len(cell) == 2 for cell in row[3:5] + row[6:8])
    assert all(len(cell) == 2 for row in paired["rows"] for cell in row[1:])


def test_table_3_meets_its_bars():
    told = committed("table3")
    rows = {(row[0], row[1]): row for row in told["tables"][0]["rows"]}
    claims = {claim["text"]: claim for claim in told["claims"]}
    for n, least, most in ((2, 0.99, 14.0), (3, 0.985, 17.0)):
        accuracy, cost = rows[n, "morc"][4], rows[n, "morc"][7]
        assert accuracy[0] >= least
        assert cost[0] <= most
        plus = rows[n, "predefined_plus, all eleven"]
        assert plus[6] == [37.1, 0.0]
    assert claims["random, 2 attributes: accuracy 0.245"]["published"]
    assert claims["random, 3 attributes: accuracy 0.130"]["published"]


def test_irrelevant_attributes_cost_us_nothing():
    table = committed("fig9")["tables"][0]
    own = table["columns"].index("reward: ours")
    first, *_, last = (row[own][0] for row in table["rows"])
    assert table["rows"][-1][0] == 79
    assert last >= first - 0.02 * abs(first)


def test_replayed_trials_show_what_the_paper_prints():
    assert all(claim["recorded"] for claim in committed("table5")["claims"])
    fell = [claim for claim in committed("fig7")["claims"] if not claim["recorded"]]
    assert [claim["text"] for claim in fell] == ["the trial costs 167 s", "its reward is 333"]


def test_the_project_readme_shows_the_papers_numbers():
    text = (SCRIPTS.parent / "README.md").read_text(encoding="utf-8")
    paper = tomllib.loads((SCRIPTS / "paper_values.toml").read_text(encoding="utf-8"))["table3"]
    for n, title in (("2", "ROC36, two attributes"), ("3", "ROC36, three attributes")):
        table = text.partition(f"**{title}**")[2].partition("trials an agent")[0]
        for agent, values in paper[n].items():
            (row,) = (line for line in table.splitlines() if line.startswith(f"| {agent} |"))
            accuracy, cost = row.strip("| ").split(" | ")[-2:]
            assert (float(accuracy), float(cost)) == (values["accuracy"], values["cost"])
