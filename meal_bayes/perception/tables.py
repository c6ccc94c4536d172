"""Percept tables: every recording seen by classifiers that never saw its object."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from functools import partial
from importlib import metadata

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, PerceptTable, TrainingSet, object_index
from meal_bayes.datasets.percepts import BIN_EDGES, round_log_odds
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.errors import SettingsError
from meal_bayes.perception.confusion import believable, by_truth
from meal_bayes.perception.leave_out import known_patterns
from meal_bayes.perception.recipes import recipe_of
from meal_bayes.perception.recordings import all_recordings_of
from meal_bayes.perception.settings import PerceptionSettings, named_settings
from meal_bayes.perception.width import learned_widths

Floats = NDArray[np.float64]
Halves = NDArray[np.float16]

Progress = Callable[[int, int], None]


def build_percept_table(
    dataset: Dataset,
    *,
    perception: str | PerceptionSettings = "default",
    attributes: Iterable[str] | None = None,
    objects: Iterable[str] | None = None,
    progress: Progress | None = None,
) -> PerceptTable:
    """Compute the percept table of a data set.

    Held-out outputs on object o come from classifiers and stackers that never saw o; the
    training-side outputs on o' for held-out o from ones that saw neither, so that the stacker
    behind them learned from decisions on o'' that saw none of the three. Means, spreads and median
    distances are those of all recordings (labels play no part in them); by which factor kernels
    are wider is learned from all labels but those of o.

    The paper's recipe scores the training side, and learns its calibration and weights, by grouped
    folds of objects rather than by single objects; all that is done for held-out o leaves o's
    whole fold out, but for the support vector machine that scores o itself.

    Parameters
    ----------
    perception : "default", "paper", or settings.
    attributes, objects : what to compute; all by default. The rest is NaN.
    progress : called with (behaviors done, behaviors in all).
    """
    settings = named_settings(perception) if isinstance(perception, str) else perception
    domain = dataset.domain
    columns = _positions("attributes", attributes, domain.attributes, domain.attribute_index)
    held = _positions("objects", objects, dataset.objects, partial(object_index, dataset.objects))
    n_objects, n_attributes = dataset.labels.shape
    n_bins = len(BIN_EDGES) + 1
    log_odds = np.full(
        (n_objects, dataset.recordings, len(domain.behaviors), n_attributes), np.nan, np.float16
    )
    bins = np.zeros((n_objects, n_objects, n_attributes, len(domain.behaviors), n_bins), np.uint8)
    everything = TrainingSet.everything(dataset)
    gathered = {
        domain.behavior_index(name): recordings
        for name, (recordings, _) in all_recordings_of(dataset, everything, settings.kernel).items()
    }
    _, widths = learned_widths(list(gathered.values()), settings, held)
    for done, (index, recordings) in enumerate(gathered.items()):
        for width in np.unique(widths):
            some = held[widths == width]
            own, training = _behavior_outputs(
                recordings.widened(width).grams, dataset.labels[:, columns], some, settings
            )
            behavior = log_odds[:, :, index]
            behavior[np.ix_(some, np.arange(dataset.recordings), columns)] = own[some]
            place = np.ix_(some, np.arange(n_objects), columns)
            bins[:, :, :, index][place] = _histograms(training[some])
        if progress is not None:
            progress(done + 1, len(gathered))
    if settings.believable_only:
        _silence(log_odds, bins, dataset.labels)
    provenance = _provenance(dataset, settings)
    return PerceptTable(
        domain, dataset.objects, dataset.labels, log_odds, BIN_EDGES, bins, provenance
    )


def _positions(
    what: str, names: Iterable[str] | None, known: Sequence[str], find: Callable[[str], int]
) -> NDArray[np.int64]:
    found = sorted({find(name) for name in (known if names is None else names)})
    if not found:
        raise SettingsError(f"{what} is empty; name at least one, or leave it out for all.")
    return np.array(found)


def _behavior_outputs(
    grams: Floats,
    labels: NDArray[np.int8],
    held: NDArray[np.int64],
    settings: PerceptionSettings,
) -> tuple[Halves, Halves]:
    """Score one behavior from kernels (M,n,n) and labels (O,P).

    Returns the held-out ones, (O,R,P), and for held-out o those on each o', (O,O,R,P); NaN where
    none was computed.
    """
    n_objects, n_attributes = labels.shape
    n_recordings = grams.shape[1] // n_objects
    own = np.full((n_objects, n_recordings, n_attributes), np.nan, np.float16)
    training = np.full((n_objects, *own.shape), np.nan, np.float16)
    for known, attributes in known_patterns(labels >= 0):
        part = labels[:, attributes]
        own_part, training_part = recipe_of(settings).outputs(grams, part, known, held, settings)
        own[:, :, attributes] = round_log_odds(own_part)
        training[..., attributes] = round_log_odds(training_part)
    return own, training


def _histograms(training: Halves) -> NDArray[np.uint8]:
    """Count the recordings in each fine bin, (H,O,R,P) -> (H,O,P,L)."""
    place = np.searchsorted(BIN_EDGES, training)
    place[np.isnan(training)] = -1
    counts = [(place == level).sum(axis=2) for level in range(len(BIN_EDGES) + 1)]
    return np.stack(counts, axis=-1).astype(np.uint8)


def _silence(log_odds: Halves, bins: NDArray[np.uint8], labels: NDArray[np.int8]) -> None:
    """Let percepts say nothing where the training side does not support them, in place.

    Decided for each held-out object from the other objects alone.
    """
    n_bins = bins.shape[-1]
    nothing = int(np.searchsorted(BIN_EDGES, 0.0))
    for o in range(len(labels)):
        levels = bins[o].reshape(*bins.shape[1:-1], 2, n_bins // 2).sum(axis=-1)
        silent = ~believable(by_truth(levels.astype(np.int64), labels))  # (P,E)
        computed = ~np.isnan(log_odds[o])
        log_odds[o][computed & silent.T] = 0.0
        recordings = bins[o].sum(axis=-1)
        bins[o][:, silent] = 0
        bins[o][:, silent, nothing] = recordings[:, silent]


def _provenance(dataset: Dataset, settings: PerceptionSettings) -> dict[str, str]:
    """Tell how the table came about."""
    digest = hashlib.sha256(dataset.labels.tobytes())
    for context, values in sorted(dataset.features.items()):
        digest.update(repr(context).encode())
        digest.update(values.tobytes())
    data = dataset.domain.data
    home = SOURCES.get(data)
    option = " --perception paper" if settings.recipe == "paper" else ""
    return {
        "package": f"meal-bayes {_version()}",
        "perception": ", ".join(f"{name}={value}" for name, value in asdict(settings).items()),
        "source": f"{home.repository}@{home.commit}" if home else "own data",
        "recordings_sha256": digest.hexdigest(),
        "command": f"meal-bayes data percepts --dataset {data}{option}",
    }


def _version() -> str:
    try:
        return metadata.version("meal-bayes")
    except metadata.PackageNotFoundError:  # run from a checkout
        return "unreleased"
