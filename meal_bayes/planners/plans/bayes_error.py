"""Kernels of the Bayes error of an attribute after an open-loop plan: E min(b, 1 - b).

The error is exact if the number of outcomes of a plan's percepts is within the capacity. Otherwise
outcomes with similar likelihood ratios are merged, and if there are still too many, percepts with
more than two levels are reduced to yes or no. Both steps can only increase the error, so the value
of a plan remains a lower bound.
"""

from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Floats, Ints, lowest_yes
from meal_bayes.momdp.observation import predictive as observation_predictive
from meal_bayes.momdp.reports import mean_reward as reward_formula
from meal_bayes.planners.jit import by_reference, called_kernel, entry_kernel, kernel
from meal_bayes.planners.momdp_arrays import Percepts

OUTCOMES = 1024  # largest number of outcomes for one attribute, in final tables
FEW_OUTCOMES = 256  # the same in computations that are repeated often
_SHARE_KEPT = 16  # too many outcomes are merged to 1/16 of the capacity
_GROUP = _SHARE_KEPT - 1  # percepts of a known row that are added at once
_WIDEST = 12.0  # larger log likelihood ratios are merged, because e^-12 of r+ - r- is negligible
SPAN = 16.0  # largest log-odds of the thresholds in error tables
THRESHOLDS = 65  # number of thresholds of a table, even in log-odds

# Functions of the decision problem: the model of percepts, and the reward of a report.
predictive = kernel(observation_predictive)
mean_reward = kernel(reward_formula)
_lowest_yes = kernel(lowest_yes)


@kernel
def log_odds(b):
    """Compute the log-odds of a probability, finite at 0 and 1."""
    return np.log((b + 1e-300) / (1.0 - b + 1e-300))


@kernel
def threshold_below(odds, thresholds):
    """Return the index of the threshold at or below log-odds; at most the last but one.

    Thresholds are even in log-odds from -SPAN to SPAN, so no search is necessary. `_first_yes` is
    the inverse and uses the same spacing.
    """
    g = int((odds + SPAN) * ((thresholds - 1) / (2.0 * SPAN)))
    return min(max(g, 0), thresholds - 2)


@kernel
def _first_yes(log_ratio, thresholds):
    """Return the first threshold at which an outcome means yes; `thresholds` if there is none."""
    g = int(np.ceil((SPAN - log_ratio) * ((thresholds - 1) / (2.0 * SPAN))))
    return min(max(g, 0), thresholds)


@by_reference
class Evidence(NamedTuple):
    """The percepts of a trial so far: the state of a finite-precision belief, besides x."""

    counts: Floats  # (N,E,K) by level
    total: Floats  # (E,)


class Row(NamedTuple):
    """Indices of a row of the confusion matrices."""

    attribute: int
    behavior: int
    latent_class: int


@by_reference
class Scratch(NamedTuple):
    """The percepts of a trial, and buffers for intermediate results."""

    evidence: Evidence
    outcomes: Floats  # (C,M) Pr(outcome of a plan's percepts, latent class)
    bins: Floats  # (C,M) the same, during merging and counting
    truths: Floats  # (2,M) Pr(outcome of a plan's percepts, truth)
    graded: Ints  # (K,) number of percepts of each level in one outcome
    chance: Floats  # (N,) Pr(attribute is true)
    threshold: Ints  # (N,) the last best decision threshold
    guess: Floats  # (J,) tabulated values of plans whose values must be computed
    computed: Ints  # (E,) number of computed plans, by first behavior
    value: Floats  # (E,) value of the best plan, by first behavior; -inf if there is none
    bonus: Floats  # (E,) the exploration bonus in it
    best: Ints  # (E,) the best plan, by first behavior
    lost: Floats  # (1,) value of answering at once, used if a plan cannot continue
    # (T,K+1) Bayes errors after a row's percepts, by `column`; -1 = not computed. For yes-or-no
    # questions, hits: Pr(literal is accepted, and it is true).
    error: Floats
    # (T,K+1) false alarms of yes-or-no questions: Pr(literal is accepted, and it is false).
    alarm: Floats
    # (T,K+1) errors from the tables of `Plans`, by `column`, if the class is the truth; -1 = not
    # read yet.
    tabled: Floats
    accepted: Floats  # (2,N) false alarm and hit of each attribute, for one plan
    column: Ints  # (N,) column of `error`: the level of the last percept plus 1, or 0 without one


