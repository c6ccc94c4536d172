"""Fitting of classifiers Psi, their nested cross-validation, and percept tables.

In a percept table, every recording is scored by classifiers that were not trained on its object.
The held-out outputs on object o come from classifiers and stackers without o. The training-side
outputs on o' for held-out o come from classifiers and stackers without o and o'; such a stacker
learned from decisions on objects o'' by classifiers without o, o' and o''. Means, standard
deviations and median distances are those of all recordings, because they do not use labels. With
more objects or recordings than the settings' exact sizes, folds of objects are left out instead of
objects; the methods "paper" and "classifier" always leave out folds.
"""

import hashlib
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from meal_bayes.arrays import Floats, Ints, tiny_is_zero
from meal_bayes.datasets import Dataset, PerceptTable, TrainingSet
from meal_bayes.datasets.percepts import (
    BIN_COUNT,
    BIN_EDGES,
    STORED,
    classifier_levels,
    round_log_odds,
)
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.digests import package_version
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.files import command_line
from meal_bayes.perception import kernel_ridge
from meal_bayes.perception.confusion import by_truth, informative
from meal_bayes.perception.feature_spaces import (
    BehaviorRecordings,
    Spaces,
    gather,
    groups_of,
    number_in_object,
)
from meal_bayes.perception.kernel_ridge import Map, learned_widths
from meal_bayes.perception.perceiver import BehaviorClassifier, Perception
from meal_bayes.perception.settings import DEFAULT, NAMED, PerceptionSettings, with_classifier
from meal_bayes.threads import turn

Counts = NDArray[np.integer]  # of fine bins, `BIN_COUNT`
Stored = NDArray[np.floating]  # log-odds, `STORED`

_MOST_RECORDINGS = int(np.iinfo(BIN_COUNT).max)  # of an object and behavior, that a bin counts


def method_of(settings: PerceptionSettings) -> ModuleType:
    """Return the module of the method that the settings name, with `fit` and `outputs`."""
    if settings.method == "stacked":
        return kernel_ridge
    from meal_bayes.perception import fold_classifiers  # noqa: PLC0415  scikit-learn takes a second

    return fold_classifiers


@tiny_is_zero
def fit_and_validate(
    dataset: Dataset,
    training_set: TrainingSet,
    *,
    settings: PerceptionSettings = DEFAULT,
    spaces: Spaces | None = None,
) -> tuple[Perception, NDArray[np.int64]]:
    """Fit Psi of every behavior on the training set D, and cross-validate it.

    Cross-validation is nested over objects. For each object o', the classifiers and the rule that
    combines them are trained without o'. The rule learns only from decisions about objects on which
    the classifiers were not trained. Above the settings' exact sizes, folds of objects are left out
    instead of single objects. Each labeled instance adds one count. If all other objects have the
    same label, its percept has even odds.

    Parameters
    ----------
    dataset : Dataset
        Features and labels.
    training_set : TrainingSet
        Recordings of D.
    settings : PerceptionSettings
        Settings of the classifiers.
    spaces : Spaces, optional
        Feature spaces that `fit_spaces` returned; by default they are fitted to D.

    Returns
    -------
    perception : Perception
        Classifiers that were trained on all of D.
    counts : NDArray[np.int64]
        (O,P,E,2,K) number of percepts of each training object, by classifiers that were not trained
        on this object.
    """
    domain = dataset.domain
    classifiers = {}
    shape = len(dataset.objects), len(domain.attributes), len(domain.behaviors)
    counts = np.zeros((*shape, 2, settings.levels), np.int64)
    gathered = gather(dataset, training_set, settings, spaces)
    width, _ = learned_widths(gathered.values(), settings)
    for e, recordings in gathered.items():
        with turn():
            fit, nested = method_of(settings).fit(recordings.widened(width), settings)
        counts[:, :, e] = _count(recordings, nested, settings.levels, len(counts))
        # If a pair is not above chance on held-out objects, later percepts get even odds.
        used = informative(counts[:, :, e].sum(axis=0)) | (not settings.positive_youden_only)
        wide = [replace(space, width=width * space.width) for space in recordings.compared]
        spaces_of = dict(zip(domain.behaviors[e].modalities, wide, strict=True))
        classifiers[domain.behaviors[e].name] = BehaviorClassifier(spaces_of, fit, used)
    return Perception(domain, classifiers, dataset.labels, settings.levels), counts


