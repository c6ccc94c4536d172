"""Percept tables: every recording scored by classifiers that never saw its object.

Held-out outputs on object o come from classifiers and stackers that never saw o; the
training-side outputs on o' for held-out o from ones that saw neither, so that the stacker
behind them learned from decisions on o'' that saw none of the three. Means, standard deviations
and median distances are those of all recordings (labels have no part in them); the factor of
the kernels' widths is learned from all labels but those of o. Above the settings' exact sizes,
the folds of o, o' and o'' take their place.

The methods "paper" and "classifier" leave folds of objects out at any size (see `folds`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from meal_bayes.datasets import Dataset, PerceptTable, TrainingSet, object_index
from meal_bayes.datasets.percepts import BIN_EDGES, round_log_odds
from meal_bayes.errors import SettingsError
from meal_bayes.perception.confusion import by_truth, positive_youden
from meal_bayes.perception.fitting import method_of
from meal_bayes.perception.leave_out import known_patterns
from meal_bayes.perception.provenance import provenance_of
from meal_bayes.perception.recordings import (
    BehaviorRecordings,
    gather,
    groups_of,
    number_in_object,
)
from meal_bayes.perception.settings import PerceptionSettings, named_settings, with_classifier
from meal_bayes.perception.width import Map, learned_widths

Halves = NDArray[np.float16]

_MOST = 255  # recordings of an object and behavior that a bin can count

Progress = Callable[[int, int], None]


def build_percept_table(
    dataset: Dataset,
    *,
    perception: str | PerceptionSettings = "default",
    classifier: Any = None,
    attributes: Iterable[str] | None = None,
    objects: Iterable[str] | None = None,
    progress: Progress | None = None,
    each: Map = map,
) -> PerceptTable:
    """Compute the percept table of a data set.

    Parameters
    ----------
    perception : "default", "paper", or settings.
    classifier : any scikit-learn classifier, in place of a method; see `with_classifier`.
    attributes, objects : what to compute; all by default. The rest is NaN.
    progress : called with (behaviors done, behaviors in all).
    each : calls a function on every behavior, perhaps at once; results may come in any order.
    """
    settings = _settings(perception, classifier)
    if dataset.recordings > _MOST:
        raise SettingsError(f"{dataset.recordings} recordings of an object; give {_MOST} at most.")
    domain, n_objects = dataset.domain, len(dataset.objects)
    columns = _positions("attributes", attributes, domain.attributes, domain.attribute_index)
    held = _positions("objects", objects, dataset.objects, partial(object_index, dataset.objects))
    gathered = gather(dataset, TrainingSet.everything(dataset), settings)
    groups = groups_of(gathered.values(), n_objects, settings)
    held_groups = np.unique(groups[held])
    _, widths = learned_widths(gathered.values(), settings, held_groups, each)
    shape = (dataset.recordings, len(domain.behaviors), len(domain.attributes))
    log_odds = np.full((n_objects, *shape), np.nan, np.float16)
    bins = np.zeros((groups.max() + 1, n_objects, *shape[:0:-1], len(BIN_EDGES) + 1), np.uint8)
    by_width = dict(zip(held_groups.tolist(), widths.tolist(), strict=True))
    score = partial(
        _score_behavior, columns=columns, groups=groups, widths=by_width, settings=settings
    )
    for done, (e, own, shown) in enumerate(each(score, gathered.items())):
        recorded = gathered[e].objects
        rows = np.flatnonzero(np.isin(recorded, held))
        place = recorded[rows, None], number_in_object(recorded)[rows, None]
        log_odds[:, :, e][*place, columns] = own[rows]
        bins[:, :, :, e][np.ix_(held_groups, np.arange(n_objects), columns)] = shown
        if progress is not None:
            progress(done + 1, len(gathered))
    if settings.positive_youden_only:
        _neutralize(log_odds, bins, dataset.labels, groups)
    made = BIN_EDGES, bins, provenance_of(dataset, settings), dataset.recording_counts, groups
    return PerceptTable(domain, dataset.objects, dataset.labels, log_odds, *made)


def _settings(perception: str | PerceptionSettings, classifier: Any) -> PerceptionSettings:
    if classifier is None:
        return named_settings(perception) if isinstance(perception, str) else perception
    if perception != "default":
        raise SettingsError("Give perception or a classifier, not both (see with_classifier).")
    return with_classifier(classifier)


def _positions(
    what: str, names: Iterable[str] | None, known: Sequence[str], find: Callable[[str], int]
) -> NDArray[np.int64]:
    found = sorted({find(name) for name in (known if names is None else names)})
    if not found:
        raise SettingsError(f"{what} is empty; name at least one, or leave it out for all.")
    return np.array(found)


def _score_behavior(
    piece: tuple[int, BehaviorRecordings],
    columns: NDArray[np.int64],
    groups: NDArray[np.int64],
    widths: Mapping[int, float],
    settings: PerceptionSettings,
) -> tuple[int, Halves, NDArray[np.uint8]]:
    """Score one behavior.

    Parameters
    ----------
    piece : its number and its recordings.
    columns : (p,) attributes.
    groups : (O,) what each object is left out with.
    widths : by what is held out (H,).

    Returns
    -------
    The behavior's number, the held-out outputs (n,p), and for each that is held out how often the
    objects showed each fine bin, (H,O,p,L).
    """
    index, recordings = piece
    held, factors = np.array(list(widths)), np.array(list(widths.values()))
    own = np.full((len(recordings.objects), len(columns)), np.nan, np.float16)
    shown = np.zeros((len(held), len(groups), len(columns), len(BIN_EDGES) + 1), np.uint8)
    with threadpool_limits(1):  # sums of many threads differ in their last bit from those of one
        for width in np.unique(factors):
            some = factors == width
            wide = recordings.of(columns).widened(width)
            outputs, training = _outputs(wide, held[some], settings)
            rows = np.isin(groups[recordings.objects], held[some])
            own[rows] = outputs[rows]
            shown[some] = _histograms(training, recordings.objects, len(groups))
    return index, own, shown


def _outputs(
    recordings: BehaviorRecordings, held: NDArray[np.int64], settings: PerceptionSettings
) -> tuple[Halves, Halves]:
    """Score one behavior by kernels of one width, rounded; see `stacked.outputs`."""
    n, n_attributes = recordings.labels.shape
    own = np.full((n, n_attributes), np.nan, np.float16)
    training = np.full((len(held), n, n_attributes), np.nan, np.float16)
    for _, attributes in known_patterns(recordings.labels >= 0):
        part = recordings.of(attributes)
        own_part, training_part = method_of(settings).outputs(part, held, settings)
        own[:, attributes] = round_log_odds(own_part)
        training[..., attributes] = round_log_odds(training_part)
    return own, training


def _histograms(training: Halves, objects: NDArray[np.int64], n_objects: int) -> NDArray[np.uint8]:
    """Count the recordings of each object in each fine bin, (H,n,P) -> (H,O,P,L)."""
    place = np.searchsorted(BIN_EDGES, training)
    place[np.isnan(training)] = -1
    held, _, n_attributes = training.shape
    counts = np.zeros((held, n_objects, n_attributes, len(BIN_EDGES) + 1), np.uint8)
    names, starts = np.unique(objects, return_index=True)
    for level in range(len(BIN_EDGES) + 1):
        shown = np.add.reduceat(place == level, starts, axis=1, dtype=np.uint8)
        counts[..., level][:, names] = shown
    return counts


def _neutralize(
    log_odds: Halves, bins: NDArray[np.uint8], labels: NDArray[np.int8], groups: NDArray[np.int64]
) -> None:
    """Set percepts to even odds, in place, where Youden's J <= 0 on the training side.

    Decided for each held-out group from the other groups alone.
    """
    n_bins = bins.shape[-1]
    even = int(np.searchsorted(BIN_EDGES, 0.0))
    for group, own in enumerate(bins):
        levels = own.reshape(*own.shape[:-1], 2, n_bins // 2).sum(axis=-1)
        uninformative = ~positive_youden(by_truth(levels.astype(np.int64), labels))  # (P,E)
        for o in np.flatnonzero(groups == group):
            computed = ~np.isnan(log_odds[o])
            log_odds[o][computed & uninformative.T] = 0.0
        recordings = own.sum(axis=-1)
        own[:, uninformative] = 0
        own[:, uninformative, even] = recordings[:, uninformative]
