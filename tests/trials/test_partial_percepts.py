"""A percept or an answer about a part of what is asked: what is named counts, the rest is missing.

The belief is compared with a filter that sums over all values of all attributes, with the
Dirichlet-multinomial probability of each class's percepts in closed form.
"""

import itertools

import numpy as np
import pytest
from scipy.special import gammaln, xlogy

from meal_bayes import Outcome, load_domain, read_query
from meal_bayes.datasets.percepts import detected_levels
from meal_bayes.momdp import build_momdp
from meal_bayes.planners import unvalued
from meal_bayes.robots.robot import OutcomeChecker
from meal_bayes.trials import Session, Task

LEVELS = 4


class Detections:
    """A perceiver that passes on what a detector of the robot names."""

    def __init__(self, domain):
        self.domain = domain

    def observe(self, instance, query, rng):
        levels = detected_levels(instance.percepts, self.domain, LEVELS)
        return levels[self.domain.columns(query.attributes)]


def drawn_domain(rng):
    """Return a domain of a few attributes, some of them a group, that looks and asks a person."""
    names = [f"a{i}" for i in range(int(rng.integers(2, 7)))]
    grouped = int(rng.integers(0, len(names) + 1))
    groups = {"g": names[:grouped]} if grouped > 1 else {}
    return load_domain(
        {
            "name": "drawn",
            "attributes": names,
            "groups": groups,
            "report_reward": 50.0,
            "behaviors": [
                {"name": "look", "cost": 1.0, "modalities": ["detector"]},
                {"name": "feel", "cost": 2.0, "modalities": ["detector"]},
                {"name": "ask", "cost": 5.0, "answer_accuracy": 0.9},
            ],
            "diagram": {
                "states": ["here"],
                "start": "here",
                "effects": [
                    {"from": "here", "do": name, "to": "here", "probability": 0.9}
                    for name in ("look", "feel", "ask")
                ],
            },
        }
    )


def drawn_problem(domain, query, rng):
    n = len(query)
    rows = rng.dirichlet(np.ones(LEVELS), (n, 3, 2))
    precision = rng.choice([2.0, 9.0, np.inf], (n, 3, 2))
    prior = rng.uniform(0.1, 0.9, n)
    for group in query.groups:
        prior[list(group)] = rng.dirichlet(np.ones(len(group)))
    return build_momdp(domain, query, rows, precision, prior=prior)


def drawn_outcome(domain, behavior, rng):
    """Return an outcome that names a part of the attributes, and the levels that it means."""
    levels = dict[str, int]()
    said = dict[str, object]()
    free = [name for name in domain.attributes if name not in domain.groups.get("g", ())]
    if domain.groups:
        values = domain.groups["g"]
        chosen = values[int(rng.integers(len(values)))]
        way = rng.integers(4)
        if way == 0:
            said["g"] = chosen
            levels |= {v: (LEVELS - 1 if v == chosen else 0) for v in values}
        elif way == 1 and behavior != "ask":
            said[chosen] = "no"
            levels[chosen] = 1
        elif way == 2 and behavior == "ask" and len(values) > 2:
            said[chosen] = False
            levels[chosen] = 0
    for name in free:
        if rng.random() < 0.5:
            yes = bool(rng.random() < 0.5)
            sure = behavior == "ask" or rng.random() < 0.5
            said[name] = yes if sure else ("yes" if yes else "no")
            levels[name] = {(1, 1): 3, (1, 0): 2, (0, 0): 1, (0, 1): 0}[int(yes), int(sure)]
    if behavior == "ask":
        return Outcome("here", answers=said), levels
    return Outcome("here", percepts=said), levels


def by_enumeration(momdp, counts):
    """Return Pr(value vector) (Y,) given counts (N,E,K) of percepts."""
    query = momdp.query
    mean = momdp.confusion  # (N,E,C,K)
    s = momdp.precision[..., None]
    n = counts.sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        known = xlogy(counts[:, :, None], mean).sum(axis=3)
        alpha = np.where(np.isinf(s), 1.0, s * mean)
        seen = counts[:, :, None] > 0
        drawn = np.where(seen, gammaln(alpha + counts[:, :, None]) - gammaln(alpha), 0).sum(axis=3)
        total = np.where(np.isinf(s[..., 0]), 1.0, s[..., 0])
        drawn += gammaln(total) - gammaln(total + n[:, :, None])
    likely = np.where(np.isinf(s[..., 0]), known, drawn).sum(axis=1)  # (N,C)
    with np.errstate(divide="ignore"):
        weight = np.log(momdp.latent_classes) + likely[:, None]  # (N,2,C)
    attribute = np.logaddexp.reduce(weight, axis=2)  # (N,2) ln Pr(percepts | truth)
    for group in map(list, query.groups):  # the V percepts of a group hold the evidence of V - 1
        attribute[group] *= 1 - 1 / len(group)
    grouped = {i for group in query.groups for i in group}
    log_prob = np.zeros(len(query.values))
    for y, values in enumerate(query.values):
        for i, value in enumerate(values):
            log_prob[y] += attribute[i, int(value)]
            if i in grouped:
                log_prob[y] += np.log(momdp.prior[i]) if value else 0.0
            else:
                log_prob[y] += np.log(momdp.prior[i] if value else 1.0 - momdp.prior[i])
    prob = np.exp(log_prob - log_prob.max())
    return prob / prob.sum()


