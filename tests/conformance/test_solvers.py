"""What every solver owes: legal, repeatable, and an answer at every belief that can be reached."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram, load_domain
from meal_bayes.momdp import Objective, build_momdp, initial_belief
from meal_bayes.planners import POMCP, Greedy, History, Predefined, Random, RandomLegal, Untouched
from meal_bayes.planners.plans.policy import OpenLoop
from meal_bayes.planners.table.policy import Factored
from meal_bayes.testing import check_solver

DOMAINS = ["toy", "roc36", "roc36_published", "ispy32", "cy101"]
LIMIT = 2  # recordings: used up soon


def solvers(domain):
    sequence = domain.predefined or domain.behavior_names
    return [
        Random(),
        RandomLegal(30.0),
        Predefined(sequence),
        Predefined(sequence, persistent=True),
        Untouched(),
        Greedy(),
        OpenLoop(),
        POMCP(0),
        POMCP(12),
        POMCP(12, points=0),
    ]


OFFLINE = [Factored(points=2000)]  # for all beliefs beforehand: known rows, one class a truth


def momdp_of(domain, n, levels, seed, *, n_classes=1, **options):
    rng = np.random.default_rng(seed)
    e = len(domain.behaviors)
    confusion = rng.dirichlet(np.ones(levels), (n, e, max(2, n_classes)))
    chosen = rng.permutation(len(domain.attributes))[:n]
    query = Query(tuple(domain.attributes[i] for i in chosen))
    shares = rng.dirichlet(np.ones(n_classes), (n, 2)) if n_classes > 1 else None
    return build_momdp(domain, query, confusion, latent_classes=shares, **options)


def follow(momdp, solver, seed, steps=12):
    check_solver(solver, [momdp], seed=seed, steps=steps)


def cases(largest=np.inf):
    """List domains, attributes and levels; of at most so many percept vectors."""
    out = []
    for name in DOMAINS:
        for n in (1, 2, 3):
            marks = [pytest.mark.long] * (n == 2 or name not in ("toy", "roc36"))
            if n <= len(load_domain(name).attributes):
                out += [
                    pytest.param(name, n, k, id=f"{name}-N{n}-K{k}", marks=marks)
                    for k in (2, 4)
                    if k**n <= largest
                ]
    return out


@pytest.mark.quick(3)
@pytest.mark.parametrize(("name", "n", "levels"), cases())
def test_every_solver_everywhere(name, n, levels):
    domain = load_domain(name)
    hard = {"precision": 4.0, "n_classes": 2}
    for seed, solver in enumerate(solvers(domain)):
        for options in (
            (hard, {}) if isinstance(solver, POMCP | OpenLoop) else ((hard, {})[seed % 2],)
        ):
            goal = Objective(discount=1.0 if options else 0.99, abstain=seed % 3 == 0)
            both = options | {"limit": LIMIT, "prior": 0.3, "objective": goal}
            follow(momdp_of(domain, n, levels, seed, **both), solver, seed)


@pytest.mark.quick(3)
@pytest.mark.parametrize(("name", "n", "levels"), cases(largest=16))
def test_offline_solvers(name, n, levels):
    domain = load_domain(name)
    for seed, solver in enumerate(OFFLINE):
        for abstain in (False, True):
            options = {
                "limit": (LIMIT, np.inf)[abstain],
                "prior": 0.3,
                "objective": Objective(abstain=abstain),
            }
            follow(momdp_of(domain, n, levels, seed, **options), solver, seed)


@pytest.mark.quick(1)
@pytest.mark.parametrize("abstain", [False, True])
@pytest.mark.parametrize("precision", [4.0, np.inf])
@pytest.mark.parametrize("name", ["toy", "roc36", pytest.param("ispy32", marks=pytest.mark.long)])
def test_certain_beliefs(name, precision, abstain):
    """Percepts that decide, priors that are sure: log-odds of plus and minus infinity."""
    domain = load_domain(name)
    e = len(domain.behaviors)
    deciding = np.tile(np.eye(2), (2, e, 1, 1))
    mixed = np.tile([[1.0, 0.0], [0.3, 0.7]], (2, e, 1, 1))
    query = Query(domain.attributes[:2])
    for confusion, prior in ((deciding, 0.5), (mixed, [0.5, 1.0]), (mixed, [1.0, 0.0])):
        goal = Objective(abstain=abstain)
        momdp = build_momdp(
            domain, query, confusion, precision, prior=prior, limit=LIMIT, objective=goal
        )
        known = np.isinf(precision)
        for seed, solver in enumerate([*solvers(domain), *OFFLINE * bool(known)]):
            follow(momdp, solver, seed, steps=6)


def test_deciding_percepts_of_objects_that_may_deceive():
    """Of the objects, one in twenty seems to have the other value."""
    domain = load_domain("toy")
    confusion = np.tile(np.eye(2)[[0, 1, 1, 0]], (2, len(domain.behaviors), 1, 1))
    classes = np.tile([[0.95, 0.05, 0, 0], [0, 0, 0.05, 0.95]], (2, 1, 1))
    momdp = build_momdp(domain, Query(domain.attributes[:2]), confusion, latent_classes=classes)
    for seed, solver in enumerate(solvers(domain)):
        follow(momdp, solver, seed, steps=6)


def test_certain_reports_are_right():
    domain = load_domain("roc36")
    momdp = momdp_of(
        domain, 3, 2, 0, prior=[1.0, 0.0, 1.0], objective=Objective(abstain=True), limit=LIMIT
    )
    for solver in (Greedy(), OpenLoop(), POMCP(0), POMCP(12), *OFFLINE):
        rng = np.random.default_rng(0)
        action = solver.solve(momdp, rng).decide(History(initial_belief(momdp)), rng).action
        assert action == momdp.n_behaviors + 0b101


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", DOMAINS)
def test_used_up_recordings(name):
    """Every percept has been had: whatever is decided tells nothing more, so values report."""
    domain = load_domain(name)
    momdp = momdp_of(domain, 1, 2, 3, limit=0, objective=Objective(discount=1.0))
    momdp = replace(momdp, limit=np.zeros(momdp.n_behaviors))  # a person's answers too
    for x in range(momdp.terminal):
        history = History(initial_belief(momdp).at(x))
        for solver in solvers(domain):
            rng = np.random.default_rng(4)
            check_solver(solver, [replace(momdp, start=x)], steps=1)
            decision = solver.solve(momdp, rng).decide(history, rng)
            if isinstance(solver, Greedy | OpenLoop | POMCP):
                assert decision.action >= momdp.n_behaviors


def odd_domains():
    """Return what own tables may hold: a dead end, a free behavior, a fork, a single behavior."""
    look = Behavior("look", 1.0, ("color",))
    drop = Behavior("drop", 2.0, ("audio",))
    free = Behavior("glance", 0.0, ("color",))
    dead_end = TransitionDiagram(
        ("x0", "x1", "term"),
        "x0",
        (Effect("x0", "look", "x0", 0.5), Effect("x0", "drop", "x1", 0.9)),
    )
    fork = TransitionDiagram(
        ("x0", "x1", "x2", "term"),
        "x0",
        (
            Effect("x0", "look", "x0"),
            Effect("x0", "drop", "x1", 0.4),
            Effect("x0", "drop", "x2", 0.4, senses=False),
            Effect("x2", "look", "x0", 0.5, senses=False),
        ),
        illegal="stay",
    )
    single = TransitionDiagram(("x0", "term"), "x0", (Effect("*", "glance", "*", 0.3),))
    return [
        Domain("dead_end", ("red", "heavy"), (look, drop), dead_end),
        Domain("fork", ("red", "heavy"), (look, drop), fork),
        Domain("single", ("red",), (free,), single),
    ]


@pytest.mark.long
@pytest.mark.parametrize("limit", [2, np.inf])
@pytest.mark.parametrize("discount", [0.9, 1.0])
def test_odd_domains(limit, discount):
    for domain in odd_domains():
        for abstain in (False, True):
            options = {"limit": limit, "objective": Objective(discount=discount, abstain=abstain)}
            for seed, solver in enumerate(solvers(domain)):
                n = 1 + seed % len(domain.attributes)
                follow(momdp_of(domain, n, 2, seed, **options), solver, seed)


@pytest.mark.parametrize("n", [5, pytest.param(81, marks=pytest.mark.long)])
def test_large_queries(n):
    domain = load_domain("ispy32")
    momdp = momdp_of(domain, n, 2, 5, limit=LIMIT, objective=Objective(abstain=True))
    for seed, solver in enumerate(solvers(domain)):
        follow(momdp, solver, seed, steps=2)


def test_shaped_rewards():
    domain = load_domain("roc36")
    momdp = momdp_of(domain, 2, 2, 6, limit=LIMIT)
    bonus = np.random.default_rng(6).uniform(-10, 10, momdp.bonus.shape)
    for seed, solver in enumerate([*solvers(domain), *OFFLINE]):
        follow(replace(momdp, bonus=bonus), solver, seed)
