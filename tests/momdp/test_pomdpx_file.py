"""Written .pomdpx files are the MOMDP: read back by a small strict reader, as arrays."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from planner_models import load_reference

from meal_bayes.domain import Event, Payoffs, Query, load_domain
from meal_bayes.momdp import build_momdp, flatten, write_pomdpx
from meal_bayes.planners import Factored


def read_pomdpx(path: Path) -> SimpleNamespace:
    """Read the form that is written: an observed and a hidden variable, one observation, tables."""
    root = ElementTree.parse(path).getroot()
    assert [part.tag for part in root] == [
        "Discount", "Variable", "InitialStateBelief", "StateTransitionFunction", "ObsFunction",
        "RewardFunction",
    ]  # fmt: skip
    observed, hidden = root.findall("Variable/StateVar")
    assert (observed.get("fullyObs"), hidden.get("fullyObs")) == ("true", None)
    values = {}
    for variable in (observed, hidden):
        for end in ("vnamePrev", "vnameCurr"):
            values[variable.get(end)] = variable.findtext("ValueEnum").split()
    values["o"] = root.findtext("Variable/ObsVar/ValueEnum").split()
    values["a"] = root.findtext("Variable/ActionVar/ValueEnum").split()
    for names in values.values():
        assert len(set(names)) == len(names)
        assert all(name.replace("_", "").isalnum() and name.isascii() for name in names)
    tables = {}
    for function in root.iter():
        if function.tag in ("CondProb", "Func"):
            variable = function.findtext("Var")
            parents = [name for name in function.findtext("Parent").split() if name != "null"]
            axes = parents if function.tag == "Func" else [*parents, variable]
            tables[variable] = table_of(function.find("Parameter"), [values[n] for n in axes])
    return SimpleNamespace(
        discount=float(root.findtext("Discount")), values=values,
        x0=tables["x0v"], y0=tables["y0v"], x=tables["x1v"], y=tables["y1v"], o=tables["o"],
        reward=tables["r"],
    )  # fmt: skip


def table_of(parameter: ElementTree.Element, axes: list[list[str]]) -> np.ndarray:
    """Carry the entries of a table out, in their order; what none sets is 0 (PomdpX 1.0, 2.3.1)."""
    assert parameter.get("type") == "TBL"
    table = np.zeros([len(names) for names in axes])
    for entry in parameter:
        words = entry.findtext("Instance").split()
        assert len(words) == len(axes)
        numbers = (entry.findtext("ProbTable") or entry.findtext("ValueTable")).split()
        index = tuple(
            slice(None) if word in "*-" else names.index(word)
            for word, names in zip(words, axes, strict=True)
        )
        shape = [len(names) for word, names in zip(words, axes, strict=True) if word == "-"]
        if numbers == ["uniform"]:
            table[index] = 1 / shape[-1]
        elif numbers == ["identity"]:
            table[index] = np.eye(shape[0])
        else:
            table[index] = np.array(numbers, dtype=float).reshape(shape)
    return table


def written(momdp, folder, **options) -> SimpleNamespace:
    write_pomdpx(momdp, folder / "own.pomdpx", **options)
    return read_pomdpx(folder / "own.pomdpx")


@pytest.mark.parametrize("name", ["A1", "A2", "A3"])
def test_reference_models_equal_the_authors_files(reference, tmp_path, name):
    """But for illegal behaviors: theirs may end a trial by one, at its cost."""
    momdp = replace(load_reference()[name], abstain=False)
    ours = written(momdp, tmp_path)
    theirs = read_pomdpx(reference / f"roc36_{name}.pomdpx")
    illegal = np.nonzero(~momdp.legal[:-1].T)  # (E,X-1)
    prices = np.tile(-momdp.cost[illegal[0], None], 2 ** len(momdp.query))
    np.testing.assert_array_equal(theirs.reward[illegal], prices)
    theirs.reward[illegal] = ours.reward[illegal]
    assert ours.discount == theirs.discount
    assert ours.values["a"] == theirs.values["a"]
    assert ours.values["o"] == theirs.values["o"]
    assert ours.values["o"][-1] == "na"
    for table in ("x0", "y0", "x", "y", "o", "reward"):  # theirs have 12 digits
        np.testing.assert_allclose(getattr(ours, table), getattr(theirs, table), atol=2e-12)


@pytest.mark.parametrize(
    ("name", "n", "levels"),
    [("toy", 1, 2), ("toy", 2, 4), ("roc36", 2, 2), ("ispy32", 3, 2), ("cy101", 1, 4)],
)
def test_what_is_written_is_the_flat_problem(momdp_of, tmp_path, name, n, levels):
    momdp = momdp_of(name, n, levels)
    bonus = np.random.default_rng(1).uniform(-9, 9, momdp.bonus.shape)
    momdp = replace(momdp, bonus=bonus)
    ours = written(momdp, tmp_path)
    flat = flatten(momdp)
    end = momdp.terminal
    n_y = 2**n
    n_a = momdp.n_actions
    for rows in (ours.x0, ours.y0, ours.x, ours.y, ours.o):
        np.testing.assert_allclose(rows.sum(axis=-1), 1.0, atol=1e-12)
    joint = np.einsum("axX,ayY->axyXY", ours.x, ours.y)
    living = joint[:, :end, :, :end].reshape(n_a, end * n_y, end * n_y)
    np.testing.assert_allclose(living, flat.transition[:, :-1, :-1], atol=1e-15)
    np.testing.assert_array_equal(ours.x[:, -1, -1], 1.0)
    start = np.outer(ours.x0, ours.y0)
    np.testing.assert_allclose(start[:end].ravel(), flat.start[:-1], atol=1e-15)
    reward = ours.reward.transpose(1, 2, 0)  # (X,Y,A)
    np.testing.assert_array_equal(reward[:end].reshape(-1, n_a), flat.reward[:-1])
    np.testing.assert_array_equal(reward[end], 0.0)
    shown = ours.o[:, :end].reshape(n_a, 1, end * n_y, -1)
    reached = flat.transition[:, :-1, :-1, None] > 0
    expected = np.where(reached, flat.observation[:, :-1, :-1], 0.0)
    np.testing.assert_allclose(np.where(reached, shown, 0.0), expected, atol=1e-15)


def best_within(file: SimpleNamespace, steps: int) -> float:
    """Compute the optimum of a file's problem among trials of so many steps, by recursion."""
    start = int(file.x0.argmax())
    end = len(file.x0) - 1

    def value(x: int, belief: np.ndarray, left: int) -> float:
        if x == end or left == 0:
            return 0.0
        return max(action(a, x, belief, left) for a in range(len(file.values["a"])))

    def action(a: int, x: int, belief: np.ndarray, left: int) -> float:
        later = 0.0
        for after in np.flatnonzero(file.x[a, x, :end]):
            for z in np.flatnonzero(file.o[a, after].any(axis=0)):
                weight = belief * file.x[a, x, after] * file.o[a, after, :, z]  # (Y,)
                chance = weight.sum()
                later += chance * value(after, weight / chance, left - 1)
        return float(belief @ file.reward[a, x]) + file.discount * later

    return value(start, file.y0, steps)