@pytest.mark.quick(3)
@pytest.mark.parametrize("block", range(6))
def test_the_belief_is_that_of_an_independent_filter(block):
    parts = 0
    for seed in range(50):
        rng = np.random.default_rng((block, seed))
        domain = drawn_domain(rng)
        query = read_query(list(domain.attributes), domain)
        momdp = drawn_problem(domain, query, rng)
        task = Task("drawn", query, -1, "cup", ("drawn", seed))
        checker = OutcomeChecker(domain)
        session = Session(task, momdp, None, checker, Detections(domain)).start("here")
        counts = np.zeros((len(query), 3, LEVELS))
        for _ in range(8):
            e = int(rng.integers(3))
            session.command(unvalued(momdp, e))
            outcome, levels = drawn_outcome(domain, momdp.behavior_names[e], rng)
            session.observe(outcome)
            for name, level in levels.items():
                counts[query.attributes.index(name), e, level] += 1
            step = session.steps[-1]
            assert (step.observation is None) == (not levels)
            if levels:
                parts += 0 < len(levels) < len(query)
                expected = [levels.get(name, -1) for name in query.attributes]
                assert step.observation.tolist() == expected
                assert step.warning == ""
        np.testing.assert_allclose(session.belief.joint, by_enumeration(momdp, counts), atol=1e-12)
    assert parts > 100


def test_what_is_said_of_nothing_that_was_asked_is_told():
    rng = np.random.default_rng(0)
    domain = load_domain("toy")
    query = read_query(["red"], domain)
    momdp = build_momdp(domain, query, rng.dirichlet(np.ones(LEVELS), (1, 3, 2)))
    task = Task("drawn", query, -1, "cup", ("drawn",))
    session = Session(task, momdp, None, OutcomeChecker(domain), Detections(domain)).start("x0")
    session.command(unvalued(momdp, 0))
    session.observe(Outcome("x0", percepts={"heavy": True}))
    assert session.steps[-1].observation is None
    assert "nothing of what was asked" in session.steps[-1].warning
    np.testing.assert_array_equal(session.belief.positive, momdp.prior)


def excluded(domain):
    """Yield moves that a diagram excludes: state before, behavior, state after."""
    arrays = domain.diagram.compile(domain.behavior_names)
    states = domain.diagram.states[:-1]
    for (x, before), (y, after) in itertools.product(enumerate(states), repeat=2):
        for e, behavior in enumerate(domain.behavior_names):
            if arrays.legal[x, e] and x != y and not arrays.transition[e, x, y] > 0:
                yield before, behavior, after


@pytest.mark.parametrize("name", ["toy", "roc36", "cy101", "ispy32"])
def test_a_move_that_the_diagram_excludes_is_told_and_taken(name):
    domain = load_domain(name)
    query = read_query(list(domain.attributes[:1]), domain)
    rows = np.full((1, len(domain.behaviors), 2, LEVELS), 1 / LEVELS)
    momdp = build_momdp(domain, query, rows)
    moves = list(excluded(domain))
    assert moves
    for before, behavior, after in moves:
        task = Task("drawn", query, -1, "cup", ("drawn",))
        session = Session(task, momdp, None, OutcomeChecker(domain), Detections(domain))
        session.start(before)
        session.command(unvalued(momdp, domain.behavior_index(behavior)))
        with pytest.warns(UserWarning, match=f"{behavior} led from '{before}' to '{after}'"):
            session.observe(Outcome(after))
        assert f"'{after}'" in session.steps[-1].warning
        assert momdp.x_names[session.belief.x] == after


def test_a_failure_that_leaves_the_state_as_it_was_is_no_excluded_move(recwarn):
    domain = load_domain("toy")  # a look of the toy's always succeeds, by its diagram
    query = read_query(["red"], domain)
    momdp = build_momdp(domain, query, np.full((1, 3, 2, LEVELS), 1 / LEVELS))
    task = Task("drawn", query, -1, "cup", ("drawn",))
    session = Session(task, momdp, None, OutcomeChecker(domain), Detections(domain)).start("x0")
    for behavior in ("look", "lift"):
        session.command(unvalued(momdp, domain.behavior_index(behavior)))
        session.fail()
    assert not [w for w in recwarn if "excludes" in str(w.message)]
