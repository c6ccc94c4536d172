"""Outputs on groups of recordings by classifiers and stackers that never saw them.

Groups are objects, or folds of objects where there are many. With C = gram + noise and targets y of
+-1, the kernel-ridge classifier trained without the recordings G decides
y_G - inv(C^-1[G,G]) (C^-1 y)_G on them [Cawley2006]: one inverse a modality serves every attribute,
object and pair of objects. Where recordings are compared with landmarks, see `landmarks`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacking import fit_stackers, score_without

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NOBODY = np.empty((1, 0), np.int64)  # one set, of no groups


@dataclass(frozen=True, slots=True)
class Problem:
    """Recordings of one behavior whose labels are known, group by group.

    Attributes
    ----------
    groups : (k,) names, rising.
    starts : (k+1,) where each group's recordings start.
    weights : (n,) of each recording in a stacker's loss, 2 an object.
    targets : (P,n) +-1.
    duals : (M,P,m) weights of what recordings are compared with, trained on all groups.
    score : from groups left out (s,), and whether those who decide on the others did not see them
        either, to decisions on the recordings left out, (M,P,q), in the order of `rows`, and on
        every other group by itself left out too, (M,P,n), 0 where they are left out.
    """

    groups: Ints
    starts: Ints
    weights: Floats
    targets: Floats
    duals: Floats
    score: Callable[[Ints, bool], tuple[Floats, Floats]]

    def rows(self, groups: Ints) -> Ints:
        """Return the rows of some groups (s,), one group after the other."""
        ranges = [np.arange(self.starts[g], self.starts[g + 1]) for g in groups]
        return np.concatenate([NOBODY[0], *ranges])


def kernel_problem(grams: Floats, truth: NDArray[np.bool_], groups: Ints, noise: float) -> Problem:
    """Invert C of each modality: grams (M,n,n), truth (n,P), groups (n,) rising."""
    names, starts, sizes = np.unique(groups, return_index=True, return_counts=True)
    starts = np.append(starts, len(groups))
    targets = np.ascontiguousarray(np.where(truth, 1.0, -1.0).T)
    inverses = np.linalg.inv(grams + noise * np.eye(len(groups)))
    inverses = (inverses + inverses.transpose(0, 2, 1)) / 2
    duals = targets @ inverses

    def score(left_out: Ints, nested: bool) -> tuple[Floats, Floats]:
        own = np.empty((*duals.shape[:2], sizes[left_out].sum()))
        decisions = np.empty(duals.shape)
        score_without(left_out, inverses, duals, targets, starts, nested, own, decisions)
        return own, decisions

    return Problem(names, starts, np.repeat(2.0 / sizes, sizes), targets, duals, score)


class LeftOut(NamedTuple):
    """Stackers that never saw some sets S of groups, and their log-odds on these groups.

    Attributes
    ----------
    weights : (S,P,1+M) intercept and slopes of each stacker.
    log_odds : (S,P,s,R) of the sets' recordings, R the most that a group has.
    losses : (S,P) of each stacker on the decisions it learned from, ridge included.
    """

    weights: Floats
    log_odds: Floats
    losses: Floats


def leave_out(
    problem: Problem, sets: Ints, settings: PerceptionSettings, warm: Floats | None = None
) -> LeftOut:
    """Fit stackers without each of the sets (S,s) of groups, numbered as in the problem.

    `warm` (P,1+M) is where the search starts; the optimum is unique.
    """
    n_modalities, n_targets, _ = problem.duals.shape
    sizes = np.diff(problem.starts)
    weights = np.zeros((len(sets), n_targets, 1 + n_modalities))
    losses = np.zeros((len(sets), n_targets))
    log_odds = np.zeros((len(sets), n_targets, sets.shape[1], sizes.max()))
    for index, left_out in enumerate(np.asarray(sets, dtype=np.int64)):
        own, decisions = problem.score(left_out, settings.nested)
        remaining = problem.weights.copy()
        remaining[problem.rows(left_out)] = 0.0
        if warm is not None:
            weights[index] = warm
        fit_stackers(
            remaining,
            decisions,
            problem.targets,
            settings.ridge,
            settings.nonnegative,
            settings.balanced,
            weights[index],
            losses[index],
        )
        pooled = weights[index, :, :1] + np.einsum("mpq,pm->pq", own, weights[index, :, 1:])
        present = np.arange(log_odds.shape[3]) < sizes[left_out][:, None]  # (s,R)
        log_odds[index][:, present] = pooled
    return LeftOut(weights, log_odds, losses)


def full_stackers(problem: Problem, settings: PerceptionSettings) -> Floats:
    """Fit the stackers of all groups, (P,1+M)."""
    return np.asarray(leave_out(problem, NOBODY, settings).weights[0])


def each_group(
    problem: Problem, settings: PerceptionSettings, warm: Floats | None = None
) -> Floats:
    """Score every recording by classifiers and stackers that never saw its group, (n,P)."""
    sets = np.arange(len(problem.groups))[:, None]
    log_odds = leave_out(problem, sets, settings, warm).log_odds[:, :, 0]  # (k,P,R)
    present = np.arange(log_odds.shape[2]) < np.diff(problem.starts)[:, None]
    outputs: Floats = log_odds.transpose(0, 2, 1)[present]
    return outputs


def known_patterns(
    known: NDArray[np.bool_],
) -> Iterator[tuple[NDArray[np.bool_], Ints]]:
    """Group attributes by the rows whose label is known: (rows (n,), attributes) of `known` (n,P).

    Attributes of one group share their classifiers; where all labels are known there is one group.
    """
    patterns, group = np.unique(known, axis=1, return_inverse=True)
    for index in range(patterns.shape[1]):
        if patterns[:, index].any():
            yield patterns[:, index], np.flatnonzero(group.ravel() == index)
