"""Kernels of the exact Bayes error of an attribute after an open-loop plan: E min(b, 1 - b).

Percepts are cut to yes/no, and outcomes of like likelihood ratio merged at the
capacity; both can only raise the error, so the value of a plan stays a lower bound.
"""

from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp.observation import predictive as observation_predictive
from meal_bayes.planners.compiled import Percepts
from meal_bayes.planners.kernels import entry_kernel, kernel

OUTCOMES = 1024  # joint outcomes of a plan that are held for one attribute: of tables that last
FEW_OUTCOMES = 256  # and of everything that is computed often
_MERGED = 16  # outcomes are merged to 1/16 of the capacity
_WIDEST = 12.0  # log likelihood ratios beyond are merged: e^-12 of r+ - r- is nothing
SPAN = 16.0  # log-odds covered by the error tables
THRESHOLDS = 65  # thresholds of a table, even in log-odds

predictive = kernel(observation_predictive)


class Scratch(NamedTuple):
    """Buffers for one caller's intermediate results, and the percepts of the trial so far."""

    counts: Floats  # (N,E,K) percepts so far, by level
    total: Floats  # (E,) percepts so far
    outcomes: Floats  # (C,M) Pr(what a plan's percepts show, latent class)
    bins: Floats  # (C,M) the same, while it is merged or counted
    truths: Floats  # (2,M) Pr(what a plan's percepts show, truth)
    chance: Floats  # (N,) Pr(attribute is true)
    threshold: Ints  # (N,) the decision threshold that was best last
    guess: Floats  # (J,) tabulated values of plans that must be computed
    tried: Ints  # (E,) plans computed, by first behavior
    value: Floats  # (E,) value of the best plan, by first behavior; -inf where there is none
    best: Ints  # (E,) the best plan, by first behavior
    error: Floats  # (T,K+1) Bayes errors after the percepts of a row, by `shown`; -1 = not computed
    shown: Ints  # (N,) column of `error`: the last percept's level plus 1; 0 where none was


def make_scratch(percepts: Percepts, plans: int, rows: int, held: int = FEW_OUTCOMES) -> Scratch:
    """Create the buffers for a MOMDP, so many plans of one x and rows of the error table."""
    n, e, c, k = percepts.rows.shape
    return Scratch(
        counts=np.zeros((n, e, k)),
        total=np.zeros(e),
        outcomes=np.empty((c, held)),
        bins=np.empty((c, held)),
        truths=np.empty((2, held)),
        chance=np.zeros(n),
        threshold=np.zeros(n, np.int64),
        guess=np.zeros(plans),
        tried=np.zeros(e, np.int64),
        value=np.zeros(e),
        best=np.zeros(e, np.int64),
        error=np.full((rows, k + 1), -1.0),
        shown=np.zeros(n, np.int64),
    )


