"""The bonus beside the exact Bayes-adaptive optimum of tiny problems."""

import numpy as np
import pytest
from bayes_adaptive import (
    Problem,
    earned,
    executes,
    learning,
    no_bonus,
    optimum,
    trial_value,
)

GAINFUL = (
    Problem("two cheap", 5, (2.0, 2.0)),
    Problem("cheap and dear", 6, (2.0, 20.0)),
    Problem("three", 3, (2.0, 5.0, 15.0)),
    Problem("beside a weak known one", 12, (2.0, 5.0), known=(0.35, 0.65)),
    Problem("beside a weak known one, rarely true", 14, (4.0, 3.0), prior=0.3, known=(0.3, 0.6)),
    Problem("beside a useless one", 8, (1.0, 4.0), known=(0.5, 0.5), weight=2.0),
)
HOPELESS = (
    Problem("two dear", 5, (30.0, 30.0)),
    Problem("rare attribute", 5, (5.0, 5.0), prior=0.2),
    Problem("beside a good known one", 12, (5.0, 2.0), known=(0.1, 0.9)),
    Problem("much doubted", 12, (2.0, 5.0), known=(0.25, 0.75), weight=10.0),
)


def name_of(problem):
    return problem.name


@pytest.mark.quick(2)
@pytest.mark.parametrize("problem", GAINFUL, ids=name_of)
def test_the_bonus_gains_nearly_all_that_can_be_gained(problem):
    best, _ = optimum(problem)
    nothing = earned(problem, no_bonus)
    assert best > nothing + 1
    assert earned(problem, learning) >= nothing + 0.95 * (best - nothing)


@pytest.mark.quick(1)
@pytest.mark.parametrize("problem", HOPELESS, ids=name_of)
def test_the_bonus_loses_nothing_where_nothing_can_be_gained(problem):
    best, _ = optimum(problem)
    assert earned(problem, no_bonus) == pytest.approx(best)
    assert earned(problem, learning) >= best - 5.0


@pytest.mark.quick(2)
@pytest.mark.parametrize("problem", GAINFUL + HOPELESS, ids=name_of)
def test_nothing_beats_the_optimum(problem):
    best, _ = optimum(problem)
    for bonus in (no_bonus, learning):
        assert earned(problem, bonus) <= best + 1e-9


def test_known_rates_leave_the_value_of_one_trial():
    problem = Problem("known", 4, (3.0, 5.0), known=(0.2, 0.8), weight=1e9)
    rates = np.array([[[0.2, 0.8], [0.5, 0.5]]])
    assert optimum(problem)[0] == pytest.approx(4 * trial_value(problem, rates)[0])
    assert trial_value(problem, rates)[0] == pytest.approx(60.0 - 3.0)


def test_the_optimum_of_two_trials_is_that_by_hand():
    """A first percept moves one row to 2/3 or 1/3, of which a second one's report gains 1/6."""
    assert optimum(Problem("two trials", 2, (2.0,)))[0] == pytest.approx(-2.0 + 100 / 6 - 2.0)


def test_plans_say_what_they_come_to():
    problem = Problem("two cheap", 3, (2.0, 2.0))
    _, plans = optimum(problem)
    assert executes(plans[0], 0)[0] or executes(plans[0], 1)[0]
    assert not executes(plans[-1], 0)[0]  # nothing is left to learn for
