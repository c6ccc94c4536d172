"""Plans of coupled questions against exact solutions: values and errors that can be believed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.domain import Event, Query, domain_from_table
from meal_bayes.momdp import Objective, build_momdp, initial_belief, with_joint_prior
from meal_bayes.planners import POMCP, History, OpenLoop
from meal_bayes.planners.plans import coupled

WITHIN = 4.0  # standard errors


def problem(seed, *, levels=2, finite=False, yes_or_no=False, abstain=False):
    """Draw a question about two or three attributes that a joint prior couples."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 4)) if levels == 2 else 2
    domain = domain_from_table({
        "name": "drawn", "attributes": ["a", "b", "c"], "report_reward": 100.0,
        "behaviors": [
            {"name": name, "cost": float(rng.uniform(1, 6)), "modalities": ["camera"]}
            for name in ("look", "lift")
        ],
        "diagram": {
            "states": ["table", "hand"], "start": "table", "effects": [
                {"from": "table", "do": "look", "to": "table"},
                {"from": "table", "do": "lift", "to": "hand", "probability": 0.9},
                {"from": "hand", "do": "look", "to": "hand"},
            ],
        },
    })  # fmt: skip
    event = Event(tuple((rng.random(n) < 0.5).tolist()), bool(rng.integers(2)))
    momdp = build_momdp(
        domain,
        Query(domain.attributes[:n], event=event if yes_or_no else None),
        rng.dirichlet(np.ones(levels), (n, 2, 2)),
        rng.uniform(0.5, 20.0, (n, 2, 2)) if finite else np.inf,
        limit=1 if levels > 2 or n > 2 else 2,
        objective=Objective(abstain=abstain),
    )
    return with_joint_prior(momdp, rng.dirichlet(np.full(2**n, 0.5)))


def coupled_expectimax(small, momdp):
    """Solve a question with a joint prior by plain recursion over all values."""

    class Coupled(small.expectimax):
        def chances(self, seen):
            """Pr(values, percepts) (Y,), from the definition."""
            m = self.momdp
            classes = m.latent_classes.tolist()
            rows = [
                [
                    sum(share * self._likelihood(i, c, of_i) for c, share in enumerate(by_class))
                    for by_class in classes[i]
                ]
                for i, of_i in enumerate(seen)
            ]
            return [
                float(p) * math.prod(rows[i][int(v)] for i, v in enumerate(y))
                for p, y in zip(m.joint, m.query.values, strict=True)
            ]

        def stop(self, x, seen):
            p = np.array(self.chances(seen))
            value = float((p / p.sum() @ self.momdp.reports.rewards()).max())
            return max(value, 0.0) if self.momdp.abstain else value

        def percepts(self, seen, e):
            mass = sum(self.chances(seen))
            for levels in np.ndindex(*(self.momdp.levels,) * len(seen)):
                after = []
                for z, of_i in zip(levels, seen, strict=True):
                    counts = of_i[e]
                    more = (*counts[:z], counts[z] + 1, *counts[z + 1 :])
                    after.append((*of_i[:e], more, *of_i[e + 1 :]))
                yield sum(self.chances(tuple(after))) / mass, tuple(after)

    return Coupled(momdp)


KINDS = [
    {},
    {"finite": True},
    {"levels": 4},
    {"levels": 4, "finite": True},
    {"yes_or_no": True},
    {"yes_or_no": True, "finite": True},
    {"abstain": True},
]


@pytest.mark.quick(4)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("enumerated", [coupled.ENUMERATED, 0])
@given(seed=st.integers(0, 2**32))
def test_values_are_no_higher_than_the_optimum_beyond_their_errors(small, kind, enumerated, seed):
    momdp = problem(seed, **kind)
    optimum = coupled_expectimax(small, momdp)
    seen = optimum.nothing_seen()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coupled, "ENUMERATED", enumerated)
        policy = OpenLoop().solve(momdp, np.random.default_rng(0))
        for number in range(4):
            history = History(initial_belief(momdp))
            decision = policy.decide(history, np.random.default_rng(number))
            assert decision.values[-1] == pytest.approx(optimum.stop(momdp.start, seen))
            assert decision.value_se[-1] == 0
            for a in np.flatnonzero(~np.isnan(decision.values[:-1])).tolist():
                best = optimum.edge(momdp.start, seen, a, optimum.value)
                error = decision.value_se[a]
                assert decision.values[a] <= best + WITHIN * error + 1e-9
                assert enumerated or not momdp.observation_probability[a].any() or error > 0


@pytest.mark.parametrize("kind", KINDS)
@given(seed=st.integers(0, 2**32), groups=st.booleans())
def test_samples_agree_with_all_outcomes_within_their_errors(kind, seed, groups):
    momdp = problem(seed, **kind)
    if groups and momdp.query.event is None:  # one of them is true, in place of a joint prior
        query = Query(momdp.query.attributes, groups=(tuple(range(len(momdp.query))),))
        momdp = grouped(momdp, query)
    belief = initial_belief(momdp)
    counts = np.minimum([[1, 0], [0, 1], [1, 1], [2, 1]], momdp.limit).astype(int)
    rng = np.random.default_rng(seed)
    plans = coupled.CoupledPlans(momdp, belief, counts, rng, samples=400)
    exact = plans.endings()
    assert plans.is_enumerated.all()
    assert (exact.error == 0).all()
    plans.is_enumerated[:] = False
    sampled = plans.endings()
    assert (sampled.error > 0).all()
    assert (abs(sampled.value - exact.value) <= WITHIN * sampled.error).all()


def grouped(momdp, query):
    """Return the problem about one group, with an even prior."""
    domain = domain_from_table({
        "name": "drawn", "attributes": list(query.attributes), "report_reward": 100.0,
        "behaviors": [
            {"name": name, "cost": 1.0, "modalities": ["camera"]} for name in momdp.behavior_names
        ],
        "diagram": {"states": ["x0"], "start": "x0", "effects": [
            {"from": "x0", "do": name, "to": "x0"} for name in momdp.behavior_names
        ]},
    })  # fmt: skip
    prior = 1 / len(query)
    return build_momdp(
        domain, query, momdp.confusion, momdp.precision, limit=momdp.limit, prior=prior
    )


@pytest.mark.long
def test_more_samples_bring_less_error():
    momdp = problem(3)
    history = History(initial_belief(momdp))

    def spread(solver):
        policy = solver.solve(momdp, np.random.default_rng(0))
        decisions = [policy.decide(history, np.random.default_rng(seed)) for seed in range(30)]
        values = np.array([decision.values[0] for decision in decisions])
        errors = np.array([decision.value_se[0] for decision in decisions])
        return values.std(), errors.mean()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coupled, "ENUMERATED", 0)
        for few, many in [
            (OpenLoop(samples=100), OpenLoop(samples=1600)),
            (POMCP(simulations=100), POMCP(simulations=4 * coupled.SAMPLES)),
        ]:
            of_few, of_many = spread(few), spread(many)
            assert of_many[1] < 0.6 * of_few[1]
            assert of_many[0] < of_few[0]
            assert of_few[0] < 2 * of_few[1]
    assert spread(OpenLoop()) == pytest.approx((0, 0))  # all outcomes are enumerated
