"""Plans on diagrams of several outcomes: what a plan is worth is never more than the optimum."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import Domain, load_domain, read_event, read_query
from meal_bayes.momdp import Objective, Transition, build_momdp, initial_belief, update_belief
from meal_bayes.planners import POMCP, Factored, Greedy, History, OpenLoop
from meal_bayes.planners.momdp_arrays import arrays_of, dynamics_of
from meal_bayes.planners.plans.library import plan_library
from meal_bayes.planners.plans.paths import plan_steps
from meal_bayes.planners.plans.values import plan_values

COST = 1.0


def domain_of(effects, behaviors, states, attributes=("full", "red")):
    """A domain by its effects (from, do, to, probability, senses)."""
    keys = ("from", "do", "to", "probability", "senses")
    return load_domain(
        {
            "name": "several outcomes",
            "attributes": list(attributes),
            "report_reward": 100.0,
            "behaviors": [
                {"name": name, "cost": cost, "modalities": ["all"]}
                for name, cost in behaviors.items()
            ],
            "diagram": {
                "states": list(states),
                "start": states[0],
                "effects": [dict(zip(keys, effect, strict=True)) for effect in effects],
            },
        }
    )


def drawn_domain(seed) -> Domain:
    """Draw states, behaviors and outcomes: failures, percepts lost, states without a way back."""
    rng = np.random.default_rng(seed)
    states = [f"x{k}" for k in range(rng.integers(2, 5))]
    behaviors = {f"do{e}": float(rng.uniform(0.5, 8.0)) for e in range(rng.integers(2, 5))}
    effects = []
    for state in states:
        for name in behaviors:
            if rng.random() < 0.3 and name != "do0" and state != states[0]:
                continue
            number = int(rng.integers(1, min(3, len(states)) + 1))
            ends = rng.choice(states, number, replace=False)
            if name == "do0":  # by which every state is reached
                after = states[(states.index(state) + 1) % len(states)]
                ends = np.unique([*ends[1:], after])
                number = len(ends)
            chance = rng.dirichlet(np.ones(number)) * rng.choice([1.0, 0.8])
            senses = rng.random(number) < 0.7
            for end, p, sensed in zip(ends, chance, senses, strict=True):
                effects.append((state, name, str(end), float(p), bool(sensed)))
    return domain_of(effects, behaviors, states)


def model_of(domain, question="full", rate=0.8, **objective):
    """The MOMDP of percepts that are right by chance, each behavior by its own."""
    query = (read_event if question.endswith("?") else read_query)(question, domain)
    rng = np.random.default_rng(len(domain.behaviors))
    right = rng.uniform(0.6, 0.95, (len(query.attributes), len(domain.behaviors)))
    right = right if rate is None else np.full(right.shape, rate)
    confusion = np.stack(
        [np.stack([right, 1 - right], axis=-1), np.stack([1 - right, right], axis=-1)], axis=2
    )
    return build_momdp(domain, query, confusion, objective=Objective(**objective))


def beliefs_of(momdp, number, rng):
    """Beliefs in every x, after percepts that are drawn."""
    for x in range(len(momdp.x_names)):
        belief = initial_belief(momdp).at(x)
        yield belief
        for _ in range(number):
            e = int(rng.integers(momdp.n_behaviors))
            percept = rng.integers(0, 2, len(momdp.query.attributes)).astype(np.int8)
            belief = update_belief(belief, momdp, Transition(e, x, percept))
            yield belief


@pytest.fixture(scope="module")
def dead_end():
    """A look that tells all with .6, else leads to where nothing can be done."""
    effects = [("here", "look", "here", 0.6, True), ("here", "look", "gone", 0.4, False)]
    return domain_of(effects, {"look": COST}, ["here", "gone"])


def test_a_dead_end_is_counted(dead_end):
    """.6 of a right answer (100), .4 of a guess (0), less the look: 59, not 99."""
    momdp = model_of(dead_end, rate=1.0, discount=1.0)
    value = plan_values(
        arrays_of(momdp), plan_library(momdp, arrays_of(momdp)), initial_belief(momdp)
    )
    assert value.scratch.value[0] == pytest.approx(59.0, abs=0.01)
    bound = Factored().solve(momdp, np.random.default_rng(0)).upper_bound
    assert value.scratch.value[0] <= bound + 1e-6


def test_who_drops_an_object_grasps_it_again():
    """Shaking at 2 s drops with .2, and to grasp takes 3: (2 + .2 x 3) / .8 = 3.25 s a shake."""
    effects = [
        ("table", "grasp", "held", 1.0, False),
        ("held", "shake", "held", 0.8, True),
        ("held", "shake", "table", 0.2, False),
    ]
    domain = domain_of(effects, {"grasp": 3.0, "shake": 2.0}, ["table", "held"])
    steps = plan_steps(dynamics_of(model_of(domain, discount=1.0)))
    assert steps.cost[1, 1] == pytest.approx(3.25)
    assert steps.discount[1, 1] == pytest.approx(1.0)
    assert steps.lost[1, 1] == 0.0
    assert steps.cost[0, 0] == 3.0


@pytest.mark.parametrize("discount", [1.0, 0.97])
@pytest.mark.parametrize("seed", range(12))
def test_steps_sum_up_what_trying_again_comes_to(seed, discount):
    """Against episodes that follow the policy: cost, discount of the end, and getting lost."""
    dynamics = dynamics_of(model_of(drawn_domain(seed), discount=discount))
    steps = plan_steps(dynamics)
    total = steps.discount + steps.lost
    legal = dynamics.step["legal"]
    assert (total[legal] <= 1 + 1e-9).all()
    if discount == 1.0:  # it ends one way or the other
        np.testing.assert_allclose(total[legal], 1.0)
    one = np.count_nonzero(dynamics.branch["p"], axis=2) == 1
    np.testing.assert_array_equal(steps.cost[one], dynamics.step["cost"][one])
    np.testing.assert_array_equal(steps.discount[one], dynamics.step["discount"][one])
    assert not steps.lost[one].any()
    assert (steps.cost[legal] >= dynamics.step["cost"][legal] - 1e-12).all()


@pytest.mark.quick(4)
@pytest.mark.parametrize("question", ["full", "full, red", "Is it full and not red?"])
@pytest.mark.parametrize("seed", range(30))
def test_a_plan_is_worth_no_more_than_the_certified_bound(seed, question):
    domain = drawn_domain(seed)
    momdp = model_of(domain, question, rate=None, discount=0.99)
    policy = POMCP(points=3000).solve(momdp, np.random.default_rng(0))
    rng = np.random.default_rng(seed)
    for belief in beliefs_of(momdp, 2, rng):
        lower = plan_values(policy.model, policy.plans, belief).scratch.value
        upper = policy.tables.priced_bounds(belief.x, belief.positive)
        assert (lower[np.isfinite(lower)] <= upper[np.isfinite(lower)] + 1e-6).all()
        decision = policy.decide(History(belief), np.random.default_rng(0))
        assert decision.gap is None or decision.gap >= 0.0


def test_planners_do_not_count_on_luck(dead_end):
    """At .993 a look that tells all would bring 1.4; it comes with .6, and costs 1 in any case."""
    momdp = replace(model_of(dead_end, rate=1.0, discount=1.0), prior=np.array([0.993]))
    belief = initial_belief(momdp)
    for solver in (OpenLoop(), POMCP(50), Factored(), Greedy()):
        decision = solver.solve(momdp, np.random.default_rng(0)).decide(
            History(belief), np.random.default_rng(0)
        )
        assert decision.action >= momdp.n_behaviors
