"""The default method: closed-form kernel classifiers, pooled by a stacker [Wolpert1992].

A classifier for each modality, and one for all of them at once.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Floats, Ints
from meal_bayes.perception.leave_out import (
    NOBODY,
    Problem,
    each_group,
    kernel_problem,
    known_patterns,
    landmark_problem,
    leave_out,
)
from meal_bayes.perception.perceiver import KernelFit
from meal_bayes.perception.recordings import BehaviorRecordings, dealt
from meal_bayes.perception.settings import PerceptionSettings

NOISE = 0.15  # lambda of C = K + lambda I


class Stacker(NamedTuple):
    """A class-balanced logistic regression on M classifiers' decisions: `weights` (P,1+M)."""

    weights: Floats

    def log_odds(self, decisions: Floats) -> Floats:
        """Return log-odds with prior 1/2, (B,P), from decisions (B,M,P); NaN counts as 0."""
        slopes: Floats = np.einsum("bmp,pm->bp", np.nan_to_num(decisions), self.weights[:, 1:])
        return slopes + self.weights[:, 0]


class Part(NamedTuple):
    """Attributes (a,) whose labels are known together, and the problem of these recordings.

    Rows (r,) are the recordings, group by group; columns (c,) what the problem's duals weigh, of
    what recordings are compared with.
    """

    rows: Ints
    attributes: Ints
    columns: Ints
    problem: Problem


def parts(
    recordings: BehaviorRecordings, kernels: Floats, settings: PerceptionSettings, by_object: bool
) -> Iterator[Part]:
    """Yield the problems of one behavior, by which labels are known together.

    What is left out as one are objects, or folds of them where there are many; not `by_object`,
    recordings or folds of recordings.
    """
    n, landmarks = len(recordings.objects), recordings.landmarks
    objects = recordings.objects if by_object else np.arange(n)
    groups = objects if landmarks is None else dealt(objects, settings.folds)
    for known, attributes in known_patterns(recordings.labels >= 0):
        rows = np.flatnonzero(known)
        rows = rows[np.argsort(groups[rows], kind="stable")]
        truth = recordings.labels[np.ix_(rows, attributes)] == 1
        columns = rows if landmarks is None else np.arange(len(landmarks))
        if landmarks is None:
            problem = kernel_problem(kernels[:, rows][:, :, rows], truth, groups[rows], NOISE)
        else:
            near, names = (kernels[:, rows], kernels[:, landmarks]), (groups[rows], objects[rows])
            problem = landmark_problem(*near, truth, names, NOISE)
        yield Part(rows, attributes, columns, problem)


def fit(recordings: BehaviorRecordings, settings: PerceptionSettings) -> tuple[KernelFit, Floats]:
    """Fit one behavior: its classifiers and their stackers; and its nested outputs, (n,P).

    The nested output on a recording comes from classifiers and stackers that never saw its object;
    it is NaN where the label is unknown.
    """
    kernels = recordings.kernels(joint=settings.joint)
    (n_kernels, _, m), (n, n_attributes) = kernels.shape, recordings.labels.shape
    dual = np.zeros((n_kernels, n_attributes, m))
    weights = np.zeros((n_attributes, 1 + n_kernels))
    nested = np.full((n, n_attributes), np.nan)
    for part in parts(recordings, kernels, settings, settings.by_object):
        attributes, problem = part.attributes, part.problem
        weights[attributes] = leave_out(problem, NOBODY, settings).weights[0]
        nested[np.ix_(part.rows, attributes)] = each_group(problem, settings, weights[attributes])
        dual[np.ix_(np.arange(n_kernels), attributes, part.columns)] = problem.duals
    return KernelFit(dual, Stacker(weights)), nested


def outputs(
    recordings: BehaviorRecordings, held: Ints, settings: PerceptionSettings
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables; of each object all labels are known, or none.

    Held (H,) are objects, or folds of them where there are many (see `dealt`). Returns the outputs
    (n,P) on what is held out, and for each of it those on the others, (H,n,P), NaN where none was
    computed; on itself they mean nothing.
    """
    kernels = recordings.kernels(joint=settings.joint)
    (part,) = parts(recordings, kernels, settings, by_object=True)
    problem = part.problem
    weights = leave_out(problem, NOBODY, settings).weights[0]
    held_outputs = np.full(recordings.labels.shape, np.nan)
    held_outputs[part.rows] = each_group(problem, settings, weights)
    # An object without labels or recordings is in no training set: what serves others serves it.
    training = np.tile(held_outputs, (len(held), 1, 1))
    # Unordered pairs of groups, at least one held out: each gives the training side of the other.
    pairs = np.stack(np.triu_indices(len(problem.groups), 1), axis=1)
    pairs = pairs[np.isin(problem.groups[pairs], held).any(axis=1)]
    both = leave_out(problem, pairs, settings, weights).log_odds
    rows = [part.rows[start:end] for start, end in pairwise(problem.starts)]
    for (first, second), scores in zip(pairs.tolist(), both, strict=True):
        of_first, of_second = np.split(scores.T, [len(rows[first])])
        training[np.ix_(held == problem.groups[first], rows[second])] = of_second
        training[np.ix_(held == problem.groups[second], rows[first])] = of_first
    unknown = np.setdiff1d(np.arange(len(held_outputs)), part.rows)
    across = kernels[:, unknown][:, :, part.columns]
    decisions = np.einsum("mbn,mpn->bmp", across, problem.duals)
    held_outputs[unknown] = Stacker(weights).log_odds(decisions)
    return held_outputs, training