def make_scratch(
    percepts: Percepts, plans: int, rows: int, capacity: int = FEW_OUTCOMES
) -> Scratch:
    """Create the buffers for a MOMDP, given the numbers of plans from one x and of table rows."""
    n, e, c, k = percepts.rows.shape
    return Scratch(
        evidence=Evidence(counts=np.zeros((n, e, k)), total=np.zeros(e)),
        outcomes=np.empty((c, capacity)),
        bins=np.empty((c, capacity)),
        truths=np.empty((2, capacity)),
        graded=np.zeros(k, np.int64),
        chance=np.zeros(n),
        threshold=np.zeros(n, np.int64),
        guess=np.zeros(plans),
        computed=np.zeros(e, np.int64),
        value=np.zeros(e),
        bonus=np.zeros(e),
        best=np.zeros(e, np.int64),
        lost=np.full(1, np.inf),
        error=np.full((rows, k + 1), -1.0),
        alarm=np.zeros((rows, k + 1)),
        tabled=np.full((rows, k + 1), -1.0),
        accepted=np.zeros((2, n)),
        column=np.zeros(n, np.int64),
    )


@kernel
def _count_yes(percepts, row, k, scratch):
    """Compute Pr(j of the next k percepts are yes | class), j = 0..k -> row c of `bins`."""
    i, e, c = row
    levels = percepts.rows.shape[3]
    evidence = scratch.evidence
    out = scratch.bins
    # The sums over the levels that mean yes; with two levels, a row has a Beta distribution.
    mean = 0.0
    yes = 0.0
    total = 0.0  # number of percepts of this attribute; other attributes may have more
    lowest_yes = _lowest_yes(levels)
    for z in range(levels):
        total += evidence.counts[i, e, z]
        if z >= lowest_yes:
            mean += percepts.rows[i, e, c, z]
            yes += evidence.counts[i, e, z]
    s = percepts.precision[i, e, c]
    # One percept after the other: P(j + 1 of t + 1) = P(j of t) q + P(j + 1 of t) (1 - q').
    out[c, 0] = 1.0
    for t in range(k):
        out[c, t + 1] = 0.0
        for j in range(t, -1, -1):
            q = predictive(mean, s, yes + j, total + t)  # Pr(next is yes | j of t were)
            p = out[c, j]
            out[c, j + 1] += p * q
            out[c, j] = p * (1.0 - q)


@kernel
def _level_counts(levels, k, most):
    """Return the number of possible level counts of k percepts, or `most` + 1 if it is larger."""
    ways = 1
    for z in range(1, levels):
        ways = ways * (k + z) // z
        if ways > most:
            return most + 1
    return ways


@called_kernel
def _count_levels(percepts, row, k, scratch):
    """Compute Pr(level counts of the next k percepts | class) -> row c of `bins`.

    The order of the outcomes depends only on k and the number of levels, not on the class.
    """
    i, e, c = row
    evidence = scratch.evidence
    graded = scratch.graded
    top = graded.shape[0] - 1
    total = 0.0
    for z in range(top + 1):
        total += evidence.counts[i, e, z]
    s = percepts.precision[i, e, c]
    graded[:] = 0
    graded[0] = k
    outcome = 0
    while True:
        # Polya's urn with the lowest level first, times the number of orders of the levels.
        p = 1.0
        past = 0
        for z in range(top + 1):
            mean = percepts.rows[i, e, c, z]
            seen = evidence.counts[i, e, z]
            for j in range(graded[z]):
                p *= predictive(mean, s, seen + j, total + past) * (past + 1) / (j + 1)
                past += 1
        scratch.bins[c, outcome] = p
        outcome += 1
        if graded[top] == k:
            break
        # The next composition of k [Nijenhuis1978, NEXCOM].
        first = 0
        while graded[first] == 0:
            first += 1
        number = graded[first]
        graded[first] = 0
        graded[0] = number - 1
        graded[first + 1] += 1


