"""Optimal values of many problems of one attribute at once: the value of better rates.

Each asks the same question of the same robot with yes/no percepts of known rates (Eq. 8); only the
rates and the prior differ. Beliefs lie on an even grid of log-odds, so a percept shifts them all by
the same amount, and one sweep of value iteration over all problems is a few array operations. The
interpolation errs upwards, by about the same in all of them: differences are what it is for.
"""

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.compiled import Dynamics, Floats, dynamics_of

_LARGEST, _POINTS = 7.0, 57  # log-odds from -7 to 7
_SWEEPS = 60  # at most
_SETTLED = 1e-4  # of r+ - r-


def batched_value_iteration(momdp: MOMDP, rates: ArrayLike, prior: ArrayLike) -> Floats:
    """Compute the values of B single-attribute problems at their priors, (B,), s of reward.

    Parameters
    ----------
    momdp : MOMDP
        Of one attribute and unshaped; its diagram, costs, discount and rewards hold for all, its
        rows for none.
    rates : ArrayLike
        (B,E,2) Pr(yes | false) and Pr(yes | true); equal rates carry no information.
    prior : ArrayLike
        (B,) Pr(the attribute is true).

    Raises
    ------
    SettingsError
        More than one attribute, shaping, or arrays that do not fit.
    """
    yes, start = np.asarray(rates, dtype=float), np.asarray(prior, dtype=float)
    if len(momdp.query) != 1 or momdp.bonus.any():
        raise SettingsError("batched_value_iteration needs an unshaped MOMDP of one attribute.")
    if yes.shape != (len(start), momdp.n_behaviors, 2):
        raise SettingsError(
            f"rates and prior have shapes {yes.shape} and {start.shape}; "
            f"expected (B,{momdp.n_behaviors},2) and (B,)."
        )
    dynamics = dynamics_of(momdp)
    grid = np.linspace(-_LARGEST, _LARGEST, _POINTS)
    belief = 1 / (1 + np.exp(-grid))
    report = momdp.report_reward(np.maximum(belief, 1 - belief)[:, None])
    floor = np.maximum(report, dynamics.exit_value)  # (G,)
    percepts = [_Percept(yes[:, e], grid, belief) for e in range(momdp.n_behaviors)]
    value = np.tile(floor, (momdp.terminal, len(start), 1))  # (X-1,B,G)
    settled = _SETTLED * (momdp.correct - momdp.incorrect)
    latest_first = range(momdp.terminal)[::-1]
    for _ in range(_SWEEPS):
        if max(_back_up(dynamics, percepts, floor, value, x) for x in latest_first) < settled:
            break
    at = (np.log(start / (1 - start)) + _LARGEST) * ((_POINTS - 1) / (2 * _LARGEST))
    low = np.clip(at.astype(np.intp), 0, _POINTS - 2)
    fraction, row = np.clip(at - low, 0.0, 1.0), np.arange(len(start))
    first = value[momdp.start]
    return np.asarray((1 - fraction) * first[row, low] + fraction * first[row, low + 1])


class _Percept:
    """What a behavior's next percept does to every belief of every problem."""

    def __init__(self, yes: Floats, grid: Floats, belief: Floats) -> None:
        rates = np.clip(np.stack([1 - yes, yes]), 1e-6, 1.0)  # (2 levels,B,2 truths)
        self.prob = rates[..., 1:] * belief + rates[..., :1] * (1 - belief)  # (2,B,G)
        step = grid[1] - grid[0]
        at = np.arange(len(grid)) + np.log(rates[..., 1:] / rates[..., :1]) / step
        at = np.clip(at, 0, len(grid) - 1)
        self.low = np.minimum(at.astype(np.intp), len(grid) - 2)
        self.fraction = at - self.low

    def expectation(self, value: Floats) -> Floats:
        """Compute the expected value (B,G) after the percept."""
        total = np.zeros_like(value)
        for prob, low, fraction in zip(self.prob, self.low, self.fraction, strict=True):
            below = np.take_along_axis(value, low, axis=1)
            above = np.take_along_axis(value, low + 1, axis=1)
            total += prob * (below + fraction * (above - below))
        return total


def _back_up(
    dynamics: Dynamics, percepts: list[_Percept], floor: Floats, value: Floats, x: int
) -> float:
    """Update the values of one x in place; return the largest change."""
    new = np.broadcast_to(floor, value[x].shape).copy()
    for e in np.flatnonzero(dynamics.step["legal"][x]).tolist():
        step, ahead = dynamics.step[x, e], np.zeros_like(new)
        for p, to, senses in dynamics.outcomes(x, e):
            ahead += p * (percepts[e].expectation(value[to]) if senses else value[to])
        np.maximum(new, step["discount"] * ahead - step["cost"], out=new)
    change = float(np.abs(new - value[x]).max())
    value[x] = new
    return change