@pytest.mark.parametrize(
    ("event", "payoffs"),
    [
        (Event((True, False)), Payoffs(300.0, -100.0, 100.0, -1000.0)),
        (Event((True, False)), Payoffs(100.0, -1000.0, 300.0, -100.0)),
        (Event((False, False), complement=True), Payoffs(200.0, -100.0, 50.0, -400.0)),
    ],
)
def test_a_question_of_yes_or_no_is_worth_as_much_in_its_file(event, payoffs, tmp_path):
    """Between the optimum of short trials in the file, and our certified bound, there is little."""
    rows = np.tile([[0.95, 0.05], [0.05, 0.95]], (2, 3, 1, 1))
    query = Query(("red", "heavy"), event=event, payoffs=payoffs)
    momdp = build_momdp(load_domain("toy"), query, rows)
    file = written(momdp, tmp_path)
    assert file.values["a"][3:5] == ["ano", "ayes"]
    bound = Factored().solve(momdp, np.random.default_rng(0)).upper_bound
    within = best_within(file, 4)
    assert bound - 0.01 * (max(payoffs) - min(payoffs)) <= within <= bound + 1e-9


def test_actions_and_hidden_values_stand_in_our_order(momdp_of, tmp_path):
    """As the alpha vectors of a solver are read by position."""
    momdp = momdp_of("toy", 2)
    ours = written(momdp, tmp_path)
    e = momdp.n_behaviors
    assert ours.values["x0v"] == ["x0", "x1", "term"]
    assert ours.values["y0v"] == ["y00", "y01", "y10", "y11"]
    assert ours.values["a"] == ["look", "lift", "reinit", "a00", "a01", "a10", "a11"]
    for y, values in enumerate(momdp.query.values):
        assert ours.reward[e + momdp.query.index_of(values), 0, y] == momdp.correct
    prior = np.where(momdp.query.values, momdp.prior, 1 - momdp.prior).prod(axis=1)
    np.testing.assert_allclose(ours.y0, prior, atol=1e-15)


def test_a_branching_diagram_is_written_as_x_is_observed(momdp_of, tmp_path):
    """What .pomdp has to refuse: two x' that look alike."""
    momdp = momdp_of("toy", 1)
    transition = momdp.transition.copy()
    observation_probability = momdp.observation_probability.copy()
    transition[0, 0] = [0.5, 0.5, 0.0]
    observation_probability[0, 0] = 1.0
    legal = momdp.legal.copy()
    transition[0, 1] = [0.0, 0.0, 1.0]
    legal[1, 0] = False
    branching = replace(
        momdp, transition=transition, observation_probability=observation_probability, legal=legal
    )
    np.testing.assert_array_equal(written(branching, tmp_path).x[0, 0], [0.5, 0.5, 0.0])
