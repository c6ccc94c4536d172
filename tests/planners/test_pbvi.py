"""PBVI meets known optima, and what it promises is a lower bound that its policy keeps."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from planner_rollouts import simulate

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import (
    MOMDP,
    Objective,
    Transition,
    build_momdp,
    initial_belief,
    report_value,
    update_belief,
)
from meal_bayes.momdp.reference import load_reference
from meal_bayes.planners import History
from meal_bayes.planners.point_based.pbvi import PBVI

QUICK = PBVI(points=40, rounds=2, sweeps=30, trials=30, steps=20)


def momdp_of(name, n, levels=2, seed=0, **options):
    domain, rng = load_domain(name), np.random.default_rng(seed)
    confusion = rng.dirichlet(np.ones(levels), (n, len(domain.behaviors), 2))
    return build_momdp(domain, Query(domain.attributes[:n]), confusion, **options)


def solve(momdp, solver=QUICK, seed=0):
    return solver.solve(momdp, np.random.default_rng(seed))


def acyclic(n, levels, seed, **options) -> MOMDP:
    """A diagram that comes to an end: look, then grasp or push, then shake; failures on the way."""
    behaviors = ("look", "grasp", "push", "shake")
    effects = (
        Effect("x0", "look", "x1", 0.9),
        Effect("x1", "grasp", "x2", 0.8),
        Effect("x1", "push", "x3", 0.5),
        Effect("x1", "push", "x2", 0.3, senses=False),
        Effect("x2", "shake", "x3", 0.95),
    )
    costs = (0.5, 2.0, 1.5, 4.0)
    rng, names = np.random.default_rng(seed), ("red", "heavy", "empty")[:n]
    domain = Domain(
        "acyclic",
        names,
        tuple(Behavior(b, c, ("all",)) for b, c in zip(behaviors, costs, strict=True)),
        TransitionDiagram(("x0", "x1", "x2", "x3", "term"), "x0", effects),
        report_reward=50.0,
    )
    rows = rng.dirichlet(np.ones(levels), (n, 4, 2))
    return build_momdp(domain, Query(names), rows, prior=rng.uniform(0.2, 0.8, n), **options)


def optimum(momdp: MOMDP) -> float:
    """Plain recursion over all histories; repeating a failed behavior is a geometric series."""

    @cache
    def value(x: int, history: tuple[tuple[int, tuple[int, ...]], ...]) -> float:
        belief = initial_belief(momdp)
        for e, levels in history:
            belief = update_belief(belief, momdp, Transition(e, x, np.array(levels)))
        best = report_value(momdp, belief)
        for e in range(momdp.n_behaviors):
            if not momdp.legal[x, e]:
                best = max(best, -momdp.cost[e]) if momdp.abstain else best
                continue
            bonus = np.stack([1 - belief.positive, belief.positive], axis=1) * momdp.bonus[:, e]
            total, idle = bonus.sum() - momdp.cost[e], 0.0
            for target, p in enumerate(momdp.transition[e, x]):
                felt = p * momdp.observation_probability[e, x, target]
                if target == x:
                    idle += p
                elif p:
                    total += momdp.discount * (p - felt) * value(target, history)
                    for levels in np.ndindex((momdp.levels,) * len(momdp.query)):
                        likely = np.prod(
                            [
                                (1 - b) * momdp.confusion[i, e, 0, z]
                                + b * momdp.confusion[i, e, 1, z]
                                for i, (b, z) in enumerate(
                                    zip(belief.positive, levels, strict=True)
                                )
                            ]
                        )
                        after = value(target, (*history, (e, levels)))
                        total += momdp.discount * felt * likely * after
            best = max(best, total / (1 - momdp.discount * idle))
        return best

    return value(momdp.start, ())


@pytest.mark.parametrize(
    ("n", "levels", "options"),
    [
        (1, 2, {}),
        (2, 2, {"objective": Objective(discount=1.0)}),
        (1, 4, {"objective": Objective(discount=0.8)}),
        (2, 2, {"objective": Objective(incorrect=-2000.0, correct=10.0, abstain=True)}),
    ],
)
def test_brute_force_agrees(n, levels, options):
    solver = PBVI(points=2000, rounds=2, sweeps=20, tolerance=0, trials=500, spacing=1e-6)
    for seed in range(3):
        momdp = acyclic(n, levels, seed, **options)
        assert solve(momdp, solver).lower_bound == pytest.approx(optimum(momdp), abs=1e-9)


def test_shaped_rewards_agree_with_brute_force():
    momdp = acyclic(2, 2, 0)
    bonus = np.random.default_rng(1).uniform(-3, 3, momdp.bonus.shape)
    momdp = replace(momdp, bonus=bonus)
    solver = PBVI(points=2000, rounds=2, sweeps=20, tolerance=0, trials=500, spacing=1e-6)
    assert solve(momdp, solver).lower_bound == pytest.approx(optimum(momdp), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "at_least", "upper"),
    [("A1", 441.25, 441.3), ("A2", 387.2, 387.7)],  # SARSOP 60 s: 441.298 and 384.6
)
def test_reference_models_are_solved_within_known_bounds(reference, name, at_least, upper):
    momdp = load_reference(reference)[name]
    policy = solve(momdp, PBVI())
    assert at_least < policy.lower_bound < upper
    found = simulate(momdp, policy, 200, np.random.default_rng(1))
    assert found.value > policy.lower_bound - 4 * found.value_se
    assert found.value < upper + 4 * found.value_se


def test_three_attributes_beyond_sarsop(reference):
    """SARSOP comes to 108.7 in a minute; the upper bound is 243.2."""
    solver = PBVI(points=120, rounds=2, sweeps=25)
    assert 200 < solve(load_reference(reference)["A3"], solver).lower_bound < 243.2


def test_the_policy_keeps_its_promise():
    momdp = momdp_of("roc36", 2, seed=3, objective=Objective(abstain=True))
    policy = solve(momdp)
    found = simulate(momdp, policy, 200, np.random.default_rng(2))
    assert found.value > policy.lower_bound - 4 * found.value_se


def test_equal_generators_give_equal_policies():
    momdp = momdp_of("roc36", 2)
    one, same, other = (solve(momdp, seed=seed).alpha for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.vectors, same.vectors)
    np.testing.assert_array_equal(one.action, same.action)
    assert one.vectors.shape != other.vectors.shape or (one.vectors != other.vectors).any()


def test_more_sweeps_never_lower_the_bound():
    momdp = momdp_of("roc36", 2, seed=1)
    bounds = [solve(momdp, replace(QUICK, sweeps=sweeps)).lower_bound for sweeps in (1, 3, 30)]
    assert bounds == sorted(bounds)
    assert bounds[0] < bounds[-1]


def test_the_time_is_kept():
    momdp = momdp_of("roc36", 3)
    policy = solve(momdp, PBVI(seconds=1e-9))
    assert policy.lower_bound == pytest.approx(report_value(momdp, initial_belief(momdp)))


@pytest.mark.parametrize("name", ["toy", "roc36", "roc36_published", "ispy32", "cy101"])
@pytest.mark.parametrize("levels", [2, 4])
def test_decisions_are_legal_everywhere(name, levels):
    for n, abstain in ((1, True), (2, False)):
        if n > len(load_domain(name).attributes):
            continue
        momdp = momdp_of(name, n, levels, objective=Objective(abstain=abstain), limit=2, prior=0.3)
        policy, rng = solve(momdp), np.random.default_rng(0)
        belief = initial_belief(momdp)
        for _ in range(15):
            decision = policy.decide(History(belief), rng)
            legal = np.flatnonzero(momdp.legal[belief.x])
            assert decision.values.shape == (momdp.n_behaviors + 1,)
            assert not np.isinf(decision.values).any()
            if decision.action < momdp.n_behaviors and decision.action not in legal:
                assert abstain
                assert momdp.transition[decision.action, belief.x, momdp.terminal] == 1
                illegal = momdp.cost[~momdp.legal[belief.x]]
                assert momdp.cost[decision.action] == illegal.min()
            action = decision.action if decision.action in legal else int(rng.choice(legal))
            x = int(rng.choice(np.flatnonzero(momdp.transition[action, belief.x])))
            percept = (
                rng.choice([0, levels - 1], n)
                if momdp.observation_probability[action, belief.x, x]
                else None
            )
            belief = update_belief(belief, momdp, Transition(action, x, percept))


def test_certain_attributes_and_deciding_percepts():
    domain = load_domain("toy")
    deciding = np.tile(np.eye(2), (2, 3, 1, 1))
    momdp = build_momdp(domain, Query(domain.attributes), deciding, prior=[0.5, 1.0])
    policy = solve(momdp)
    assert policy.lower_bound == pytest.approx(-1 + 0.99 * 100)  # one look tells all
    belief = update_belief(
        initial_belief(momdp), momdp, Transition(0, 0, np.array([0, 1], dtype=np.int8))
    )
    decision = policy.decide(History(belief), np.random.default_rng(0))
    assert decision.action == momdp.n_behaviors + 0b01


@pytest.mark.parametrize(
    ("momdp", "found"),
    [
        (momdp_of("toy", 1, precision=4.0), "precision=inf"),
        (
            build_momdp(
                load_domain("toy"),
                Query(("red",)),
                np.full((1, 3, 4, 2), 0.5),
                latent_classes=np.full((1, 2, 4), 0.25),
            ),
            "several latent classes",
        ),
        (momdp_of("ispy32", 9), "9 attributes make .* outcome matrices"),
    ],
)
def test_what_vectors_cannot_hold_is_told(momdp, found):
    with pytest.raises(SettingsError, match=found):
        solve(momdp)


@pytest.mark.parametrize(
    "change",
    [
        {"points": 0}, {"rounds": 0}, {"sweeps": 0}, {"trials": 0}, {"steps": 0},
        {"tolerance": -1.0}, {"spacing": 0.0}, {"seconds": 0.0}, {"tolerance": float("nan")},
    ],
)  # fmt: skip
def test_settings_out_of_range_are_told(change):
    with pytest.raises(SettingsError, match="PBVI needs"):
        PBVI(**change)
