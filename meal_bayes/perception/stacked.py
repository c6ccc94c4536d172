"""The default recipe: closed-form kernel classifiers, pooled by a stacker [Wolpert1992].

A classifier for each modality, and one for all of them at once.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.perception.ensemble import KernelFit
from meal_bayes.perception.leave_out import (
    KernelProblem,
    all_objects,
    each_object,
    kernel_problem,
    leave_out,
    problems,
)
from meal_bayes.perception.modality import with_joint
from meal_bayes.perception.recordings import BehaviorRecordings
from meal_bayes.perception.settings import PerceptionSettings

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Stacker:
    """A class-balanced logistic regression on M classifiers' decisions."""

    weights: Floats  # (P,1+M) intercept and slopes

    def __post_init__(self) -> None:
        set_frozen(self, weights=freeze(self.weights))

    def log_odds(self, decisions: Floats) -> Floats:
        """Log-odds with prior 1/2, (B,P), from decisions (B,M,P)."""
        slopes: Floats = np.einsum("bmp,pm->bp", decisions, self.weights[:, 1:])
        return slopes + self.weights[:, 0]


def fit_stacked(recordings: BehaviorRecordings, settings: PerceptionSettings) -> KernelFit:
    """Fit one behavior: its classifiers, their stackers, and the nested outputs.

    The nested output on a recording comes from classifiers and stackers that never saw its object;
    it is NaN where the label is unknown.
    """
    labels = recordings.labels
    groups = recordings.objects if settings.by_object else np.arange(len(labels))
    grams = with_joint(recordings.grams) if settings.joint else recordings.grams
    n_kernels, (n, n_attributes) = len(grams), labels.shape
    dual = np.zeros((n_kernels, n_attributes, n))
    weights = np.zeros((n_attributes, 1 + n_kernels))
    nested = np.full((n, n_attributes), np.nan)
    for known, attributes, problem in problems(grams, labels, groups, settings.noise):
        weights[attributes] = all_objects(problem, settings)
        nested[np.ix_(known, attributes)] = each_object(problem, settings, weights[attributes])
        dual[np.ix_(np.arange(n_kernels), attributes, known)] = problem.duals
    return KernelFit(dual, np.zeros((n_kernels, n_attributes)), Stacker(weights), nested)


def stacked_outputs(
    recordings: BehaviorRecordings, held: Ints, settings: PerceptionSettings
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables.

    Parameters
    ----------
    recordings : all of the behavior; of each object all labels are known, or none.
    held : (H,) the objects to hold out.

    Returns
    -------
    The outputs on held-out objects, (n,P), and for each held-out one those on the others, (H,n,P);
    NaN where none was computed.
    """
    grams = with_joint(recordings.grams) if settings.joint else recordings.grams
    objects, known = recordings.objects, recordings.labels[:, 0] >= 0
    truth = recordings.labels[known] == 1
    problem = kernel_problem(grams[:, known][:, :, known], truth, objects[known], settings.noise)
    weights = all_objects(problem, settings)
    own = np.full(recordings.labels.shape, np.nan)
    own[known] = each_object(problem, settings, weights)
    # An object without labels or recordings is in no training set: what serves others serves it.
    training = np.tile(own, (len(held), 1, 1))
    pairs = _pairs(problem, held)
    both = leave_out(problem, pairs, settings, weights).log_odds  # (S,P,2,R)
    index = {name: h for h, name in enumerate(held.tolist())}
    rows = {name: np.flatnonzero(objects == name) for name in np.unique(objects).tolist()}
    for (first, second), outputs in zip(problem.objects[pairs].tolist(), both, strict=True):
        for out, other, side in ((first, second, 1), (second, first, 0)):
            if out in index:
                there = rows[other]
                training[index[out], there] = outputs[:, side, : len(there)].T
    for name, h in index.items():
        training[h, rows.get(name, [])] = np.nan
    across = grams[:, ~known][:, :, known]
    pooled = Stacker(weights).log_odds(np.einsum("mbn,mpn->bmp", across, problem.duals))
    own[~known] = pooled
    return own, training


def _pairs(problem: KernelProblem, held: Ints) -> Ints:
    """Unordered pairs of the problem's objects of which at least one is held out, (S,2)."""
    first, second = np.triu_indices(len(problem.objects), 1)
    wanted = np.isin(problem.objects, held)
    chosen = wanted[first] | wanted[second]
    return np.stack([first[chosen], second[chosen]], axis=1)
