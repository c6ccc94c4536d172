"""`export` writes the problem that the paper's agent would solve."""

import json
from pathlib import Path

import pytest

from meal_bayes.agents.knowledge import knowledge_without
from meal_bayes.datasets import load_percepts
from meal_bayes.domain import load_domain
from meal_bayes.learner.api import question_task
from meal_bayes.momdp import Objective, build_momdp, write_pomdp


def test_a_query_without_an_object_is_the_papers_problem(run):
    result = run("export", "own.pomdp", "--query", "Is it heavy?", "--object", "heavy_blue_beans")
    assert result.exit_code == 0
    assert result.stdout.startswith("own.pomdp: 13 states, 15 actions, 4 observations, ")
    assert "pomdpsol --timeout 5 --output own.policy own.pomdp" in result.stderr
    table = load_percepts("roc36")
    task = question_task("heavy", table, "heavy_blue_beans")
    known = knowledge_without(table, task.object_index, object_level=False)
    columns = [table.domain.attribute_index("heavy")]
    confusion, precision = known.posterior.select(columns, exact=True)
    goal = Objective(abstain=True)
    momdp = build_momdp(table.domain, task.query, confusion, precision, objective=goal)
    write_pomdp(momdp, "expected.pomdp")
    assert Path("own.pomdp").read_bytes() == Path("expected.pomdp").read_bytes()


def test_a_table_of_ones_own_is_counted_over_all_objects(run, table):
    """Its percepts are always right: two recordings of four objects a truth, +1 a cell."""
    result = run("export", "own.pomdp", "--dataset", "kitchen.npz", "--query", "full,red", "--json")
    facts = json.loads(result.stdout)
    assert facts == {
        "file": "own.pomdp", "format": "pomdp", "attributes": ["full", "red"], "states": 9,
        "actions": 7, "observations": 6, "bytes": Path("own.pomdp").stat().st_size,
    }  # fmt: skip
    rates = {line.split()[-2]: float(line.split()[-1]) for line in _lines("O: ") if "s0p00" in line}
    assert rates == pytest.approx({"na": 0, "p00": 0.81, "p01": 0.09, "p10": 0.09, "p11": 0.01})
    assert {line.split()[-1] for line in _lines("R: a")} == {"100.0", "-100.0", "0.0"}


def _lines(start, name="own.pomdp"):
    return [line for line in Path(name).read_text().splitlines() if line.startswith(start)]


def test_options_reach_the_file(run):
    run("export", "a.txt", "--format", "pomdp", "--query", "heavy", "--discount", "0.9",
        "--reward", "7")  # fmt: skip
    assert _lines("discount", "a.txt") == ["discount: 0.9"]
    assert {line.split()[-1] for line in _lines("R: a", "a.txt")} == {"7.0", "-7.0", "0.0"}
    run("export", "b.pomdpx", "--query", "heavy", "--discount", "0.9")
    assert "<Discount>0.9</Discount>" in Path("b.pomdpx").read_text()


def test_what_cannot_be_exported_is_told(fails):
    assert "give --format" in fails("export", "own.txt", "--query", "heavy")
    assert "--query" in fails("export", "own.pomdp")
    assert "Unknown object" in fails("export", "own.pomdp", "--query", "heavy", "--object", "x")
    many = ",".join(load_domain("cy101").attributes[:9])
    told = fails("export", "own.pomdp", "--dataset", "cy101", "--query", many)
    assert "9 attributes" in told
    assert not list(Path.cwd().iterdir())