@kernel
def _sum_classes(weights, i, m, scratch):
    """Sum m outcomes over the latent classes, weighted (N,2,C) -> `truths`."""
    outcomes = scratch.outcomes
    truths = scratch.truths
    truths[:, :m] = 0.0
    for c in range(outcomes.shape[0]):
        false = weights[i, 0, c]
        true = weights[i, 1, c]
        for a in range(m):
            truths[0, a] += outcomes[c, a] * false
            truths[1, a] += outcomes[c, a] * true


@kernel
def _log_ratio(truths, a):
    """Compute the log likelihood ratio of an outcome."""
    return np.log((truths[1, a] + 1e-300) / (truths[0, a] + 1e-300))


@called_kernel
def _merge(weights, i, m, scratch):
    """Merge outcomes with similar likelihood ratios; return the number that remains."""
    outcomes = scratch.outcomes
    bins = scratch.bins
    classes = outcomes.shape[0]
    most = outcomes.shape[1] // _SHARE_KEPT
    _sum_classes(weights, i, m, scratch)
    bins[:, :most] = 0.0
    # Bins are even in log likelihood ratio. A bin contains less information than the outcome, so
    # merging can only increase the Bayes error.
    widest = 1e-9
    for a in range(m):
        widest = max(widest, abs(_log_ratio(scratch.truths, a)))
    # Outcomes beyond this ratio are almost certain and share the outermost bin.
    widest = min(widest, _WIDEST)
    for a in range(m):
        b = int((_log_ratio(scratch.truths, a) + widest) * (most / (2.0 * widest)))
        b = max(0, min(most - 1, b))
        for c in range(classes):
            bins[c, b] += outcomes[c, a]
    # Remove empty bins.
    remaining = 0
    for b in range(most):
        mass = 0.0
        for c in range(classes):
            outcomes[c, remaining] = bins[c, b]
            mass += bins[c, b]
        if mass > 0.0:
            remaining += 1
    return remaining