def _count(recordings: BehaviorRecordings, nested: Floats, levels: int, n_objects: int) -> Ints:
    """Count the levels of nested outputs (n,P) by object and truth, (O,P,2,K)."""
    level_of = classifier_levels(nested, levels)
    counts = np.zeros((n_objects, nested.shape[1], 2, levels), np.int64)
    row, attribute = np.nonzero(recordings.labels >= 0)
    truth = recordings.labels[row, attribute]
    level = level_of[row, attribute]
    np.add.at(counts, (recordings.objects[row], attribute, truth, level), 1)
    return counts


@tiny_is_zero
def build_percept_table(
    dataset: Dataset,
    *,
    perception: str | PerceptionSettings = "default",
    classifier: object | None = None,
    progress: Callable[[int, int], None] | None = None,
    map_behaviors: Map = map,
) -> PerceptTable:
    """Compute the percept table of a data set.

    Parameters
    ----------
    dataset : Dataset
        Recordings and labels.
    perception : str | PerceptionSettings
        "default", "paper", or your own settings of the classifiers.
    classifier : object | None
        A scikit-learn classifier that replaces the default classifier; see `with_classifier`.
    progress : Callable[[int, int], None] | None
        Called with the number of behaviors done and the number of all behaviors.
    map_behaviors : Map
        Function that applies a function to all behaviors, possibly in parallel. This function may
        return results in any order.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> from meal_bayes.datasets import make_synthetic
    >>> rng = np.random.default_rng(0)
    >>> data = make_synthetic(meal_bayes.load_domain("toy"), objects=4, recordings=2, rng=rng)
    >>> meal_bayes.build_percept_table(data).objects == data.objects
    True
    """
    if classifier is not None:
        if perception != "default":
            raise SettingsError("Give perception or a classifier, not both (see with_classifier).")
        perception = with_classifier(classifier)
    if isinstance(perception, str) and perception not in NAMED:
        raise SettingsError(unknown("perception", perception, NAMED))
    settings = NAMED[perception] if isinstance(perception, str) else perception
    if dataset.recordings > _MOST_RECORDINGS:
        raise SettingsError(
            f"An object has {dataset.recordings} recordings by a behavior; give at most "
            f"{_MOST_RECORDINGS}."
        )
    domain = dataset.domain
    n_objects = len(dataset.objects)
    gathered = gather(dataset, TrainingSet.everything(dataset), settings, pairs=True)
    groups = groups_of(gathered.values(), n_objects, settings)
    names = np.unique(groups)
    _, widths = learned_widths(gathered.values(), settings, names, map_behaviors)
    n_behaviors = len(domain.behaviors)
    n_attributes = len(domain.attributes)
    n_bins = len(BIN_EDGES) + 1
    n_groups = groups.max() + 1
    log_odds = np.full((n_objects, dataset.recordings, n_behaviors, n_attributes), np.nan, STORED)
    bins = np.zeros((n_groups, n_objects, n_attributes, n_behaviors, n_bins), BIN_COUNT)
    score = partial(_score_behavior, names=names, widths=widths, groups=groups, settings=settings)
    for done, (e, outputs, counts) in enumerate(map_behaviors(score, gathered.items())):
        objects = gathered[e].objects
        log_odds[objects, number_in_object(objects), e] = outputs
        bins[names, :, :, e] = counts
        if progress is not None:
            progress(done + 1, len(gathered))
    if settings.positive_youden_only:
        _neutralize(log_odds, bins, dataset.labels, groups)
    return PerceptTable(
        domain=domain,
        objects=dataset.objects,
        labels=dataset.labels,
        log_odds=log_odds,
        edges=BIN_EDGES,
        training_bins=bins,
        provenance=_provenance(dataset, settings),
        recording_counts=dataset.recording_counts,
        groups=groups,
    )


