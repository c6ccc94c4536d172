"""A decision's gap: lower bound <= optimum <= upper bound."""

import numpy as np
import pytest

from meal_bayes.momdp import Objective
from meal_bayes.planners import POMCP, Factored, OpenLoop


@pytest.mark.parametrize("seed", range(6))
def test_plan_gap_and_upper_bound_enclose_each_other(small, seed):
    momdp = small.toy(seed, 1 + seed % 2, 2, finite=False, objective=Objective(abstain=True))
    rng, start = np.random.default_rng(0), small.start(momdp)
    upper = Factored().solve(momdp, rng).upper_bound
    plan = np.nanmax(OpenLoop().solve(momdp, rng).decide(start, rng).values)
    decision = POMCP(20).solve(momdp, rng).decide(start, rng)
    assert plan <= upper + 1e-6
    assert decision.gap is not None
    assert decision.gap >= 0.0
    assert decision.gap >= np.nanmax(decision.values) - plan - 1.0  # the table errs by less
    assert plan - 1e-6 <= np.nanmax(decision.values) <= upper + 1.0


def test_no_gap_is_claimed_where_no_bound_is_certified(small):
    assert small.search(small.momdp("toy", small.rates, 5.0), 20).gap is None
