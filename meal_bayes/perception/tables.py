"""Percept tables: every recording seen by classifiers that never saw its object."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from importlib import metadata

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, PerceptTable, object_index
from meal_bayes.datasets.percepts import BIN_EDGES, level_edges, round_log_odds
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.perception.confusion import believable, by_truth
from meal_bayes.perception.leave_out import (
    KernelProblem,
    all_objects,
    each_object,
    kernel_problem,
    known_patterns,
    leave_out,
)
from meal_bayes.perception.modality import fit_space
from meal_bayes.perception.settings import PerceptionSettings, named_settings

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
    behind them learned from decisions on o'' that saw none of the three. Means, spreads and kernel
    widths are those of all recordings (labels play no part in them).

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
    columns = _positions(attributes, domain.attributes, domain.attribute_index)
    held = _positions(objects, dataset.objects, lambda name: object_index(dataset.objects, name))
    n_objects, n_attributes = dataset.labels.shape
    n_bins = len(BIN_EDGES) + 1
    log_odds = np.full(
        (n_objects, dataset.recordings, len(domain.behaviors), n_attributes), np.nan, np.float16
    )
    bins = np.zeros(
        (n_objects, n_objects, n_attributes, len(domain.behaviors), n_bins), np.uint8
    )
    sensing = [i for i, behavior in enumerate(domain.behaviors) if behavior.modalities]
    for done, index in enumerate(sensing):
        modalities = [
            dataset.features[domain.behaviors[index].name, modality]
            for modality in domain.behaviors[index].modalities
        ]
        own, training = _behavior_outputs(modalities, dataset.labels[:, columns], held, settings)
        log_odds[np.ix_(held, range(dataset.recordings), [index], columns)] = own[held][:, :, None]
        bins[:, :, columns, index] = _histograms(training)
        if progress is not None:
            progress(done + 1, len(sensing))
    if settings.believable_only:
        _silence(log_odds, bins, dataset.labels)
    provenance = _provenance(dataset, settings)
    return PerceptTable(
        domain, dataset.objects, dataset.labels, log_odds, BIN_EDGES, bins, provenance
    )


def _positions(
    names: Iterable[str] | None, known: Sequence[str], find: Callable[[str], int]
) -> NDArray[np.int64]:
    return np.array(sorted({find(name) for name in (known if names is None else names)}))


def _behavior_outputs(
    modalities: Sequence[NDArray[np.float32]],
    labels: NDArray[np.int8],
    held: NDArray[np.int64],
    settings: PerceptionSettings,
) -> tuple[Halves, Halves]:
    """Outputs of one behavior from features (O,R,D) and labels (O,P).

    Returns the held-out ones, (O,R,P), and for held-out o those on each o', (O,O,R,P); NaN where
    none was computed.
    """
    n_objects, n_recordings = modalities[0].shape[:2]
    grams = np.stack(
        [
            fit_space(values.reshape(n_objects * n_recordings, -1), settings.kernel).gram()
            for values in modalities
        ]
    )
    n_attributes = labels.shape[1]
    own = np.full((n_objects, n_recordings, n_attributes), np.nan, np.float16)
    training = np.full((n_objects, *own.shape), np.nan, np.float16)
    for known, attributes in known_patterns(labels >= 0):
        part = labels[:, attributes]
        if settings.recipe == "paper":
            from meal_bayes.perception.paper import paper_outputs  # noqa: PLC0415  scikit-learn

            own_part, training_part = paper_outputs(grams, part, known, held, settings)
        else:
            own_part, training_part = _stacked_outputs(grams, part, known, held, settings)
        own[:, :, attributes] = round_log_odds(own_part)
        training[..., attributes] = round_log_odds(training_part)
    return own, training


def _stacked_outputs(
    grams: Floats,
    labels: NDArray[np.int8],
    known: NDArray[np.bool_],
    held: NDArray[np.int64],
    settings: PerceptionSettings,
) -> tuple[Floats, Floats]:
    n_objects, n_attributes = labels.shape
    n_recordings = grams.shape[1] // n_objects
    rows = np.repeat(known, n_recordings)
    names = np.flatnonzero(known)
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
    both = leave_out(problem, pairs, settings, weights)[1].transpose(0, 2, 3, 1)  # (S,2,R,P)
    first, second = names[pairs.T]
    training[first, second], training[second, first] = both[:, 1], both[:, 0]
    # An object whose label is unknown is in no training set: what serves the others serves it.
    unknown = np.flatnonzero(~known)
    training[np.ix_(unknown, names)] = own[names]
    across = grams[:, ~rows][:, :, rows]  # (M,B,n)
    decisions = np.einsum("mbn,mpn->bmp", across, problem.duals)
    pooled = np.einsum("bmp,pm->bp", decisions, weights[:, 1:]) + weights[:, 0]
    own[unknown] = pooled.reshape(len(unknown), n_recordings, n_attributes)
    return own, training


def _pairs(problem: KernelProblem, held: NDArray[np.int64]) -> NDArray[np.int64]:
    """Unordered pairs of the problem's objects of which at least one is held out, (S,2)."""
    first, second = np.triu_indices(len(problem.objects), 1)
    wanted = np.isin(problem.objects, held)
    chosen = wanted[first] | wanted[second]
    return np.stack([first[chosen], second[chosen]], axis=1)


def _histograms(training: Halves) -> NDArray[np.uint8]:
    """Count the recordings in each fine bin, (O,O,R,P) -> (O,O,P,L)."""
    place = np.searchsorted(BIN_EDGES, training)
    place[np.isnan(training)] = -1
    counts = [(place == level).sum(axis=2) for level in range(len(BIN_EDGES) + 1)]
    return np.stack(counts, axis=-1).astype(np.uint8)


def _silence(
    log_odds: Halves, bins: NDArray[np.uint8], labels: NDArray[np.int8]
) -> None:
    """Let percepts say nothing where the training side does not support them, in place.

    Decided for each held-out object from the other objects alone.
    """
    n_bins = bins.shape[-1]
    level_edges(BIN_EDGES, 2)
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