@kernel
def _enumerate(percepts, weights, counts, i, scratch):
    """Extend `outcomes` from column 0 by all outcomes of percepts (E,); return their number."""
    outcomes = scratch.outcomes
    bins = scratch.bins
    classes, capacity = outcomes.shape
    levels = percepts.rows.shape[3]
    m = np.int64(1)
    for e in range(counts.shape[0]):
        if counts[e] == 0 or not percepts.informative[i, e]:
            continue
        # There are no percepts beyond `limit`. Percepts of a known row are independent and are
        # added in groups. Others are dependent, and only the first group is added, which gives a
        # lower bound of the value.
        remaining = min(float(counts[e]), percepts.limit[e] - scratch.evidence.total[e])
        while remaining > 0.0:
            k = int(min(remaining, float(_GROUP)))
            size = k + 1
            by_level = False
            if levels > 2:
                # Add all percepts by their levels if the outcomes fit, perhaps after merging.
                all_left = int(min(remaining, float(capacity)))
                graded = _level_counts(levels, all_left, capacity)
                by_level = graded * min(m, capacity // _SHARE_KEPT) <= capacity
                if by_level:
                    k = all_left
                    size = graded
            remaining = remaining - k if percepts.rows_known[e] else 0.0
            if m * size > capacity:
                m = _merge(weights, i, m, scratch)
            # Pr(outcome, j of k | class) = Pr(outcome | class) Pr(j of k | class), in place, from
            # the last outcome to the first, because each is replaced by several.
            for c in range(classes):
                if by_level:
                    _count_levels(percepts, Row(i, e, c), k, scratch)
                else:
                    _count_yes(percepts, Row(i, e, c), k, scratch)
                # Read once, because reading between writes would take 15 % of a search.
                no = bins[c, 0]
                yes = bins[c, 1]
                for a in range(m - 1, -1, -1):
                    u = outcomes[c, a]
                    for j in range(size - 1, 1, -1):
                        outcomes[c, a * size + j] = u * bins[c, j]
                    outcomes[c, a * size + 1] = u * yes
                    outcomes[c, a * size] = u * no
            m *= size
    return m


@kernel
def plan_error(percepts, counts, i, prob, scratch):
    """Compute attribute i's Bayes error after a plan's percepts (E,), from a belief (N,C)."""
    for c in range(prob.shape[1]):
        scratch.outcomes[c, 0] = prob[i, c]
    m = _enumerate(percepts, percepts.truth_of_class, counts, i, scratch)
    # err_i = sum over outcomes of min(Pr(outcome, false), Pr(outcome, true))
    _sum_classes(percepts.truth_of_class, i, m, scratch)
    error = 0.0
    for a in range(m):
        error += min(scratch.truths[0, a], scratch.truths[1, a])
    return error


@kernel
def plan_rates(percepts, counts, i, prob, weight, scratch):
    """Compute Pr(says yes, truth) of attribute i after a plan's percepts -> `accepted`.

    The answer is yes if the probability of true, times `weight`, exceeds that of false.
    """
    for c in range(prob.shape[1]):
        scratch.outcomes[c, 0] = prob[i, c]
    m = _enumerate(percepts, percepts.truth_of_class, counts, i, scratch)
    _sum_classes(percepts.truth_of_class, i, m, scratch)
    scratch.accepted[0, i] = 0.0
    scratch.accepted[1, i] = 0.0
    for a in range(m):
        if weight * scratch.truths[1, a] > scratch.truths[0, a]:
            scratch.accepted[0, i] += scratch.truths[0, a]
            scratch.accepted[1, i] += scratch.truths[1, a]


@entry_kernel
def tabulate_errors(percepts, counts, attribute, scratch, table):
    """Tabulate Pr(error | latent class) at decision thresholds -> table (T,G,C).

    Row t is for attribute[t] (T,) after the percepts counts[t] (T,E). At threshold g, the decision
    is yes if the log likelihood ratio plus prior log-odds is positive; these log-odds are even in g
    from -SPAN to SPAN. The error at any threshold is at least the Bayes error. If the class is the
    truth, the best thresholds are those next to the log-odds of a belief.
    """
    thresholds = table.shape[1]
    classes = table.shape[2]
    bins = scratch.bins
    for t in range(table.shape[0]):
        i = attribute[t]
        scratch.outcomes[:, 0] = 1.0
        m = _enumerate(percepts, percepts.class_of_truth, counts[t], i, scratch)
        _sum_classes(percepts.class_of_truth, i, m, scratch)
        # From threshold g on, an outcome means yes.
        bins[:, : thresholds + 1] = 0.0
        for a in range(m):
            g = _first_yes(_log_ratio(scratch.truths, a), thresholds)
            for c in range(classes):
                bins[c, g] += scratch.outcomes[c, a]
        # Pr(error | class) = Pr(false | class) Pr(yes | class) + Pr(true | class) Pr(no | class)
        for c in range(classes):
            yes = 0.0
            no = 0.0
            for g in range(thresholds):
                yes += bins[c, g]
                table[t, g, c] = percepts.truth_of_class[i, 0, c] * yes
            for g in range(thresholds - 1, -1, -1):
                no += bins[c, g + 1]
                table[t, g, c] += percepts.truth_of_class[i, 1, c] * no
