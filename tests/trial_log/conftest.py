"""Random small trials and their comparison, for all tests of the log."""

import dataclasses
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from meal_bayes.domain import Domain, Query, load_domain
from meal_bayes.momdp import (
    MOMDP,
    Transition,
    build_momdp,
    initial_belief,
    update_belief,
    with_joint_prior,
)
from meal_bayes.planners import Decision, TreeEdge
from meal_bayes.trials import Step, Task, Trial


def make_momdp(domain: Domain, n: int, rng: np.random.Generator, levels: int = 4) -> MOMDP:
    query = Query(tuple(rng.choice(domain.attributes, n, replace=False).tolist()))
    e = len(domain.behaviors)
    c = int(rng.integers(2, 4))  # latent classes
    confusion = rng.dirichlet(np.ones(levels), (n, e, c))
    precision = rng.gamma(2.0, 5.0, (n, e, c))
    precision[rng.random(precision.shape) < 0.3] = np.inf
    latent_classes = None if c == 2 else rng.dirichlet(np.ones(c), (n, 2))
    prior = rng.uniform(0.05, 0.95, n)
    momdp = build_momdp(
        domain, query, confusion, precision, prior=prior, latent_classes=latent_classes, limit=5.0
    )
    # Of one in three problems attributes exclude or imply each other.
    if n > 3 or rng.random() > 0.3:
        return momdp
    return with_joint_prior(momdp, rng.dirichlet(np.ones(query.n_values)))


def make_tree(momdp: MOMDP, edges: int, rng: np.random.Generator) -> tuple[TreeEdge, ...]:
    e = momdp.n_behaviors
    n = len(momdp.query)
    first = [TreeEdge(1, -1, a, (), int(rng.integers(1000)), rng.normal()) for a in range(e + 1)]
    second = [
        TreeEdge(
            2,
            int(rng.integers(e)),
            int(rng.integers(e + 1)),
            tuple(rng.integers(momdp.levels, size=n).tolist()) if rng.random() < 0.8 else (),
            int(rng.integers(300)),
            rng.normal(0, 100),
        )
        for _ in range(edges)
    ]
    return (*first, *second)


def make_decision(
    momdp: MOMDP, action: int, rng: np.random.Generator, edges: int | None
) -> Decision:
    values = rng.normal(0, 100, momdp.n_behaviors + 1)
    values[rng.random(len(values)) < 0.2] = np.nan
    visits = rng.integers(0, 1000, len(values))
    tree = () if edges is None else make_tree(momdp, edges, rng)
    return Decision(action, values, np.abs(values) / 10, visits, tree, int(visits.sum()))


def make_trial(
    momdp: MOMDP, rng: np.random.Generator, *, steps: int = 4, edges: int | None = 10
) -> Trial:
    """Behaviors at random, then a report (or none), with beliefs as the filter gives them."""
    n = len(momdp.query)
    e = momdp.n_behaviors
    first = initial_belief(momdp)
    made = list[Step]()
    belief = first
    for _ in range(steps):
        action = int(rng.integers(e))
        x = belief.x
        next_x = int(rng.integers(momdp.terminal))
        percept = rng.integers(momdp.levels, size=n).astype(np.int8)
        senses = momdp.observation_probability[action].any() and rng.random() < 0.8
        percept = percept if senses else None
        if senses and (momdp.confusion[np.arange(n), action, :, percept] == 0).any():
            percept = None
        belief = update_belief(belief, momdp, Transition(action, next_x, percept))
        cost = float(momdp.cost[action])
        decision = make_decision(momdp, action, rng, edges)
        made.append(Step(x, decision, next_x, percept, cost, -cost, belief))
    report = None
    if rng.random() < 0.8:
        report = rng.random(n) < 0.5
        decision = make_decision(momdp, e + momdp.query.index_of(report), rng, edges)
        last = belief.at(momdp.terminal)
        made.append(Step(belief.x, decision, momdp.terminal, None, 0.0, -momdp.correct, last))
    index = int(rng.integers(100))
    task = Task(f"task {index}", momdp.query, index, f"object {index}", ("offline", index, 7))
    return Trial(task, "bayes", momdp, first, tuple(made), rng.random(n) < 0.5, report)


def make_trials(
    count: int, seed: int = 0, *, domain: str = "toy", n: int = 2, steps: int = 4, edges: int = 10
) -> list[Trial]:
    """Trials, every two of the same MOMDP."""
    rng = np.random.default_rng(seed)
    table = load_domain(domain)
    trials = list[Trial]()
    for index in range(count):
        momdp = trials[-1].momdp if index % 2 else make_momdp(table, n, rng)
        trials.append(make_trial(momdp, rng, steps=steps, edges=edges))
    return trials


def equal(left: object, right: object) -> bool:
    """Whether two values are the same through and through, NaN equal to NaN."""
    if dataclasses.is_dataclass(left):
        names = [field.name for field in dataclasses.fields(left) if field.compare]
        return type(left) is type(right) and all(
            equal(getattr(left, name), getattr(right, name)) for name in names
        )
    if isinstance(left, np.ndarray):
        return (
            isinstance(right, np.ndarray)
            and left.dtype == right.dtype
            and np.array_equal(left, right, equal_nan=left.dtype.kind == "f")
        )
    if isinstance(left, dict) and isinstance(right, dict):
        return list(left) == list(right) and all(equal(left[name], right[name]) for name in left)
    if isinstance(left, tuple) and isinstance(right, tuple):
        if left and isinstance(left[0], TreeEdge) and left == right:
            return True  # quick; NaN needs the long way
        return len(left) == len(right) and all(map(equal, left, right))
    return left == right or (left != left and right != right)  # noqa: PLR0124  NaN


@pytest.fixture(scope="session")
def make() -> SimpleNamespace:
    """The makers of random trials."""
    return SimpleNamespace(momdp=make_momdp, trial=make_trial, trials=make_trials, equal=equal)


@pytest.fixture
def header() -> dict[str, object]:
    return {"config": {"dataset": "toy", "agents": ["bayes"], "trials": 3}, "seed": 7}


@pytest.fixture(scope="session")
def outcome_of() -> Callable[[Callable[[], object]], object]:
    """Call and give the result, or the exception where there is one."""

    def call(action: Callable[[], object]) -> object:
        try:
            return action()
        except Exception as fault:
            return fault

    return call
