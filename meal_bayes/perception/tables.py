"""Percept tables: every recording scored by classifiers that never saw its object.

Held-out outputs on object o come from classifiers and stackers that never saw o; the
training-side outputs on o' for held-out o from ones that saw neither, so that the stacker
behind them learned from decisions on o'' that saw none of the three. Means, standard deviations
and median distances are those of all recordings (labels have no part in them); the factor of
the kernels' widths is learned from all labels but those of o. Above the settings' exact sizes,
the folds of o, o' and o'' take their place.

The methods "paper" and "classifier" leave folds of objects out at any size (see `folds`).
"""

import hashlib
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from meal_bayes.arrays import Ints
from meal_bayes.datasets import Dataset, PerceptTable, TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, round_log_odds
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.perception.confusion import by_truth, youden
from meal_bayes.perception.fitting import Map, learned_widths, method_of
from meal_bayes.perception.recordings import BehaviorRecordings, gather, groups_of, number_in_object
from meal_bayes.perception.settings import NAMED, PerceptionSettings, with_classifier
from meal_bayes.perception.stacked import known_patterns
from meal_bayes.version import package_version

Halves = NDArray[np.float16]

_MOST = 255  # recordings of an object and behavior that a bin can count


def build_percept_table(
    dataset: Dataset,
    *,
    perception: str | PerceptionSettings = "default",
    classifier: Any = None,
    progress: Callable[[int, int], None] | None = None,
    each: Map = map,
) -> PerceptTable:
    """Compute the percept table of a data set.

    Parameters
    ----------
    dataset : Dataset
        Recordings and labels.
    perception : str | PerceptionSettings
        "default", "paper", or settings.
    classifier : Any
        Any scikit-learn classifier, in place of a method; see `with_classifier`.
    progress : Callable[[int, int], None] | None
        Called with (behaviors done, behaviors in all).
    each : Map
        Calls a function on every behavior, perhaps at once; results may come in any order.
    """
    if classifier is not None:
        if perception != "default":
            raise SettingsError("Give perception or a classifier, not both (see with_classifier).")
        perception = with_classifier(classifier)
    if isinstance(perception, str) and perception not in NAMED:
        raise SettingsError(unknown("perception", perception, NAMED))
    settings = NAMED[perception] if isinstance(perception, str) else perception
    if dataset.recordings > _MOST:
        raise SettingsError(f"{dataset.recordings} recordings of an object; give {_MOST} at most.")
    domain, n_objects = dataset.domain, len(dataset.objects)
    gathered = gather(dataset, TrainingSet.everything(dataset), settings, pairs=True)
    groups = groups_of(gathered.values(), n_objects, settings)
    names = np.unique(groups)
    _, widths = learned_widths(gathered.values(), settings, names, each)
    shape = (dataset.recordings, len(domain.behaviors), len(domain.attributes))
    log_odds = np.full((n_objects, *shape), np.nan, np.float16)
    bins = np.zeros((groups.max() + 1, n_objects, *shape[:0:-1], len(BIN_EDGES) + 1), np.uint8)
    score = partial(_score_behavior, names=names, widths=widths, groups=groups, settings=settings)
    for done, (e, outputs, shown) in enumerate(each(score, gathered.items())):
        objects = gathered[e].objects
        log_odds[objects, number_in_object(objects), e] = outputs
        bins[names, :, :, e] = shown
        if progress is not None:
            progress(done + 1, len(gathered))
    if settings.positive_youden_only:
        _neutralize(log_odds, bins, dataset.labels, groups)
    known = domain, dataset.objects, dataset.labels
    origin = _provenance(dataset, settings), dataset.recording_counts
    return PerceptTable(*known, log_odds, BIN_EDGES, bins, *origin, groups)


def _score_behavior(
    piece: tuple[int, BehaviorRecordings], names: Ints, widths: NDArray[np.float64], groups: Ints,
    settings: PerceptionSettings,
) -> tuple[int, Halves, NDArray[np.uint8]]:  # fmt: skip
    """Score one behavior, given by its number and recordings, without each group, (G,) names.

    Widths (G,) are those of the kernels. Returns the number, the held-out outputs (n,P), and how
    often the objects showed each fine bin without each group, (G,O,P,L).
    """
    index, recordings = piece
    n, n_attributes = recordings.labels.shape
    held_outputs = np.full((n, n_attributes), np.nan, np.float16)
    shown = np.zeros((len(names), len(groups), n_attributes, len(BIN_EDGES) + 1), np.uint8)
    objects, starts = np.unique(recordings.objects, return_index=True)
    with threadpool_limits(1):  # sums of many threads differ in their last bit from those of one
        for width in np.unique(widths):
            chosen = np.flatnonzero(widths == width)
            rows = np.isin(groups[recordings.objects], names[chosen])
            for _, attributes in known_patterns(recordings.labels >= 0):
                part = recordings.of(attributes).widened(width)
                log_odds, training = method_of(settings).outputs(part, names[chosen], settings)
                training[names[chosen][:, None] == groups[recordings.objects]] = np.nan
                held_outputs[np.ix_(rows, attributes)] = round_log_odds(log_odds)[rows]
                bins = np.searchsorted(BIN_EDGES, round_log_odds(training))  # (h,n,a)
                bins[np.isnan(training)] = -1
                for level in range(len(BIN_EDGES) + 1):
                    counts = np.add.reduceat(bins == level, starts, axis=1, dtype=np.uint8)
                    shown[..., level][np.ix_(chosen, objects, attributes)] = counts
    return index, held_outputs, shown


def _neutralize(log_odds: Halves, bins: NDArray[np.uint8], labels: Any, groups: Ints) -> None:
    """Set percepts to even odds, in place, where Youden's J <= 0 on the training side.

    Decided for each held-out group from the other groups alone.
    """
    even = int(np.searchsorted(BIN_EDGES, 0.0))
    for group, counts in enumerate(bins):
        uninformative = youden(by_truth(counts.astype(np.int64), labels).sum(axis=0)) <= 0  # (P,E)
        for o in np.flatnonzero(groups == group):
            computed = ~np.isnan(log_odds[o])
            log_odds[o][computed & uninformative.T] = 0.0
        recordings = counts.sum(axis=-1)
        counts[:, uninformative] = 0
        counts[:, uninformative, even] = recordings[:, uninformative]


def _provenance(dataset: Dataset, settings: PerceptionSettings) -> dict[str, str]:
    """Return what identifies a table: package, settings, recordings, command, classifier."""
    digest = hashlib.sha256(dataset.labels.tobytes())
    for context, values in sorted(dataset.features.items()):
        digest.update(repr(context).encode())
        digest.update(values.tobytes())
    data, classifier, kind = dataset.domain.data, settings.classifier, type(settings.classifier)
    home, name = SOURCES.get(data), f"{kind.__module__}:{kind.__qualname__}"
    options = {"paper": " --perception paper", "classifier": f" --classifier {name}"}
    names = (field.name for field in fields(settings) if field.name != "classifier")
    provenance = {
        "package": f"meal-bayes {package_version()}",
        "perception": ", ".join(f"{n}={getattr(settings, n)}" for n in names),
        "source": f"{home.repository}@{home.commit}" if home else "own data",
        "recordings_sha256": digest.hexdigest(),
        "command": f"meal-bayes data percepts --dataset {data}{options.get(settings.method, '')}",
    }
    if classifier is not None:
        provenance["classifier"] = name
        parameters = sorted(classifier.get_params().items())
        provenance["classifier_parameters"] = ", ".join(f"{n}={v!r}" for n, v in parameters)
    return provenance
