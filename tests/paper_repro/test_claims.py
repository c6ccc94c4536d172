"""The table of claims says what the results say, and marks what rests on older percepts."""

import json
import math
import re
from collections import Counter
from pathlib import Path

import pytest

from paper_repro import claims, frame, pages
from paper_repro.statements import CONSTRUCTED, FALLS, OUTCOMES, STANDS, UNDECIDED

FOLDER = Path(frame.__file__).parent
ENTRIES = frame.read_table("claims.toml")["claim"]


def rows_of_readme():
    """Read the table off the page: its cells by column, a row a claim."""
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    lines = text.partition("| the paper claims |")[2].partition("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines]


@pytest.mark.parametrize("number", range(len(ENTRIES)))
def test_a_row_has_the_outcome_and_the_numbers_of_its_results(number):
    """Read here by code of its own: the JSON, the statements' texts, and what is printed."""
    entry = ENTRIES[number]
    cells = rows_of_readme()[number]
    path = FOLDER / "results" / f"{entry['item']}.json"
    statements = json.loads(path.read_text(encoding="utf-8"))["statements"]
    answering = claims.chosen(entry, statements)
    assert cells[0] == entry["says"]
    assert cells[1] == entry["where"]
    counts = Counter(row["outcome"] for row in answering)
    if len(counts) == 1:
        (kind,) = counts
        assert cells[2] == f"**{kind or claims.NOT_RUN}**"
    for kind, often in counts.items() if len(counts) > 1 else ():
        words = {STANDS: "stand", FALLS: "fall", None: "not run"}
        assert f"{often} {words.get(kind, kind)}" in cells[2]
    shown = [row for row in answering if row["estimate"] is not None]
    if len(shown) > 3 and all(" is in [" in row["rule"] for row in shown):
        shown = [row for row in shown if row["outcome"] == FALLS]
        assert f"of {len(answering)} printed numbers {len(shown)} fall" in cells[3]
    elif len(shown) > 3:  # the ranges of their estimates, quantity by quantity
        words = {row["rule"].partition(" is ")[0].partition(": ")[0] for row in shown}
        decided = [row for row in shown if row["outcome"] in (STANDS, FALLS)]
        few = len(decided) if len(decided) < len(shown) and len(decided) <= 3 else 0
        assert cells[3].count("; ") == len(words) - 1 + few
        for pick in (min, max):
            end = pick(row["estimate"] for row in shown)
            assert any(f"{end:{form}}" in cells[3] for form in ("+.3f", "+.1f"))
        return
    assert len(re.findall(r"\[[^\]]+, [^\]]+\]", cells[3])) == len(shown)  # intervals
    for row in shown:
        low, high = row["interval"]
        assert any(f"{row['estimate']:{form}} [{low:{form}}, {high:{form}}]" in cells[3]
                   for form in (".3f", "+.3f", ".1f", "+.1f"))  # fmt: skip
    assert f"[{entry['item']}](results/{entry['item']}.md)" in cells[5]


def test_claims_are_few_and_name_items_and_columns_that_there_are():
    assert len(ENTRIES) >= 12
    for entry in ENTRIES:
        if not frame.is_marked_older(entry["item"]):  # older results may lack newer statements
            texts = frame.read_result(entry["item"])["statements"]
            for pattern in entry["statements"]:
                assert claims.chosen(entry | {"statements": [pattern]}, texts), pattern
        assert {entry["item"], *entry.get("beside", ())} <= set(frame.items())
        assert entry["column"] in ("theirs", "recorded")


def test_statements_that_measure_different_things_say_what():
    """A fraction that is given up must not be taken for a reward."""
    rows = [{"text": f"reward {end}", "outcome": STANDS, "estimate": x, "interval": [x, x],
             "rule": rule} for end, x, rule in
            (("starts above 150", 243.0, "reward is above 150"),
             ("ends below 25", 1.0, "the fraction given up is above 0.95"))]  # fmt: skip
    assert claims.effects_of(rows) == (
        "starts above 150: reward 243.0 [243.0, 243.0]",
        "ends below 25: the fraction given up 1.000 [1.000, 1.000]",
    )


def test_an_item_of_another_planner_is_told_beside(tmp_path, monkeypatch):
    monkeypatch.setattr(frame, "RESULTS", tmp_path)
    entry = {"says": "it ends low", "where": "Fig. 9", "item": "pomdpsol", "beside": ["fig9"],
             "column": "theirs", "because": "", "statements": ["ends*"]}  # fmt: skip
    for item, rows in (
        ("pomdpsol", [("theirs", STANDS)]),
        ("fig9", [("theirs", UNDECIDED), ("recorded", FALLS)]),
    ):
        statements = [{"text": "ends low", "protocol": column, "outcome": kind, "estimate": None,
                       "interval": None, "rule": "it is low"} for column, kind in rows]  # fmt: skip
        record = json.dumps({"statements": statements})
        (tmp_path / f"{item}.json").write_text(record, encoding="utf-8")
    row = claims._claim(entry)
    assert (row.outcome, row.counts) == (STANDS, "")
    assert row.elsewhere == "in *theirs* of fig9 1 undecided; in *recorded* of fig9 1 falls"


def test_the_sentence_counts_the_claims():
    rows = claims.claims()
    told = claims.sentence(rows)
    assert told in (FOLDER / "README.md").read_text(encoding="utf-8")
    assert f"Of {len(rows)} claims" in told
    kinds = Counter(row.outcome for row in rows)
    assert set(kinds) <= {*OUTCOMES, claims.IN_PART, claims.NOT_RUN}
    for kind, words in ((STANDS, "stand"), (FALLS, "fall"), (UNDECIDED, "undecided")):
        if kinds[kind]:
            assert f"{kinds[kind]} " in told
            assert words in told


@pytest.mark.parametrize(
    ("outcomes", "together"),
    [
        ([STANDS], STANDS), ([FALLS, FALLS], FALLS), ([UNDECIDED], UNDECIDED),
        ([STANDS, FALLS], claims.IN_PART), ([STANDS, None], claims.IN_PART),
        ([FALLS, UNDECIDED], FALLS), ([UNDECIDED, None], UNDECIDED),
        ([CONSTRUCTED, STANDS], STANDS), ([CONSTRUCTED], CONSTRUCTED), ([], claims.NOT_RUN),
        ([None, None], claims.NOT_RUN),
    ],
)  # fmt: skip
def test_a_claim_goes_by_all_its_statements(outcomes, together):
    assert claims.outcome_of(outcomes) == together


def test_results_of_older_code_are_marked_and_run_by_all(tmp_path, monkeypatch):
    monkeypatch.setattr(frame, "RESULTS", tmp_path)
    setting = frame.Setting()
    frame.note_provenance("fig8", tmp_path, frame.command("fig8", setting), 90.0)
    part = frame.command("table3", frame.Setting(trials=3))
    frame.note_provenance("table3", tmp_path, part, 1.0)
    assert not frame.is_older("fig8")
    assert frame.is_older("table3")  # of fewer trials
    assert frame.is_older("fig10")  # was never run
    assert frame.minutes_of("fig8") == 1.5
    assert not frame.is_marked_older("fig8")
    monkeypatch.setattr(frame, "made_by", lambda command: "other")
    frame.mark_older()
    assert frame.is_marked_older("fig8")
    known = frame.provenance(tmp_path)["fig8"]
    assert set(known) == {"code", "blas", "version", "seconds", "older"}
    assert known["blas"]
    facts = dict.fromkeys(("title", "sentence", "verdict", "size", "shows"), "")
    lists = {"statements": [], "tables": [], "figures": [], "notes": []}
    page = facts | lists | {"item": "fig8", "command": "meal-bayes reproduce fig8 --seed 0"}
    assert "earlier version" in pages.result_page(page, committed=True)
    assert "earlier version" not in pages.result_page(page)


def test_printed_numbers_lie_as_many_standard_errors_away_as_is_said():
    """Of Table 3, by the errors of both: the paper's from what it prints, and ours."""
    paper = frame.paper_values("table3")
    (entry,) = (entry for entry in ENTRIES if entry["says"].startswith("Accuracies and costs"))
    distances = []
    for row in claims.chosen(entry, frame.read_result("table3")["statements"]):
        n, key = re.search(r"(\d) attributes: (accuracy|cost)", row["text"]).groups()
        printed = paper[n]["morc" if row["text"].startswith("morc") else "predefined_plus"]
        p = printed["accuracy"]
        variance = printed["sd"] ** 2 if key == "cost" else p * (1 - p)
        error = math.hypot(row["error"], (variance / paper["trials"]) ** 0.5)
        distances.append(abs(row["estimate"] - printed[key]) / error)
    far = sorted(round(distance) for distance in distances if distance > 2)
    assert (len(distances), len(far)) == (6, 5)
    assert (
        f"Five of the six differ from ours by {far[0]} to {far[-1]} standard errors (of both)"
        in entry["because"]
    )
