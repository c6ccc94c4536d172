"""`export` writes the problem that the paper's agent would solve, or a reference model."""

import json
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.agents.knowledge import knowledge_without
from meal_bayes.datasets import load_percepts
from meal_bayes.learner.api import question_task
from meal_bayes.momdp import build_momdp, flatten
from meal_bayes.momdp.pomdp_reader import read_pomdp
from meal_bayes.momdp.reference import load_reference


def test_a_query_without_an_object_is_the_papers_problem(run):
    result = run("export", "own.pomdp", "--query", "Is it heavy?", "--object", "heavy_blue_beans")
    assert result.exit_code == 0
    assert result.stdout.startswith("own.pomdp: 13 states, 14 actions, 4 observations, ")
    assert "pomdpsol --timeout 5 --output own.policy own.pomdp" in result.stderr
    table = load_percepts("roc36")
    task = question_task("heavy", table, "heavy_blue_beans")
    known = knowledge_without(table, task.object_index, object_level=False)
    columns = [table.domain.attribute_index("heavy")]
    confusion, precision = known.posterior.select(columns, exact=True)
    expected = flatten(build_momdp(table.domain, task.query, confusion, precision))
    found = read_pomdp("own.pomdp")
    np.testing.assert_allclose(found.transition, expected.transition, atol=1e-15)
    np.testing.assert_array_equal(found.reward, expected.reward)
    reached = expected.transition[..., None] > 0
    np.testing.assert_allclose(
        np.where(reached, found.observation, 0)[..., :-2],
        np.where(reached, expected.observation, 0)[..., :-1],
        atol=1e-15,
    )


def test_a_table_of_ones_own_is_counted_over_all_objects(run, table):
    """Its percepts are always right: two recordings of four objects a truth, +1 a cell."""
    result = run("export", "own.pomdp", "--dataset", "kitchen.npz", "--query", "full,red", "--json")
    facts = json.loads(result.stdout)
    assert facts == {
        "file": "own.pomdp", "format": "pomdp", "attributes": ["full", "red"], "states": 9,
        "actions": 6, "observations": 6, "bytes": Path("own.pomdp").stat().st_size,
    }  # fmt: skip
    found = read_pomdp("own.pomdp")
    right = 9 / 10
    np.testing.assert_allclose(
        found.observation[0, 0, 0],
        [right**2, right * 0.1, right * 0.1, 0.01, 0, 0],
    )
    assert set(found.reward[:-1, 2:].ravel()) == {100.0, -100.0}


def test_options_reach_the_file(run):
    run("export", "a.txt", "--format", "pomdp", "--query", "heavy", "--discount", "0.9",
        "--reward", "7")  # fmt: skip
    found = read_pomdp("a.txt")
    assert found.discount == 0.9
    assert set(found.reward[:-1, 12:].ravel()) == {7.0, -7.0}
    run("export", "b.pomdpx", "--query", "heavy", "--discount", "0.9")
    assert "<Discount>0.9</Discount>" in Path("b.pomdpx").read_text()


def test_a_diagram_that_hides_x_can_be_exported_without_illegal_behaviors(run, fails):
    query = ("--dataset", "roc36_published", "--query", "heavy")
    assert "Forbid illegal behaviors" in fails("export", "a.pomdpx", *query)
    assert run("export", "a.pomdpx", *query, "--forbid-illegal").exit_code == 0


def test_a_reference_model(run, reference, monkeypatch):
    assert run("export", "a.pomdp", "--model", "A2", "--reference", reference).exit_code == 0
    momdp = load_reference(reference)["A2"]
    np.testing.assert_array_equal(read_pomdp("a.pomdp").reward, flatten(momdp).reward)
    monkeypatch.setenv("MEAL_BAYES_REFERENCE", str(reference))
    assert run("export", "b.pomdp", "--model", "A2").exit_code == 0
    assert Path("a.pomdp").read_bytes() == Path("b.pomdp").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (("own.txt", "--query", "heavy"), "give --format"),
        (("own.pomdp",), "Give either --query"),
        (("own.pomdp", "--query", "heavy", "--model", "A1"), "Give either --query"),
        (("own.pomdp", "--model", "A1", "--object", "x"), "leave --object out"),
        (("own.pomdp", "--query", "heavy", "--reference", "."), "--reference goes with --model"),
        (("own.pomdp", "--query", "heavy", "--discount", "1.5"), "is not in the range"),
        (("own.pomdp", "--query", "heavy", "--reward", "-1"), "is not in the range"),
        (("own.pomdp", "--query", "heavvy"), "did you mean 'heavy'"),
        (("own.pomdp", "--query", "heavy", "--dataset", "rock36"), "did you mean 'roc36'"),
        (("own.pomdp", "--query", "heavy", "--object", "x"), "Unknown object"),
        (("own.pomdp", "--model", "A1", "--reference", "none"), "No planner_reference.json"),
        (
            ("own.pomdp", "--query", "red,green,blue,light,medium,heavy,beans,rice,glass"),
            "files end",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_exported_is_told(fails, arguments, found):
    assert found in fails("export", *arguments)
    assert not list(Path.cwd().iterdir())


def test_an_unknown_reference_model_is_told(fails, reference):
    told = fails("export", "own.pomdp", "--model", "A6", "--reference", reference)
    assert "did you mean 'A5'" in told


def test_no_reference_folder_is_told(fails, monkeypatch):
    monkeypatch.delenv("MEAL_BAYES_REFERENCE", raising=False)
    assert "MEAL_BAYES_REFERENCE" in fails("export", "own.pomdp", "--model", "A1")


def test_a_file_in_a_place_that_is_none_is_told(fails, tmp_path):
    (tmp_path / "file").touch()
    assert "cannot be written" in fails("export", "file/own.pomdp", "--query", "heavy")


def test_the_same_command_writes_the_same_file(run):
    for name in ("a.pomdpx", "b.pomdpx"):
        run("export", name, "--query", "heavy,blue")
    assert Path("a.pomdpx").read_bytes() == Path("b.pomdpx").read_bytes()
