"""Optimal values of many problems of one attribute at once: the value of better rates.

Each asks the same question of the same robot with yes/no percepts of known rates (Eq. 8); only the
rates and the prior differ. Beliefs lie on an even grid of log-odds, so a percept shifts them all by
the same amount, and one sweep of value iteration over all problems is a few array operations. The
interpolation errs upwards, by about the same in all of them: differences are what it is for.
"""

import numpy as np

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.compiled import dynamics_of

_LARGEST = 7.0
_POINTS = 57  # log-odds from -7 to 7
_SWEEPS = 60  # at most
_SETTLED = 1e-4  # of r+ - r-


def batched_value_iteration(momdp: MOMDP, rates: Floats, prior: Floats) -> Floats:
    """Compute the values of B single-attribute problems at their priors, (B,), s of reward.

    Parameters
    ----------
    momdp : MOMDP
        Of one attribute and unshaped; its diagram, costs, discount and rewards hold for all, its
        rows for none.
    rates : Floats
        (B,E,2) Pr(yes | false) and Pr(yes | true); equal rates carry no information.
    prior : Floats
        (B,) Pr(the attribute is true).
    """
    dynamics = dynamics_of(momdp)
    grid = np.linspace(-_LARGEST, _LARGEST, _POINTS)
    belief = 1 / (1 + np.exp(-grid))
    report = momdp.reports.of_right(np.maximum(belief, 1 - belief)[:, None])
    floor = np.maximum(report, dynamics.exit_value)  # (G,)
    percepts = [_outcomes(rates[:, e], grid, belief) for e in range(momdp.n_behaviors)]
    value = np.tile(floor, (momdp.terminal, len(prior), 1))  # (X-1,B,G)
    for _ in range(_SWEEPS):
        change = 0.0
        for x in range(momdp.terminal)[::-1]:  # latest first
            new = np.broadcast_to(floor, value[x].shape).copy()
            for e in np.flatnonzero(dynamics.step["legal"][x]).tolist():
                step = dynamics.step[x, e]
                ahead = np.zeros_like(new)
                for p, to, senses in dynamics.branch[x, e].tolist():
                    ahead += p * (_expectation(percepts[e], value[to]) if senses else value[to])
                np.maximum(new, step["discount"] * ahead - step["cost"], out=new)
            change = max(change, float(np.abs(new - value[x]).max()))
            value[x] = new
        if change < _SETTLED * (momdp.correct - momdp.incorrect):
            break
    at = (np.log(prior / (1 - prior)) + _LARGEST) * ((_POINTS - 1) / (2 * _LARGEST))
    low = np.clip(at.astype(np.intp), 0, _POINTS - 2)
    fraction = np.clip(at - low, 0.0, 1.0)
    row = np.arange(len(prior))
    first = value[momdp.start]
    return np.asarray((1 - fraction) * first[row, low] + fraction * first[row, low + 1])


def _outcomes(yes: Floats, grid: Floats, belief: Floats) -> tuple[Floats, Ints, Floats]:
    """Compute Pr(z) of rates (B,2), and the point below b' and the weight above it, (2,B,G)."""
    rates = np.clip(np.stack([1 - yes, yes]), 1e-6, 1.0)[..., None]  # (2 levels,B,2 truths,1)
    prob = rates[:, :, 1] * belief + rates[:, :, 0] * (1 - belief)  # (2,B,G)
    at = np.arange(len(grid)) + np.log(rates[:, :, 1] / rates[:, :, 0]) / (grid[1] - grid[0])
    at = np.clip(at, 0, len(grid) - 1)
    low = np.minimum(at.astype(np.intp), len(grid) - 2)
    return prob, low, at - low


def _expectation(outcomes: tuple[Floats, Ints, Floats], value: Floats) -> Floats:
    """Compute the expected value (B,G) after a percept."""
    prob, low, fraction = outcomes
    below, above = (np.take_along_axis(value[None], at, axis=2) for at in (low, low + 1))
    return np.asarray((prob * (below + fraction * (above - below))).sum(axis=0))
