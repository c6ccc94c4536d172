"""Fitting Psi, and how good percepts of unseen objects are: cross-validation inside D."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of, round_log_odds
from meal_bayes.perception import stacked
from meal_bayes.perception.confusion import ConfusionCounts, positive_youden
from meal_bayes.perception.ensemble import BehaviorClassifier, BehaviorFit, Perception
from meal_bayes.perception.recordings import BehaviorRecordings, Kernels, gather
from meal_bayes.perception.settings import DEFAULT, PerceptionSettings
from meal_bayes.perception.width import learned_widths

Floats = NDArray[np.float64]


class Method(Protocol):
    """A module that fits one behavior, and scores one behavior for the percept tables."""

    def fit(self, recordings: BehaviorRecordings, settings: PerceptionSettings) -> BehaviorFit:
        """Fit classifiers and pool; see `stacked.fit`."""
        ...

    def outputs(
        self,
        recordings: BehaviorRecordings,
        held: NDArray[np.int64],
        settings: PerceptionSettings,
    ) -> tuple[Floats, Floats]:
        """Score held-out and training objects; see `stacked.outputs`."""
        ...


def method_of(settings: PerceptionSettings) -> Method:
    """Return the method that the settings name."""
    if settings.method == "stacked":
        return stacked
    from meal_bayes.perception import classifier  # noqa: PLC0415  scikit-learn takes a second

    return classifier


class FittedBehavior(NamedTuple):
    """One behavior's classifiers, and how good they are.

    Attributes
    ----------
    behavior : int
        Its index.
    recordings : BehaviorRecordings
        They were fitted to, with the kernels' learned width.
    fit : BehaviorFit
        The classifiers.
    used : NDArray[np.bool_]
        (P,) whose percepts are used; the others are at even odds.
    counts : NDArray[np.int64]
        (O,P,2,K) percepts of objects that the classifiers behind them never saw.
    """

    behavior: int
    recordings: BehaviorRecordings
    fit: BehaviorFit
    used: NDArray[np.bool_]
    counts: NDArray[np.int64]


def fitted_behaviors(
    gathered: Mapping[int, BehaviorRecordings], n_objects: int, settings: PerceptionSettings
) -> Iterator[FittedBehavior]:
    """Fit behavior by behavior, with the width that all their labels choose."""
    width, _ = learned_widths(gathered.values(), settings)
    for e, narrow in gathered.items():
        recordings = narrow.widened(width)
        fit = method_of(settings).fit(recordings, settings)
        used = np.ones(fit.nested.shape[1], np.bool_)
        if settings.positive_youden_only:
            yes_no = _count(recordings, fit.nested, 2, n_objects)
            used = positive_youden(ConfusionCounts(yes_no[:, :, None]))[:, 0]
        nested = np.where(used, fit.nested, 0.0)
        counts = _count(recordings, nested, settings.levels, n_objects)
        yield FittedBehavior(e, recordings, fit, used, counts)


def _count(
    recordings: BehaviorRecordings, nested: Floats, levels: int, n_objects: int
) -> NDArray[np.int64]:
    """Count the levels of nested outputs (n,P) by object and truth, (O,P,2,K)."""
    shown = levels_of(round_log_odds(nested), BIN_EDGES, levels)
    counts = np.zeros((n_objects, nested.shape[1], 2, levels), np.int64)
    row, attribute = np.nonzero(recordings.labels >= 0)
    truth, level = recordings.labels[row, attribute], shown[row, attribute]
    place: tuple[Any, ...] = (recordings.objects[row], attribute, truth, level)
    np.add.at(counts, place, 1)
    return counts


def _no_counts(dataset: Dataset, settings: PerceptionSettings) -> NDArray[np.int64]:
    domain = dataset.domain
    shape = len(dataset.objects), len(domain.attributes), len(domain.behaviors)
    return np.zeros((*shape, 2, settings.levels), np.int64)


def fit_and_validate(
    dataset: Dataset,
    training_set: TrainingSet,
    *,
    settings: PerceptionSettings = DEFAULT,
    kernels: Kernels | None = None,
) -> tuple[Perception, ConfusionCounts]:
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
    kernels : Kernels, optional
        Spaces that were fitted before; by default they are fitted to D.

    Returns
    -------
    Perception
        Fitted to all of D.
    ConfusionCounts
        Percepts of each training object by classifiers that never saw it.
    """
    domain, counts, classifiers = dataset.domain, _no_counts(dataset, settings), {}
    gathered = gather(dataset, training_set, settings, kernels)
    for e, recordings, fit, used, tally in fitted_behaviors(gathered, len(counts), settings):
        counts[:, :, e] = tally
        behavior = domain.behaviors[e]
        spaces = [space.widened(recordings.width) for space in recordings.compared]
        wide = dict(zip(behavior.modalities, spaces, strict=True))
        classifiers[behavior.name] = BehaviorClassifier(wide, fit, used)
    perception = Perception(domain, classifiers, dataset.labels, settings.levels)
    return perception, ConfusionCounts(counts)


def fit_and_score(
    kernels: Kernels,
    training_set: TrainingSet,
    objects: NDArray[np.intp],
    *,
    settings: PerceptionSettings = DEFAULT,
) -> tuple[NDArray[np.float16], ConfusionCounts]:
    """Fit Psi on a training set, and score all recordings of some objects.

    Parameters
    ----------
    kernels : Kernels
        Spaces of all recordings.
    training_set : TrainingSet
        Recordings to learn from.
    objects : NDArray[np.intp]
        Whose recordings are scored.
    settings : PerceptionSettings
        The method.

    Returns
    -------
    NDArray[np.float16]
        (O,R,E,P) log-odds of the objects' recordings; NaN of everything else.
    ConfusionCounts
        Such percepts of training objects that they never saw; see `fit_and_validate`.
    """
    dataset, domain = kernels.dataset, kernels.dataset.domain
    counts, every = _no_counts(dataset, settings), np.arange(dataset.recordings)
    (n_objects, n_attributes, n_behaviors), r = counts.shape[:3], dataset.recordings
    log_odds = np.full((n_objects, r, n_behaviors, n_attributes), np.nan, np.float16)
    senses = np.array([bool(behavior.modalities) for behavior in domain.behaviors])
    log_odds[np.ix_(objects, every, senses)] = 0.0
    scored = (np.asarray(objects)[:, None] * r + every).ravel()
    gathered = gather(dataset, training_set, settings, kernels)
    for e, recordings, fit, used, tally in fitted_behaviors(gathered, n_objects, settings):
        counts[:, :, e] = tally
        rows = [space.rows for space in kernels.spaces_of(domain.behaviors[e].name, scored)]
        outputs = np.where(used, fit.scored(recordings.compared, rows, recordings.width), 0.0)
        log_odds[objects, :, e] = round_log_odds(outputs).reshape(len(objects), r, -1)
    log_odds[every[:, None] >= dataset.recording_counts[:, None]] = np.nan
    return log_odds, ConfusionCounts(counts)
