"""Repeats of one behavior on the real recordings, through the percept tables that are shipped."""

import numpy as np
import pytest
from scipy.special import betaln

from meal_bayes.agents import knowledge_without
from meal_bayes.datasets.percepts import load_percepts
from meal_bayes.perception import table_counts
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.checks import log_likelihood
from meal_bayes.posterior.trait import truth_evidence


def repeats_nll(posteriors, table, columns, exact):
    """NLL of the truth after all recordings of one behavior, over pairs with TPR - FPR > .2.

    Prior: the base rate of the other objects. Counts of yes/no need no order.
    """
    sensing = table.domain.recorded
    yes = (table.levels_of(table.log_odds, 2) == 1).sum(axis=1)  # (O,E,P)
    total, losses = table.recordings, []
    for o, posterior in enumerate(posteriors):
        truth = table.labels[o, columns] == 1
        others = (np.delete(table.labels, o, axis=0)[:, columns] == 1).mean(axis=0)
        log_odds = np.tile(np.log(others / (1 - others)), (len(sensing), 1)).T  # (N,E)
        confusion, precision = posterior.mean[columns], posterior.precision[columns]
        hits = yes[o].T[np.ix_(columns, sensing)]
        for value, sign in ((1, 1), (0, -1)):
            m, s = confusion[:, sensing, value, 1], precision[:, sensing, value]
            if exact:
                score = hits * np.log(m) + (total - hits) * np.log1p(-m)
            else:
                score = betaln(s * m + hits, s * (1 - m) + total - hits)
                score -= betaln(s * m, s * (1 - m))
            log_odds += sign * score
        counts = posterior.counts[np.ix_(columns, sensing)]
        rates = counts[..., 1] / counts.sum(axis=-1)
        useful = rates[..., 1] - rates[..., 0] > 0.2
        loss = np.logaddexp(0.0, np.where(truth[:, None], -log_odds, log_odds))
        losses.append(loss[useful])
    return np.concatenate(losses).mean()


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "paper", "ours"),
    [("roc36", 0.22, 0.18), ("ispy32", 0.90, 0.60), ("cy101", 0.45, 0.265)],
)
def test_object_level_beliefs_survive_repeats_where_equation_8_does_not(name, paper, ours):
    table = load_percepts(name)
    held = table.labels == 1
    least = table.domain.asked_minimum
    columns = np.flatnonzero((held.sum(axis=0) > least) & ((~held).sum(axis=0) > least))
    counts = [table_counts(table, o) for o in range(len(table.objects))]
    by_percept = [ConfusionPosterior.from_counts(c) for c in counts]
    by_object = [ConfusionPosterior.from_objects(c) for c in counts]
    assert repeats_nll(by_percept, table, columns, exact=True) > paper
    assert repeats_nll(by_object, table, columns, exact=False) < ours


def final_log_odds(table, o, knowledge, shared):
    """Belief (P,) after all recordings of all behaviors that tell, with or without the trait."""
    shown = table.levels_of(np.nan_to_num(table.log_odds[o].astype(float)), 4)  # (R,E,P)
    counts = (shown.transpose(2, 1, 0)[..., None] == np.arange(4)).sum(axis=2).astype(float)
    rows, precision = knowledge.posterior.select(range(table.labels.shape[1]))
    classes = np.eye(2)
    if shared:
        rows, precision = knowledge.trait.select(rows, precision)
        classes = knowledge.trait.latent_classes
    each = [
        log_likelihood(counts, rows[:, :, t], precision[:, :, t]) for t in range(len(classes.T))
    ]
    told = knowledge.posterior.informative[..., None]
    seen = (np.stack(each, axis=-1) * told).sum(axis=1)  # (P,C)
    prior = np.log(knowledge.base_rates) - np.log1p(-knowledge.base_rates)
    return prior + truth_evidence(seen, np.log(np.maximum(classes, 1e-300)))


@pytest.mark.long
def test_a_shared_trait_keeps_all_percepts_together_from_being_surer_than_right():
    table = load_percepts("cy101")
    losses = np.empty((10, 2, table.labels.shape[1]))
    for row, o in enumerate(range(0, 100, 10)):
        knowledge = knowledge_without(table, o, levels=4)
        sign = np.where(table.labels[o] == 1, 1.0, -1.0)
        for shared in (False, True):
            odds = final_log_odds(table, o, knowledge, shared)
            losses[row, int(shared)] = np.logaddexp(0.0, -sign * odds)
    product, trait = losses.mean(axis=(0, 2))
    assert trait < 0.7 * product
