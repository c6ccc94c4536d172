"""Percept tables: every recording seen by classifiers that never saw its object."""

import hashlib
import inspect
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from meal_bayes.datasets import Dataset, PerceptTable, TrainingSet, object_index
from meal_bayes.datasets.percepts import BIN_EDGES, round_log_odds
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.errors import SettingsError
from meal_bayes.perception.confusion import believable, by_truth
from meal_bayes.perception.leave_out import known_patterns
from meal_bayes.perception.recipes import recipe_of
from meal_bayes.perception.recordings import (
    BehaviorRecordings,
    all_recordings_of,
    groups_of,
    number_in_object,
)
from meal_bayes.perception.settings import PerceptionSettings, named_settings, with_classifier
from meal_bayes.perception.width import Map, learned_widths
from meal_bayes.version import package_version

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

    Held-out outputs on object o come from classifiers and stackers that never saw o; the
    training-side outputs on o' for held-out o from ones that saw neither, so that the stacker
    behind them learned from decisions on o'' that saw none of the three. Means, spreads and median
    distances are those of all recordings (labels play no part in them); by which factor kernels
    are wider is learned from all labels but those of o. Above the settings' exact sizes, the folds
    of o, o' and o'' take their place: what is learned without o is learned without its whole fold.

    The paper's recipe scores the training side, and learns its calibration and weights, by grouped
    folds of objects rather than by single objects; all that is done for held-out o leaves o's
    whole fold out, but for the support vector machine that scores o itself. A classifier of one's
    own leaves the whole fold out for everything.

    Parameters
    ----------
    perception : "default", "paper", or settings.
    classifier : any scikit-learn classifier, in place of a recipe; see `with_classifier`.
    attributes, objects : what to compute; all by default. The rest is NaN.
    progress : called with (behaviors done, behaviors in all).
    each : calls a function on every behavior, perhaps at once; results may come in any order.
    """
    settings = _settings(perception, classifier)
    domain = dataset.domain
    columns = _positions("attributes", attributes, domain.attributes, domain.attribute_index)
    held = _positions("objects", objects, dataset.objects, partial(object_index, dataset.objects))
    n_objects, n_attributes = dataset.labels.shape
    if dataset.recordings > _MOST:
        raise SettingsError(f"{dataset.recordings} recordings of an object; give {_MOST} at most.")
    everything = TrainingSet.everything(dataset)
    gathered = {
        domain.behavior_index(name): recordings
        for name, recordings in all_recordings_of(dataset, everything, settings).items()
    }
    groups = groups_of(gathered, n_objects, settings)
    held_groups = np.unique(groups[held])
    _, widths = learned_widths(gathered.values(), settings, held_groups, each)
    shape = (dataset.recordings, len(domain.behaviors), n_attributes)
    log_odds = np.full((n_objects, *shape), np.nan, np.float16)
    n_bins = len(BIN_EDGES) + 1
    bins = np.zeros((groups.max() + 1, n_objects, *shape[:0:-1], n_bins), np.uint8)
    score = partial(
        _score_behavior,
        columns=columns,
        groups=groups,
        widths=dict(zip(held_groups.tolist(), widths.tolist(), strict=True)),
        settings=settings,
    )
    for done, (e, own, shown) in enumerate(each(score, gathered.items())):
        recorded = gathered[e].objects
        rows = np.flatnonzero(np.isin(recorded, held))
        place = recorded[rows, None], number_in_object(recorded)[rows, None]
        log_odds[:, :, e][*place, columns] = own[rows]
        bins[:, :, :, e][np.ix_(held_groups, np.arange(n_objects), columns)] = shown
        if progress is not None:
            progress(done + 1, len(gathered))
    if settings.believable_only:
        _silence(log_odds, bins, dataset.labels, groups)
    provenance = _provenance(dataset, settings)
    return PerceptTable(
        domain,
        dataset.objects,
        dataset.labels,
        log_odds,
        BIN_EDGES,
        bins,
        provenance,
        dataset.recording_counts,
        groups,
    )


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
    """Score one behavior by kernels of one width, rounded; see `stacked_outputs`."""
    n, n_attributes = recordings.labels.shape
    own = np.full((n, n_attributes), np.nan, np.float16)
    training = np.full((len(held), n, n_attributes), np.nan, np.float16)
    for _, attributes in known_patterns(recordings.labels >= 0):
        part = recordings.of(attributes)
        own_part, training_part = recipe_of(settings).outputs(part, held, settings)
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


def _silence(
    log_odds: Halves, bins: NDArray[np.uint8], labels: NDArray[np.int8], groups: NDArray[np.int64]
) -> None:
    """Let percepts say nothing where the training side does not support them, in place.

    Decided for each held-out group from the other groups alone.
    """
    n_bins = bins.shape[-1]
    nothing = int(np.searchsorted(BIN_EDGES, 0.0))
    for group, own in enumerate(bins):
        levels = own.reshape(*own.shape[:-1], 2, n_bins // 2).sum(axis=-1)
        silent = ~believable(by_truth(levels.astype(np.int64), labels))  # (P,E)
        for o in np.flatnonzero(groups == group):
            computed = ~np.isnan(log_odds[o])
            log_odds[o][computed & silent.T] = 0.0
        recordings = own.sum(axis=-1)
        own[:, silent] = 0
        own[:, silent, nothing] = recordings[:, silent]


def _provenance(dataset: Dataset, settings: PerceptionSettings) -> dict[str, str]:
    """Tell how the table came about."""
    digest = hashlib.sha256(dataset.labels.tobytes())
    for context, values in sorted(dataset.features.items()):
        digest.update(repr(context).encode())
        digest.update(values.tobytes())
    data = dataset.domain.data
    home = SOURCES.get(data)
    option = {"paper": " --perception paper"}
    if settings.classifier is not None:
        kind = type(settings.classifier)
        option["classifier"] = f" --classifier {kind.__module__}:{kind.__qualname__}"
    return {
        "package": f"meal-bayes {package_version()}",
        "perception": _told(settings),
        "source": f"{home.repository}@{home.commit}" if home else "own data",
        "recordings_sha256": digest.hexdigest(),
        "command": f"meal-bayes data percepts --dataset {data}{option.get(settings.recipe, '')}",
        **_classifier_provenance(settings.classifier),
    }


def _told(settings: PerceptionSettings) -> str:
    values = {field.name: getattr(settings, field.name) for field in fields(settings)}
    del values["classifier"]  # it has entries of its own
    return ", ".join(f"{name}={value}" for name, value in values.items())


def _classifier_provenance(classifier: Any) -> dict[str, str]:
    """Return what a classifier is: its parameters, and the source or the package it comes from."""
    if classifier is None:
        return {}
    kind = type(classifier)
    package = kind.__module__.partition(".")[0]
    parameters = {name: repr(value) for name, value in sorted(classifier.get_params().items())}
    found = {
        "classifier": f"{kind.__module__}:{kind.__qualname__}",
        "classifier_parameters": ", ".join(f"{name}={text}" for name, text in parameters.items()),
    }
    version = getattr(sys.modules.get(package), "__version__", None)
    if isinstance(version, str):
        return {**found, "classifier_package": f"{package} {version}"}
    return {**found, "classifier_source_sha256": _source_digest(kind)}


def _source_digest(kind: type) -> str:
    try:
        source = Path(inspect.getfile(kind)).read_bytes()
    except (OSError, TypeError):  # typed at a prompt
        return "unknown"
    return hashlib.sha256(source).hexdigest()
