"""Fitting Psi, and how good percepts of unseen objects are: cross-validation inside D.

All behaviors' kernels are wider by one factor, learned from the labels. A narrow kernel separates
objects where recordings are informative; a wide one has few smooth functions, as many as a few
objects of noisy recordings determine. The factor minimizes the loss of the stackers on decisions of
classifiers on objects that these never saw, summed over attributes and behaviors. A held-out
object's own labels have no part in it.
"""

from collections.abc import Callable, Iterable
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from meal_bayes.arrays import Floats, Ints
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of, round_log_odds
from meal_bayes.perception import stacked
from meal_bayes.perception.confusion import youden
from meal_bayes.perception.perceiver import BehaviorClassifier, Perception
from meal_bayes.perception.recordings import BehaviorRecordings, Spaces, gather
from meal_bayes.perception.settings import DEFAULT, PerceptionSettings
from meal_bayes.perception.stacked import NOBODY, Problem, leave_out, parts

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # as `map`, in any order

WIDTHS = (1.0, 1.5, 2.0)  # in median distances


def method_of(settings: PerceptionSettings) -> ModuleType:
    """Return the module of the method that the settings name, with `fit` and `outputs`."""
    if settings.method == "stacked":
        return stacked
    from meal_bayes.perception import classifier  # noqa: PLC0415  scikit-learn takes a second

    return classifier


def fit_and_validate(
    dataset: Dataset,
    training_set: TrainingSet,
    *,
    settings: PerceptionSettings = DEFAULT,
    spaces: Spaces | None = None,
) -> tuple[Perception, NDArray[np.int64]]:
    """Fit Psi of every behavior on the training set D, and cross-validate it.

    Cross-validation is nested over objects: for object o' both the classifiers and the rule that
    pools them are trained without o', and that rule learns only from decisions on objects that the
    classifiers behind them never saw. Above the settings' exact sizes, folds of objects take the
    place of objects. Each labelled instance is one count, at even odds where the other objects
    hold one class only.

    Parameters
    ----------
    dataset : Dataset
        Features and labels.
    training_set : TrainingSet
        The recordings of D.
    settings : PerceptionSettings
        The method.
    spaces : Spaces, optional
        Of `fit_spaces`, fitted before; by default they are fitted to D.

    Returns
    -------
    Perception
        Fitted to all of D.
    NDArray[np.int64]
        (O,P,E,2,K) percepts of each training object by classifiers that never saw it.
    """
    domain, classifiers = dataset.domain, {}
    shape = len(dataset.objects), len(domain.attributes), len(domain.behaviors)
    counts = np.zeros((*shape, 2, settings.levels), np.int64)
    gathered = gather(dataset, training_set, settings, spaces)
    width, _ = learned_widths(gathered.values(), settings)
    for e, recordings in gathered.items():
        fit, nested = method_of(settings).fit(recordings.widened(width), settings)
        used = np.ones(shape[1], np.bool_)
        if settings.positive_youden_only:
            used = youden(_count(recordings, nested, 2, len(counts)).sum(axis=0)) > 0
        shown = np.where(used, nested, 0.0)
        counts[:, :, e] = _count(recordings, shown, settings.levels, len(counts))
        wide = [space.widened(width) for space in recordings.compared]
        spaces_of = dict(zip(domain.behaviors[e].modalities, wide, strict=True))
        classifiers[domain.behaviors[e].name] = BehaviorClassifier(spaces_of, fit, used)
    return Perception(domain, classifiers, dataset.labels, settings.levels), counts


def _count(recordings: BehaviorRecordings, nested: Floats, levels: int, n_objects: int) -> Ints:
    """Count the levels of nested outputs (n,P) by object and truth, (O,P,2,K)."""
    shown = levels_of(round_log_odds(nested), BIN_EDGES, levels)
    counts = np.zeros((n_objects, nested.shape[1], 2, levels), np.int64)
    row, attribute = np.nonzero(recordings.labels >= 0)
    truth, level = recordings.labels[row, attribute], shown[row, attribute]
    np.add.at(counts, (recordings.objects[row], attribute, truth, level), 1)
    return counts


def learned_widths(
    behaviors: Iterable[BehaviorRecordings],
    settings: PerceptionSettings,
    held: Iterable[int] = (),
    each: Map = map,
) -> tuple[float, Floats]:
    """Learn the factor of the kernels' widths, by all labels, and without each held object's, (H,).

    Where the settings fix a width it is the factor; it is 1 of other methods than "stacked".
    Held are objects, or folds of them where there are many. `each` calls a function on every
    behavior, perhaps at once; results may come in any order.
    """
    groups = np.fromiter(held, np.int64)
    fixed = settings.width if settings.method == "stacked" else 1.0
    if fixed is not None:
        return fixed, np.full(len(groups), fixed)
    pieces = list(enumerate(behaviors))
    by_behavior = dict(each(partial(_losses_of_widths, held=groups, settings=settings), pieces))
    losses = np.zeros((len(WIDTHS), 1 + len(groups)))
    for index, _ in pieces:  # in their order, so that the sum is the same to the last bit
        losses += by_behavior[index]
    best = np.array(WIDTHS)[losses.argmin(axis=0)]
    return float(best[0]), best[1:]


def _losses_of_widths(
    piece: tuple[int, BehaviorRecordings], held: Ints, settings: PerceptionSettings
) -> tuple[int, Floats]:
    """Sum the stackers' losses over a behavior's attributes.

    Returns its number, and by width (W,1+H) the sums with all groups and without each held one.
    """
    index, recordings = piece
    total = np.zeros((len(WIDTHS), 1 + len(held)))
    with threadpool_limits(1):  # sums of many threads differ in their last bit from those of one
        for w, width in enumerate(WIDTHS):
            wide = recordings.widened(width)
            for part in parts(wide, wide.kernels(joint=settings.joint), settings, by_object=True):
                problem = part.problem
                everyone = leave_out(problem, NOBODY, settings)
                (all_losses,) = (everyone.losses * _votes(problem, NOBODY)).sum(axis=1)
                total[w] += all_losses
                present = np.flatnonzero(np.isin(held, problem.groups))
                sets = np.searchsorted(problem.groups, held[present])[:, None]
                without = leave_out(problem, sets, settings, everyone.weights[0])
                losses = (without.losses * _votes(problem, sets)).sum(axis=1)
                total[w, 1 + present] += losses - all_losses
    return index, total


def _votes(problem: Problem, sets: Ints) -> Floats:
    """Weight each attribute by its labels' variance without the sets, (S,P).

    A balanced loss is the noisier the smaller the rarer class.
    """
    true = np.add.reduceat((problem.targets > 0).astype(float), problem.starts[:-1], axis=1)
    sizes = np.diff(problem.starts)
    number = sizes.sum() - sizes[sets].sum(axis=1)
    fraction = (true.sum(axis=1) - true.T[sets].sum(axis=1)) / np.maximum(number, 1)[:, None]
    return np.asarray(fraction * (1.0 - fraction))