@kernel
def _count_yes(percepts, i, c, e, k, scratch):
    """Compute Pr(j of the next k percepts are yes | class), j = 0..k -> row c of `bins`."""
    levels, out = percepts.rows.shape[3], scratch.bins
    mean, yes = 0.0, 0.0
    for z in range(levels // 2, levels):
        mean += percepts.rows[i, e, c, z]
        yes += scratch.counts[i, e, z]
    s, total = percepts.precision[i, e, c], scratch.total[e]
    out[c, 0] = 1.0
    for t in range(k):
        out[c, t + 1] = 0.0
        for j in range(t, -1, -1):
            q = predictive(mean, s, yes + j, total + t)  # Pr(next is yes | j of t were)
            p = out[c, j]
            out[c, j + 1] += p * q
            out[c, j] = p * (1.0 - q)


@kernel
def _sum_classes(weights, i, m, scratch):
    """Sum m outcomes over the latent classes, weighted (N,2,C) -> `truths`."""
    outcomes, truths = scratch.outcomes, scratch.truths
    truths[:, :m] = 0.0
    for c in range(outcomes.shape[0]):
        false, true = weights[i, 0, c], weights[i, 1, c]
        for a in range(m):
            truths[0, a] += outcomes[c, a] * false
            truths[1, a] += outcomes[c, a] * true


@kernel
def _log_ratio(truths, a):
    """Compute the log likelihood ratio of an outcome."""
    return np.log((truths[1, a] + 1e-300) / (truths[0, a] + 1e-300))


@kernel
def _merge(weights, i, m, scratch):
    """Merge outcomes of like likelihood ratio; return how many are left."""
    outcomes, bins = scratch.outcomes, scratch.bins
    classes, most = outcomes.shape[0], outcomes.shape[1] // _MERGED
    _sum_classes(weights, i, m, scratch)
    bins[:, :most] = 0.0
    widest = 1e-9
    for a in range(m):
        widest = max(widest, abs(_log_ratio(scratch.truths, a)))
    widest = min(widest, _WIDEST)
    for a in range(m):
        b = int((_log_ratio(scratch.truths, a) + widest) * (most / (2.0 * widest)))
        b = max(0, min(most - 1, b))
        for c in range(classes):
            bins[c, b] += outcomes[c, a]
    left = 0
    for b in range(most):
        filled = 0.0
        for c in range(classes):
            outcomes[c, left] = bins[c, b]
            filled += bins[c, b]
        if filled > 0.0:
            left += 1
    return left


@kernel
def _enumerate(percepts, weights, counts, plan, i, scratch):
    """Multiply column 0 of `outcomes` by all that a plan may perceive; return their number."""
    outcomes, bins = scratch.outcomes, scratch.bins
    classes, held = outcomes.shape
    m = min(1, held)
    for e in range(counts.shape[1]):
        if counts[plan, e] == 0 or not percepts.informative[i, e]:
            continue
        left = min(float(counts[plan, e]), percepts.limit[e] - scratch.total[e])
        while left > 0.0:
            k = int(min(left, _MERGED - 1.0))
            left = left - k if percepts.known[e] else 0.0  # else the next depend on these
            if m * (k + 1) > held:
                m = _merge(weights, i, m, scratch)
            for c in range(classes):
                _count_yes(percepts, i, c, e, k, scratch)
                # Held apart, as to read them between writes takes 15 % of a search.
                no, yes = bins[c, 0], bins[c, 1]
                for a in range(m - 1, -1, -1):
                    u = outcomes[c, a]
                    for j in range(k, 1, -1):
                        outcomes[c, a * (k + 1) + j] = u * bins[c, j]
                    outcomes[c, a * (k + 1) + 1] = u * yes
                    outcomes[c, a * (k + 1)] = u * no
            m *= k + 1
    return m


@kernel
def plan_error(percepts, counts, plan, i, prob, scratch):
    """Compute attribute i's Bayes error after a plan, from a belief (N,C) and percepts so far."""
    for c in range(prob.shape[1]):
        scratch.outcomes[c, 0] = prob[i, c]
    m, error = _enumerate(percepts, percepts.truth, counts, plan, i, scratch), 0.0
    _sum_classes(percepts.truth, i, m, scratch)
    for a in range(m):
        error += min(scratch.truths[0, a], scratch.truths[1, a])
    return error


@entry_kernel
def tabulate_errors(percepts, counts, attribute, scratch, table):
    """Tabulate Pr(error | latent class) at decision thresholds -> table (T,G,C).

    Row t: after the percepts uses[t] (T,E), of attribute[t] (T,). Threshold g decides yes where the
    likelihood ratio outweighs prior log-odds -SPAN .. SPAN, even in g. No threshold's
    error is below the Bayes error; where the class is the truth, the best thresholds are those
    next to the log-odds of a belief.
    """
    thresholds, classes, bins = table.shape[1], table.shape[2], scratch.bins
    scale = (thresholds - 1) / (2.0 * SPAN)
    for t in range(table.shape[0]):
        i = attribute[t]
        scratch.outcomes[:, 0] = 1.0
        m = _enumerate(percepts, percepts.classes, counts, t, i, scratch)
        _sum_classes(percepts.classes, i, m, scratch)
        bins[:, : thresholds + 1] = 0.0
        for a in range(m):  # from this threshold on an outcome speaks for yes
            g = int(np.ceil((SPAN - _log_ratio(scratch.truths, a)) * scale))
            g = min(max(g, 0), thresholds)
            for c in range(classes):
                bins[c, g] += scratch.outcomes[c, a]
        for c in range(classes):
            yes, no = 0.0, 0.0
            for g in range(thresholds):
                yes += bins[c, g]
                table[t, g, c] = percepts.truth[i, 0, c] * yes
            for g in range(thresholds - 1, -1, -1):
                no += bins[c, g + 1]
                table[t, g, c] += percepts.truth[i, 1, c] * no
