"""Leave-objects-out outputs of a behavior in closed form: no classifier is ever refitted.

With C = gram + noise and targets y of +-1, the kernel-ridge classifier trained without the
recordings G decides y_G - inv(C^-1[G,G]) (C^-1 y)_G on them [Cawley2006]. One inverse a modality
serves every attribute, fold and nested fold.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacking import fit_stackers, score_without

Floats = NDArray[np.float64]

NOBODY = np.empty((1, 0), np.int64)  # one set, of no objects


@dataclass(frozen=True, slots=True)
class KernelProblem:
    """Recordings of one behavior whose labels are known, object by object."""

    objects: NDArray[np.int64]  # (k,) the objects, rising
    starts: NDArray[np.int64]  # (k+1,) where each object's recordings start
    targets: Floats  # (P,n) +-1
    inverses: Floats  # (M,n,n) C^-1
    duals: Floats  # (M,P,n) C^-1 y


def kernel_problem(
    grams: Floats, truth: NDArray[np.bool_], objects: NDArray[np.int64], noise: float
) -> KernelProblem:
    """Invert C of each modality: grams (M,n,n), truth (n,P), objects (n,) rising."""
    names, starts = np.unique(objects, return_index=True)
    targets = np.ascontiguousarray(np.where(truth, 1.0, -1.0).T)
    inverses = np.linalg.inv(grams + noise * np.eye(len(objects)))
    inverses = (inverses + inverses.transpose(0, 2, 1)) / 2
    return KernelProblem(
        names, np.append(starts, len(objects)), targets, inverses, targets @ inverses
    )


class LeftOut(NamedTuple):
    """Stackers that never saw some sets S of objects, and what they say of these objects."""

    weights: Floats  # (S,P,1+M) intercept and slopes of each stacker
    log_odds: Floats  # (S,P,s,R) of the sets' recordings, R the most that an object has
    losses: Floats  # (S,P) of each stacker on the decisions it learned from, ridge included


def problems(
    grams: Floats, labels: NDArray[np.int8], groups: NDArray[np.int64], noise: float
) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.int64], KernelProblem]]:
    """Yield (rows (n,), attributes, problem) for attributes whose labels (n,P) are known together.

    `groups` (n,), rising, are what is left out as one.
    """
    for known, attributes in known_patterns(labels >= 0):
        truth = labels[np.ix_(known, attributes)] == 1
        gram = grams[:, known][:, :, known]
        yield known, attributes, kernel_problem(gram, truth, groups[known], noise)


def leave_out(
    problem: KernelProblem,
    sets: NDArray[np.int64],
    settings: PerceptionSettings,
    warm: Floats | None = None,
) -> LeftOut:
    """Leave out each of the sets (S,s) of objects, numbered as in the problem.

    `warm` (P,1+M) is where the search for the stackers starts; the same ones are found from
    anywhere.
    """
    n_modalities, n_targets, n = problem.duals.shape
    sizes = np.diff(problem.starts)
    weights = np.zeros((len(sets), n_targets, 1 + n_modalities))
    losses = np.zeros((len(sets), n_targets))
    log_odds = np.zeros((len(sets), n_targets, sets.shape[1], sizes.max()))
    decisions = np.empty((n_modalities, n_targets, n))
    for index, left_out in enumerate(np.asarray(sets, dtype=np.int64)):
        own = np.empty((n_modalities, n_targets, sizes[left_out].sum()))
        score_without(
            left_out,
            problem.inverses,
            problem.duals,
            problem.targets,
            problem.starts,
            settings.nested,
            own,
            decisions,
        )
        if warm is not None:
            weights[index] = warm
        fit_stackers(
            left_out,
            decisions,
            problem.targets,
            problem.starts,
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


def all_objects(problem: KernelProblem, settings: PerceptionSettings) -> Floats:
    """Stackers of a robot that has seen every object, (P,1+M)."""
    return np.asarray(leave_out(problem, NOBODY, settings).weights[0])


def each_object(
    problem: KernelProblem, settings: PerceptionSettings, warm: Floats | None = None
) -> Floats:
    """Score every recording by classifiers and stackers that never saw its object, (n,P)."""
    sets = np.arange(len(problem.objects))[:, None]
    log_odds = leave_out(problem, sets, settings, warm).log_odds[:, :, 0]  # (k,P,R)
    present = np.arange(log_odds.shape[2]) < np.diff(problem.starts)[:, None]
    outputs: Floats = log_odds.transpose(0, 2, 1)[present]
    return outputs


def known_patterns(
    known: NDArray[np.bool_],
) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.int64]]]:
    """Group attributes by the rows whose label is known: (rows (n,), attributes) of `known` (n,P).

    Attributes of one group share their inverses; where all labels are known there is one group.
    """
    patterns, group = np.unique(known, axis=1, return_inverse=True)
    for index in range(patterns.shape[1]):
        if patterns[:, index].any():
            yield patterns[:, index], np.flatnonzero(group.ravel() == index)
