"""Optimal values of many single-attribute problems at once, to compute the value of better rates.

All problems have the same question and robot, and yes/no percepts with known rates (Eq. 8); only
the rates and the prior differ. Beliefs are on an even grid of log-odds, so a percept shifts all of
them by the same amount. Interpolation makes values too high by about the same amount in all
problems, so only differences between problems should be used.
"""

from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Bools, Floats, Ints, real_vector, shaped_array
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.jit import by_reference, entry_kernel, kernel
from meal_bayes.planners.momdp_arrays import dynamics_of

_LARGEST = 7.0  # largest log-odds of the grid
_POINTS = 57  # number of points of the grid
_SWEEPS = 60  # largest number of sweeps
_SETTLED = 1e-6  # change of values, in units of r+ - r-, below which iteration ends
_LEAST = 1e-6  # smallest rate of yes and of no


@by_reference
class Problems(NamedTuple):
    """Data of B problems for the kernel."""

    rates: Floats  # (B,E,2)
    prior_position: Floats  # (B,R) positions of the priors on the grid
    worse: Bools  # (B,) do the next problems start from its values?
    floor: Floats  # (G,) value of answering
    belief: Floats  # (G,)
    width: float  # distance between points of the grid
    settled: float  # change of a sweep (in seconds) below which iteration ends
    start: int  # x


@by_reference
class Buffers(NamedTuple):
    """Buffers of the kernel: G beliefs, E behaviors, X states without the terminal one."""

    value: Floats  # (X,G)
    earlier_value: Floats  # (X,G) of the last problem that others start from
    best: Floats  # (G,)
    raised: Floats  # (G,)
    prob: Floats  # (E,2,G) Pr(no), Pr(yes)
    low: Ints  # (E,2) points that a percept moves a belief by, rounded down
    fraction: Floats  # (E,2) the rest of it


def batched_value_iteration(
    momdp: MOMDP, rates: Floats, prior: Floats, worse: Bools | None = None
) -> Floats:
    """Compute the values of B single-attribute problems at their priors, in seconds.

    Parameters
    ----------
    momdp : MOMDP
        Problem with one attribute and without bonus. Its diagram, costs, discount and rewards are
        used for all problems; its confusion matrices are not used.
    rates : Floats
        (B,E,2) rates of each problem and behavior, Pr(yes | false) and Pr(yes | true). Equal rates
        carry no information.
    prior : Floats
        (B,) prior Pr(attribute is true) of each problem, or (B,R) with R priors of each problem.
        More priors take no more time.
    worse : Bools, optional
        (B,) True for a problem whose values are lower bounds for the problems after it, up to the
        next True. Value iteration of those problems starts from these values. By default, each
        problem starts from the value of answering at once.

    Returns
    -------
    Floats
        (B,) or (B,R) value of each problem at each of its priors.
    """
    prior = np.asarray(prior, float)
    if prior.ndim < 2:
        prior = real_vector("prior", prior)
    rates = shaped_array("rates", rates, len(prior), momdp.n_behaviors, 2)
    starts_anew = np.ones(len(prior)) if worse is None else shaped_array("worse", worse, len(prior))
    dynamics = dynamics_of(momdp)
    grid = np.linspace(-_LARGEST, _LARGEST, _POINTS)
    belief = 1 / (1 + np.exp(-grid))
    reports = momdp.reports
    report = reports.of_right(np.maximum(belief, 1 - belief)[:, None])
    if reports.event is not None:  # yes and no have rewards of their own
        report = reports.answers(reports.event.probability(belief[:, None], ((0,),))).max(axis=-1)
    floor = np.maximum(report, dynamics.exit_value)  # (G,)
    states = momdp.terminal
    e = momdp.n_behaviors
    points = len(grid)
    scratch = Buffers(
        value=np.zeros((states, points)),
        earlier_value=np.zeros((states, points)),
        best=np.zeros(points),
        raised=np.zeros(points),
        prob=np.zeros((e, 2, points)),
        low=np.zeros((e, 2), np.int64),
        fraction=np.zeros((e, 2)),
    )
    log_odds = np.clip(np.log(prior / (1 - prior)), -_LARGEST, _LARGEST)
    width = float(grid[1] - grid[0])
    problems = Problems(
        rates=np.ascontiguousarray(np.clip(rates, _LEAST, 1.0), np.float64),
        prior_position=((log_odds + _LARGEST) / width).reshape(len(prior), -1),
        worse=starts_anew != 0,
        floor=floor,
        belief=belief,
        width=width,
        settled=_SETTLED * float(momdp.correct - momdp.incorrect),
        start=int(momdp.start),
    )
    values = np.zeros(problems.prior_position.shape)
    _solve_each(dynamics.step, dynamics.branch, problems, scratch, values)
    return values.reshape(prior.shape)