def _score_behavior(
    piece: tuple[int, BehaviorRecordings],
    names: Ints,
    widths: NDArray[np.float64],
    groups: Ints,
    settings: PerceptionSettings,
) -> tuple[int, Stored, Counts]:
    """Score the recordings of one behavior, with each of the G groups `names` left out.

    `piece` is the number of the behavior and its recordings; widths (G,) are those of the kernels.
    Returns the number, the held-out outputs (n,P), and for each left-out group how often the
    objects showed each fine bin, (G,O,P,L).
    """
    index, recordings = piece
    n, n_attributes = recordings.labels.shape
    held_outputs = np.full((n, n_attributes), np.nan, STORED)
    n_bins = len(BIN_EDGES) + 1
    bin_counts = np.zeros((len(names), len(groups), n_attributes, n_bins), BIN_COUNT)
    objects, starts = np.unique(recordings.objects, return_index=True)
    # Sums of many threads differ in their last bit from those of one.
    with turn(), threadpool_limits(1):
        for width in np.unique(widths):
            left_out = np.flatnonzero(widths == width)
            rows = np.isin(groups[recordings.objects], names[left_out])
            for attributes, subset in recordings.widened(width).by_known_labels():
                log_odds, training = method_of(settings).outputs(subset, names[left_out], settings)
                # Training-side outputs on the left-out group itself are not used.
                training[names[left_out][:, None] == groups[recordings.objects]] = np.nan
                held_outputs[np.ix_(rows, attributes)] = round_log_odds(log_odds)[rows]
                bins = classifier_levels(training, n_bins)  # (h,n,a)
                bins[np.isnan(training)] = -1
                # Rows are sorted by object, so each object's recordings sum by `reduceat`.
                for level in range(n_bins):
                    counts = np.add.reduceat(bins == level, starts, axis=1, dtype=BIN_COUNT)
                    bin_counts[..., level][np.ix_(left_out, objects, attributes)] = counts
    return index, held_outputs, bin_counts


def _neutralize(log_odds: Stored, bins: Counts, labels: Any, groups: Ints) -> None:
    """Set held-out percepts of uninformative pairs to even odds, in place.

    For each held-out group, only the counts of the other groups decide. These counts do not change,
    because pairs below chance show how many pairs are above chance by chance.
    """
    for group, counts in enumerate(bins):
        percepts = by_truth(counts.astype(np.int64), labels).sum(axis=0)
        uninformative = ~informative(percepts)  # (P,E)
        held = (groups == group)[:, None, None, None]
        log_odds[held & uninformative.T & ~np.isnan(log_odds)] = 0.0


def _provenance(dataset: Dataset, settings: PerceptionSettings) -> dict[str, str]:
    """Return the provenance of a table: package, settings, recordings, command, classifier."""
    digest = hashlib.sha256(dataset.labels.tobytes())
    for context, values in sorted(dataset.features.items()):
        digest.update(repr(context).encode())
        digest.update(values.tobytes())
    data = dataset.domain.data
    classifier = settings.classifier
    kind = type(settings.classifier)
    home = SOURCES.get(data)
    name = f"{kind.__module__}:{kind.__qualname__}"
    options = {"paper": ["--perception", "paper"], "classifier": ["--classifier", name]}
    words = ["--dataset", data, *options.get(settings.method, [])]
    names = (field.name for field in fields(settings) if field.name != "classifier")
    provenance = {
        "package": f"meal-bayes {package_version()}",
        "perception": ", ".join(f"{n}={getattr(settings, n)}" for n in names),
        "source": f"{home.repository}@{home.commit}" if home else "own data",
        "recordings_sha256": digest.hexdigest(),
        "command": command_line("meal-bayes data percepts", *words),
    }
    if classifier is not None:
        provenance["classifier"] = name
        parameters = sorted(classifier.get_params().items())
        provenance["classifier_parameters"] = ", ".join(f"{n}={v!r}" for n, v in parameters)
    return provenance
