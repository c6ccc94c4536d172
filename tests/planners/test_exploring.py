"""What exploring is paid: for percepts, so many of a trial, apart from what an answer brings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rollout import simulate

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import Objective, build_momdp, flatten, initial_belief, write_pomdp
from meal_bayes.planners import POMCP, Factored, Greedy, History, OpenLoop

RNG = np.random.default_rng(0)  # of solvers that draw nothing

SOLVERS = {
    "open loop": OpenLoop(),
    "plans alone": POMCP(0),
    "search": POMCP(40),
    "sampled returns": POMCP(40, backup="sampled"),
}
REWARD = 100.0


def domain_of(success, costs):
    """Build a domain of one state, where each behavior may fail."""
    names = [f"b{i}" for i in range(len(costs))]
    behaviors = tuple(Behavior(name, cost, ("m",)) for name, cost in zip(names, costs, strict=True))
    effects = tuple(
        Effect("x0", name, "x0", float(p)) for name, p in zip(names, success, strict=True)
    )
    diagram = TransitionDiagram(states=("x0", "term"), start="x0", effects=effects)
    return Domain("d", ("red", "full"), behaviors, diagram, report_reward=REWARD)


def shaped(domain, rows, pay, bonus_limit, **options):
    """Build a problem in which a percept of each behavior is paid (E,), so many of a trial."""
    n = len(rows)
    momdp = build_momdp(domain, Query(domain.attributes[:n]), rows, **options)
    bonus = np.zeros_like(momdp.bonus)
    bonus[0] = np.asarray(pay, float)[:, None]
    return replace(momdp, bonus=bonus, bonus_limit=np.full(momdp.n_behaviors, float(bonus_limit)))


def decided(solver, momdp, seed=0):
    rng = np.random.default_rng(seed)
    return solver.solve(momdp, rng).decide(History(initial_belief(momdp)), rng)


@pytest.mark.quick(5)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("success", [1.0, 0.5, 0.2])
@pytest.mark.parametrize(("cost", "pay"), [(3.0, 5.0), (3.0, 40.0), (0.5, 0.75)])
def test_a_percept_is_paid_and_every_execution_costs(solver, success, cost, pay):
    """With nothing to learn for the question a behavior is worth b - c / p beyond the answer."""
    rows = np.full((1, 1, 2, 2), 0.5)
    objective = Objective(discount=1.0)
    momdp = shaped(domain_of([success], [cost]), rows, [pay], 1, objective=objective)
    decision = decided(SOLVERS[solver], momdp)
    answer = decision.values[-1]
    assert decision.total[0] - answer == pytest.approx(pay - cost / success, abs=1e-9)
    assert decision.bonus[0] == pytest.approx(pay, abs=1e-9)
    assert (decision.action == 0) == (pay > cost / success)


@st.composite
def problems(draw):
    """Draw a problem with a bonus, and how often it is paid."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    e = draw(st.integers(1, 3))
    n = draw(st.integers(1, 2))
    bonus_limit = draw(st.sampled_from([0, 1, 2, 4]))
    levels = draw(st.sampled_from([2, 4]))
    domain = domain_of(rng.choice([1.0, 0.9, 0.5], e), rng.uniform(0.5, 10.0, e))
    precision = draw(st.sampled_from([np.inf, 5.0]))
    rows = rng.dirichlet(np.ones(levels), (n, e, 2))
    limit = draw(st.sampled_from([np.inf, 5]))
    objective = Objective(
        discount=draw(st.sampled_from([0.99, 1.0])), abstain=bool(rng.random() < 0.5)
    )
    pay = rng.choice([0.0, 1.0, 20.0, 1000.0], e)
    return shaped(
        domain, rows, pay, bonus_limit, precision=precision, limit=limit, objective=objective
    )


@pytest.mark.parametrize("solver", SOLVERS)
@given(momdp=problems())
def test_no_value_of_an_answer_is_above_its_reward(solver, momdp):
    decision = decided(SOLVERS[solver], momdp)
    assert np.nanmax(decision.values) <= REWARD + 1e-9
    assert (decision.bonus >= -1e-12).all()
    assert decision.bonus[-1] == 0.0
    assert all(edge.value <= REWARD + 1e-9 for edge in decision.tree)
    most = int(np.nanargmax(decision.total))
    assert min(decision.action, momdp.n_behaviors) == most
    plain = decided(SOLVERS[solver], replace(momdp, bonus=np.zeros_like(momdp.bonus)))
    assert not plain.bonus.any()


@pytest.mark.parametrize("solver", SOLVERS)
@given(momdp=problems())
def test_no_behavior_is_paid_more_often_than_the_problem_says(solver, momdp):
    """What tells nothing is executed for its pay alone, and so no more often than it is paid."""
    idle = replace(momdp, confusion=np.full_like(momdp.confusion, 1 / momdp.levels))
    policy = SOLVERS[solver].solve(idle, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    counts = []

    class Counted:
        def decide(self, history, rng):
            counts.append(history.belief.percept_counts[0].sum(axis=1))
            return policy.decide(history, rng)

    simulate(idle, Counted(), 2, rng)
    assert (np.max(counts, axis=0) <= np.minimum(idle.bonus_limit, idle.limit)).all()


@given(momdp=problems())
def test_who_cannot_count_percepts_refuses(momdp):
    if not momdp.bonus_runs_out:
        return
    known = replace(momdp, precision=np.full_like(momdp.precision, np.inf))
    for use in (lambda: Factored().solve(known, RNG), lambda: flatten(known)):
        with pytest.raises(SettingsError, match="bonus would be unlimited"):
            use()
    with pytest.raises(SettingsError, match="bonus would be unlimited"):
        write_pomdp(known, "never.pomdp")
    assert POMCP().solve(known, RNG).tables is None


def test_baselines_are_paid_nothing():
    momdp = shaped(domain_of([1.0], [1.0]), np.full((1, 1, 2, 2), 0.5), [50.0], 1)
    assert not decided(Greedy(), momdp).bonus.any()