@entry_kernel
def _solve_each(step, branch, problems, scratch, values):
    """Solve one problem after another, and write the values at the priors."""
    value = scratch.value
    floor = problems.floor
    start = problems.start
    points = len(floor)
    for b in range(len(values)):
        # Start from a lower bound: the value of answering, or of a problem with worse percepts.
        for x in range(len(value)):
            for g in range(points):
                value[x, g] = floor[g] if problems.worse[b] else scratch.earlier_value[x, g]
        _lay_out_percepts(problems.rates[b], problems.belief, problems.width, scratch)
        # Value iteration on the grid: each sweep is a Bellman backup of all x.
        for _ in range(_SWEEPS):
            if _sweep(step, branch, floor, scratch) < problems.settled:
                break
        for x in range(len(value)):
            for g in range(points):
                if problems.worse[b]:
                    scratch.earlier_value[x, g] = value[x, g]
        # V at a prior is interpolated linearly in log-odds.
        for r in range(values.shape[1]):
            position = problems.prior_position[b, r]
            low = min(int(position), points - 2)
            fraction = position - low
            values[b, r] = (1 - fraction) * value[start, low] + fraction * value[start, low + 1]


@kernel
def _lay_out_percepts(rates, belief, width, scratch):
    """Write Pr(z) at each belief, and the number of grid points by which z moves the belief."""
    for e in range(len(rates)):
        for z in range(2):
            false = rates[e, 0] if z else max(1 - rates[e, 0], _LEAST)
            true = rates[e, 1] if z else max(1 - rates[e, 1], _LEAST)
            for g in range(len(belief)):
                scratch.prob[e, z, g] = true * belief[g] + false * (1 - belief[g])
            # Bayes' rule in log-odds is a shift: l' = l + ln Pr(z | true) / Pr(z | false).
            moved = np.log(true / false) / width
            scratch.low[e, z] = int(np.floor(moved))
            scratch.fraction[e, z] = moved - np.floor(moved)


@kernel
def _sweep(step, branch, floor, scratch):
    """Back up the values of every x once, latest first; return the largest change."""
    value = scratch.value
    best = scratch.best
    raised = scratch.raised
    points = len(floor)
    largest = 0.0
    for x in range(len(value) - 1, -1, -1):
        for g in range(points):
            best[g] = floor[g]
        for e in range(step.shape[1]):
            if not step[x, e].legal:
                continue
            for g in range(points):
                raised[g] = 0.0
            for k in range(branch.shape[2]):
                p = branch[x, e, k].p
                to = branch[x, e, k].x
                if p > 0 and branch[x, e, k].senses:
                    _add_expected(p, value[to], e, scratch)
                elif p > 0:
                    for g in range(points):
                        raised[g] += p * value[to, g]
            for g in range(points):
                # V(x, b) = max(stop(b), max_e -c + g sum_k p_k E V(x_k, b'))
                best[g] = max(best[g], step[x, e].discount * raised[g] - step[x, e].cost)
        for g in range(points):
            largest = max(largest, abs(best[g] - value[x, g]))
            value[x, g] = best[g]
    return largest


@kernel
def _add_expected(p, value, e, scratch):
    """Add p E V(x', b') to each belief's value, by linear interpolation between its neighbors."""
    points = len(value)
    # E V(x', b') = sum_z Pr(z | b) V(x', b_z), and b_z lies `fraction` between two points.
    for z in range(2):
        low = scratch.low[e, z]
        fraction = scratch.fraction[e, z]
        for g in range(points):
            below = g + low
            above = below + 1
            upper_weight = fraction
            # Beyond the grid, values are those at its ends.
            if below < 0:
                below = 0
                above = 0
                upper_weight = 0.0
            elif above > points - 1:
                below = points - 1
                above = points - 1
                upper_weight = 0.0
            expected = value[below] + upper_weight * (value[above] - value[below])
            scratch.raised[g] += p * scratch.prob[e, z, g] * expected
