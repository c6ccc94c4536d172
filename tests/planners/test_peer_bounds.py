"""The reference models A1 to A5: what we claim of their values, and what SARSOP certified."""

import json

import numpy as np
import pytest
from planner_models import REFERENCE, load_reference
from rollout import simulate

from meal_bayes.planners import Factored, OpenLoop

SARSOP = json.loads(REFERENCE.read_text(encoding="utf-8"))["sarsop_bounds"]
ERRORS = 5  # standard errors that a simulated value may lie above a bound


def faults_of(bounds, upper, value, error):
    """Return which of a peer's bounds contradict our upper bound, or the value of a policy."""
    for bound in bounds:
        after = f"SARSOP after {bound['timeout_cpu_s']} s"
        if upper < bound["lower"]:
            yield f"{after} attains {bound['lower']}, above our bound {upper:.2f}"
        if value - ERRORS * error > bound["upper"]:
            yield f"{value:.1f} +- {error:.1f} is above the bound {bound['upper']} of {after}"


@pytest.mark.quick(1)
@pytest.mark.statistical
@pytest.mark.parametrize(
    "name",
    ["A1", "A2", "A3", *(pytest.param(name, marks=pytest.mark.long) for name in ("A4", "A5"))],
)
def test_bounds_and_values_do_not_contradict_those_of_sarsop(name):
    """No value lies between bounds that cross: ours is above what any policy attains.

    Of A3 to A5 SARSOP's bounds are far apart; there ours is the tighter.
    """
    momdp = load_reference()[name]
    rng = np.random.default_rng(0)
    upper = Factored(5_000).solve(momdp, rng).upper_bound
    done = simulate(momdp, OpenLoop().solve(momdp, rng), 100, np.random.default_rng(1))
    assert list(faults_of(SARSOP[name], upper, done.value, done.value_se)) == []
    assert done.value - ERRORS * done.value_se <= upper
    best = SARSOP[name][-1]
    if best["upper"] - best["lower"] > 100:
        assert upper < best["upper"]
        assert done.value - ERRORS * done.value_se > best["lower"]


def test_bounds_that_cross_are_found():
    bounds = [{"timeout_cpu_s": 1, "lower": 10.0, "upper": 20.0}]
    assert not list(faults_of(bounds, upper=15.0, value=12.0, error=1.0))
    assert not list(faults_of(bounds, upper=30.0, value=24.0, error=1.0))
    assert "attains 10.0" in next(faults_of(bounds, upper=9.0, value=8.0, error=1.0))
    assert "above the bound 20.0" in next(faults_of(bounds, upper=30.0, value=26.0, error=1.0))
