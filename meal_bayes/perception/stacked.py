"""The default recipe: closed-form kernel classifiers, pooled by a stacker [Wolpert1992].

A classifier for each modality, and one for all of them at once.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.perception.ensemble import BehaviorFit
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


def fit_stacked(recordings: BehaviorRecordings, settings: PerceptionSettings) -> BehaviorFit:
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
    return BehaviorFit(dual, np.zeros((n_kernels, n_attributes)), Stacker(weights), nested)


def stacked_outputs(
    grams: Floats,
    labels: NDArray[np.int8],
    known: NDArray[np.bool_],
    held: NDArray[np.int64],
    settings: PerceptionSettings,
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables.

    Parameters
    ----------
    grams : (M,n,n) between all recordings, a modality each, n = O R.
    labels : (O,P).
    known : (O,) the objects whose labels are known.
    held : the objects to hold out.

    Returns
    -------
    The outputs on held-out objects, (O,R,P), and for held-out o those on each o', (O,O,R,P); NaN
    where none was computed.
    """
    grams = with_joint(grams) if settings.joint else grams
    n_objects, n_attributes = labels.shape
    n_recordings = grams.shape[1] // n_objects
    rows, names = np.repeat(known, n_recordings), np.flatnonzero(known)
    problem = kernel_problem(
        grams[:, rows][:, :, rows],
        np.repeat(labels[known] == 1, n_recordings, axis=0),
        np.repeat(names, n_recordings),
        settings.noise,
    )
    weights = all_objects(problem, settings)
    own = np.full((n_objects, n_recordings, n_attributes), np.nan)
    own[known] = each_object(problem, settings, weights).reshape(-1, n_recordings, n_attributes)
    training = np.full((n_objects, *own.shape), np.nan)
    pairs = _pairs(problem, held)
    both = leave_out(problem, pairs, settings, weights).log_odds.transpose(0, 2, 3, 1)  # (S,2,R,P)
    first, second = names[pairs.T]
    training[first, second], training[second, first] = both[:, 1], both[:, 0]
    # An object whose label is unknown is in no training set: what serves the others serves it.
    unknown = np.flatnonzero(~known)
    training[np.ix_(unknown, names)] = own[names]
    across = grams[:, ~rows][:, :, rows]
    pooled = Stacker(weights).log_odds(np.einsum("mbn,mpn->bmp", across, problem.duals))
    own[unknown] = pooled.reshape(len(unknown), n_recordings, n_attributes)
    return own, training


def _pairs(problem: KernelProblem, held: NDArray[np.int64]) -> NDArray[np.int64]:
    """Unordered pairs of the problem's objects of which at least one is held out, (S,2)."""
    first, second = np.triu_indices(len(problem.objects), 1)
    wanted = np.isin(problem.objects, held)
    chosen = wanted[first] | wanted[second]
    return np.stack([first[chosen], second[chosen]], axis=1)
