"""Held-out log-odds of recordings, and how good they are with the base rate restored."""

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of, round_log_odds
from meal_bayes.perception import DEFAULT, PerceptionSettings
from meal_bayes.perception.confusion import by_truth
from meal_bayes.perception.feature_spaces import gather, groups_of, number_in_object
from meal_bayes.perception.fitting import method_of
from meal_bayes.perception.kernel_ridge import learned_widths


def held_out_log_odds(dataset: Dataset, *, settings: PerceptionSettings = DEFAULT) -> Floats:
    """Score every recording by classifiers that never saw its object, (O,R,E,P).

    They are those of `build_percept_table`, without its training side, which takes most of the
    time. NaN for behaviors that do not sense and labels that are unknown.
    """
    domain = dataset.domain
    n_objects = len(dataset.objects)
    shape = n_objects, dataset.recordings, len(domain.behaviors), len(domain.attributes)
    outputs = np.full(shape, np.nan)
    gathered = gather(dataset, TrainingSet.everything(dataset), settings)
    groups = groups_of(gathered.values(), n_objects, settings)
    _, widths = learned_widths(gathered.values(), settings, np.unique(groups))
    for width in np.unique(widths):
        held = (widths == width)[groups]
        for e, recordings in gathered.items():
            _, nested = method_of(settings).fit(recordings.widened(width), settings)
            rows = held[recordings.objects]
            place = recordings.objects[rows], number_in_object(recordings.objects)[rows]
            outputs[:, :, e][place] = nested[rows]
    return outputs


def with_base_rate(log_odds: NDArray[np.floating], labels: NDArray[np.int8]) -> Floats:
    """Add the base rate of the other objects to balanced log-odds (O,R,E,P)."""
    positive = (labels == 1).sum(axis=0) - (labels == 1)
    negative = (labels == 0).sum(axis=0) - (labels == 0)
    prior = np.log((positive + 1) / (negative + 1))
    return np.asarray(np.asarray(log_odds, dtype=np.float64) + prior[:, None, None, :])


def held_out_log_loss(
    log_odds: NDArray[np.floating], labels: NDArray[np.int8], *, balanced: bool = True
) -> Floats:
    """Return the mean negative log-likelihood of the truth, nats a recording, (E,P).

    The base rate of the other objects, (n+ + 1)/(n + 2), is added to class-balanced log-odds
    (O,R,E,P). NaN where nothing was computed.
    """
    values = with_base_rate(log_odds, labels) if balanced else np.asarray(log_odds, np.float64)
    truth = labels[:, None, None, :]
    scored = (truth >= 0) & np.isfinite(values)
    loss = np.logaddexp(0.0, np.where(scored, np.where(truth == 1, -values, values), -np.inf))
    number = scored.sum(axis=(0, 1))
    total = loss.sum(axis=(0, 1))
    return np.asarray(np.where(number > 0, total / np.maximum(number, 1), np.nan))


def base_rate_log_loss(labels: NDArray[np.int8]) -> Floats:
    """Return the log-loss of the base rate of the other objects alone, nats, (P,)."""
    nothing = np.zeros((len(labels), 1, 1, labels.shape[1]))
    return np.asarray(held_out_log_loss(nothing, labels)[0])


def cohens_kappa(table: NDArray[np.number]) -> Floats:
    """Return Cohen's kappa (...) of counts (...,2,2) [truth, yes]; 0 where it is undefined."""
    number = table.sum(axis=-1)
    everything = np.maximum(number.sum(axis=-1), 1)
    agree = (table[..., 1, 1] + table[..., 0, 0]) / everything
    p_yes = table[..., 1].sum(axis=-1) / everything
    p_true = number[..., 1] / everything
    chance = p_yes * p_true + (1 - p_yes) * (1 - p_true)
    defined = (number.min(axis=-1) > 0) & (chance < 1)
    return np.where(defined, (agree - chance) / np.where(chance < 1, 1 - chance, 1), 0.0)


def yes_counts(log_odds: NDArray[np.floating], labels: NDArray[np.int8]) -> NDArray[np.int64]:
    """Count yes and no of held-out log-odds (O,R,E,P), (O,P,E,2,2); NaN does not count."""
    levels = levels_of(round_log_odds(log_odds), BIN_EDGES, 2)
    shown = np.stack([(levels == level) & np.isfinite(log_odds) for level in (0, 1)], axis=-1)
    return by_truth(shown.sum(axis=1).transpose(0, 2, 1, 3), labels)


def permuted(dataset: Dataset, rng: np.random.Generator) -> Dataset:
    """Shuffle each attribute's labels, or a group's, over the objects: nothing can be learned."""
    labels = rng.permuted(dataset.labels, axis=0)
    for members in dataset.domain.groups.values():  # of which exactly one stays true
        columns = dataset.domain.columns(members)
        labels[:, columns] = rng.permutation(dataset.labels[:, columns])
    return Dataset(dataset.domain, dataset.objects, dataset.features, labels)
