"""A decision's gap: lower bound <= optimum <= upper bound."""

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import Objective, build_momdp, initial_belief
from meal_bayes.planners import POMCP, Factored, History, OpenLoop


def random_rows(seed, n):
    domain, rng = load_domain("toy"), np.random.default_rng(seed)
    rows = rng.dirichlet([1.0, 1.0], (n, len(domain.behaviors), 2))
    return build_momdp(
        domain, Query(domain.attributes[:n]), rows, objective=Objective(abstain=True)
    )


@pytest.mark.parametrize("seed", range(6))
def test_plan_gap_and_upper_bound_enclose_each_other(seed):
    momdp = random_rows(seed, 1 + seed % 2)
    rng, start = np.random.default_rng(0), History(initial_belief(momdp))
    upper = Factored().solve(momdp, rng).upper_bound
    plan = np.nanmax(OpenLoop().solve(momdp, rng).decide(start, rng).values)
    decision = POMCP(20).solve(momdp, rng).decide(start, rng)
    assert plan <= upper + 1e-6
    assert decision.gap is not None
    assert decision.gap >= 0.0
    assert decision.gap >= np.nanmax(decision.values) - plan - 1.0  # the table errs by less
    assert plan - 1e-6 <= np.nanmax(decision.values) <= upper + 1.0


def test_no_gap_is_claimed_where_no_bound_is_certified():
    domain = load_domain("toy")
    rows = np.tile([[0.8, 0.2], [0.3, 0.7]], (1, 3, 1, 1))
    momdp = build_momdp(domain, Query(domain.attributes[:1]), rows, 5.0)
    rng = np.random.default_rng(0)
    assert POMCP(20).solve(momdp, rng).decide(History(initial_belief(momdp)), rng).gap is None
