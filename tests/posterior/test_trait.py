"""The trait that all percepts of an object share, made up and in the real recordings."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import betaln

from meal_bayes.agents import knowledge_without
from meal_bayes.datasets.percepts import load_percepts
from meal_bayes.perception import table_counts
from meal_bayes.perception.confusion import by_truth
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.checks import log_likelihood
from meal_bayes.posterior.graded_prior import GradedPrior
from meal_bayes.posterior.grid import effective_counts, row_statistics
from meal_bayes.posterior.trait import SharedTrait, learn_trait, truth_evidence

OBJECTS = 80
ATTRIBUTES = 6
BEHAVIORS = 5


def simulate(rng, sd, objects=OBJECTS, recordings=4):
    """Draw labels (O,P) and levels (O,P,E,K): Normal degrees, rows exponential in them."""
    truth = rng.random((objects, ATTRIBUTES)) < 0.5
    trait = np.where(truth, 1.0, -1.0) + sd * rng.normal(size=truth.shape)
    slope = rng.uniform(0.3, 0.6, (ATTRIBUTES, BEHAVIORS, 1)) * np.array([-3.0, -1.0, 1.0, 3.0])
    score = trait[..., None, None] * slope
    rows = np.exp(score - score.max(axis=-1, keepdims=True))
    levels = rng.multinomial(recordings, rows / rows.sum(axis=-1, keepdims=True))
    return truth.astype(np.int8), levels


def learned(truth, levels):
    rows = np.stack([truth == 0, truth == 1], axis=-1)
    posterior = ConfusionPosterior.from_objects(levels[:, :, :, None] * rows[:, :, None, :, None])
    rates = ((truth == 1).sum(axis=0) + 1) / ((truth >= 0).sum(axis=0) + 2)
    return posterior, learn_trait(posterior, levels, truth, rates), rates


def beliefs(posterior, trait, rates, levels):
    """Log-odds of the truth (O,P) after all percepts (O,P,E,K)."""
    rows, precision = trait.select(*posterior.select(range(levels.shape[1])))
    seen = np.stack(
        [
            log_likelihood(levels.astype(float), rows[:, :, t], precision[:, :, t])
            for t in range(len(trait.points))
        ],
        axis=-1,
    ).sum(axis=2)
    prior = np.log(rates) - np.log1p(-rates)
    return prior + truth_evidence(seen, np.log(np.maximum(trait.latent_classes, 1e-300)))


@given(st.integers(0, 10**6), st.floats(0.1, 1.0), st.sampled_from([2, 4, 8]))
def test_rows_mix_to_the_confusion_matrix(seed, sd, levels):
    rng = np.random.default_rng(seed)
    used = rng.dirichlet(np.full(levels, 3.0), (3, 2))
    tilt = np.linspace(-0.5, 0.5, levels)
    confusion = used[..., None, :] * np.exp(np.array([[-1.0], [1.0]]) * tilt)
    confusion /= confusion.sum(axis=-1, keepdims=True)
    trait = SharedTrait.of_sd(sd)
    rows, precision = trait.select(confusion, np.broadcast_to([2.0, 8.0], (3, 2, 2)))
    np.testing.assert_allclose(rows.sum(axis=-1), 1.0)
    np.testing.assert_allclose(trait.latent_classes @ rows, confusion, atol=1e-3)
    np.testing.assert_allclose(precision, 2.0)  # half of their geometric mean
    if levels == 2:
        assert (np.diff(rows[..., 1], axis=-1) > -1e-12).all()  # the higher the trait, the more yes


def test_pairs_that_say_nothing_stay_silent():
    confusion = np.broadcast_to([0.1, 0.2, 0.3, 0.4], (1, 1, 2, 4))
    rows, _ = SharedTrait.of_sd(0.5).select(confusion, np.full((1, 1, 2), 3.0))
    np.testing.assert_allclose(rows[0, 0], np.tile([0.1, 0.2, 0.3, 0.4], (9, 1)), atol=1e-6)


def test_no_number_of_percepts_outweighs_the_trait():
    """Percepts single out a trait; what that says of the truth is all they can say."""
    trait = SharedTrait.of_sd(0.6)
    confusion = np.array([[[[0.7, 0.3], [0.3, 0.7]]]])
    known = np.full((1, 1, 2), np.inf)
    rows, precision = trait.select(confusion, known)
    evidence = []
    for n in (1, 10, 100, 10**6):
        counts = np.array([[[[0.0, float(n)]]]])
        seen = [log_likelihood(counts, rows[:, :, t], precision[:, :, t]) for t in range(9)]
        evidence.append(truth_evidence(np.stack(seen, -1), np.log(trait.latent_classes)).item())
    assert evidence[0] == pytest.approx(np.log(7 / 3), rel=1e-3)  # a first percept: Eq. 8
    assert (np.diff(evidence) > 0).all()
    assert evidence[-1] == pytest.approx(
        np.log(trait.latent_classes[1, -1] / trait.latent_classes[0, -1])
    )


@pytest.mark.statistical
@pytest.mark.parametrize("sd", [0.3, 0.6, 1.0])
def test_the_sd_of_simulated_objects_is_recovered(sd):
    """On average over made-up data sets, but for what the rows, learned from the same, take."""
    rngs = [np.random.default_rng(seed) for seed in range(3, 6)]
    estimates = [learned(*simulate(rng, sd, objects=400))[1].sd for rng in rngs]
    assert 0.84 * sd < np.mean(estimates) < sd


@pytest.mark.statistical
def test_new_objects_are_judged_better_than_if_behaviors_erred_alone():
    rng = np.random.default_rng(4)
    truth, levels = simulate(rng, 0.8)
    posterior, trait, rates = learned(truth, levels)
    independent = SharedTrait(0.0, np.array([-1.0, 1.0]), np.eye(2))
    new_truth, new = simulate(rng, 0.8, objects=600)
    sign = np.where(new_truth == 1, 1.0, -1.0)
    nll = [
        np.logaddexp(0, -sign * beliefs(posterior, d, rates, new)).mean()
        for d in (trait, independent)
    ]
    assert nll[0] < nll[1] - 0.05


def test_an_object_is_scored_by_rows_without_its_own_percepts():
    """The rows of each object are those of a posterior to which it was never added."""
    truth, levels = simulate(np.random.default_rng(8), 0.7, objects=12)
    rows = np.stack([truth == 0, truth == 1], axis=-1)
    counts = levels[:, :, :, None] * rows[:, :, None, :, None]
    whole = ConfusionPosterior.from_objects(counts)
    pair = np.array([0, 3]), np.array([1, 4])
    for own in counts[:4]:
        before = whole.update(np.zeros_like(own), own)
        mean, precision = whole.without(*pair, own[pair])
        np.testing.assert_allclose(mean, before.mean[pair])
        np.testing.assert_allclose(precision, before.precision[pair])


def loss_by_hand(sd, posterior, prior, levels, truth, rates):
    """Loss of beliefs after each behavior's one recording, and twice after all, case by case."""
    trait = SharedTrait.of_sd(sd)
    classes = np.log(np.maximum(trait.latent_classes, 1e-300))
    losses = {"one": [], "joint": []}
    weights = {"one": [], "joint": []}
    for o, p in np.ndindex(truth.shape):
        behaviors = np.flatnonzero(posterior.informative[p])
        own = np.zeros((len(behaviors), 2, levels.shape[-1]), int)
        own[:, truth[o, p]] = levels[o, p, behaviors]
        without = posterior.without(np.full(len(behaviors), p), behaviors, own, prior)
        rows, precision = trait.select(*without, rounds=10)
        shown = np.repeat(levels[o, p, behaviors, None], rows.shape[1], axis=1).astype(float)
        seen = log_likelihood(shown, rows, precision)  # (V,M)
        sign = 1 if truth[o, p] else -1
        for kind, evidence in (("one", seen), ("joint", seen.sum(axis=0, keepdims=True))):
            odds = np.log(rates[p] / (1 - rates[p])) + truth_evidence(evidence, classes)
            losses[kind] += np.logaddexp(0, -sign * odds).tolist()
            weights[kind] += [rates[p] * (1 - rates[p])] * len(odds)
    one, joint = (np.average(losses[kind], weights=weights[kind]) for kind in losses)
    return one + 2 * joint + 0.5 * sd**2 / truth.size


def test_sigma_has_the_least_loss_of_objects_that_are_taken_out():
    truth, levels = simulate(np.random.default_rng(9), 0.8, objects=15, recordings=1)
    posterior, trait, rates = learned(truth, levels)
    rows, votes = row_statistics(by_truth(levels, truth))
    prior = GradedPrior.learn(effective_counts(rows, votes), votes)
    losses = [
        loss_by_hand(sd, posterior, prior, levels, truth, rates)
        for sd in (0.75 * trait.sd, trait.sd, 1.3 * trait.sd)
    ]
    assert losses[1] < min(losses[0], losses[2])


def test_unknown_labels_and_silent_objects_teach_nothing():
    truth, levels = simulate(np.random.default_rng(5), 0.7, objects=30)
    unknown = truth.copy()
    silent = levels.copy()
    relabelled = truth.copy()
    unknown[20:] = -1
    silent[20:] = 0
    relabelled[20:] = 1 - truth[20:]
    posterior, trait, rates = learned(unknown, levels)
    for labels, shown in ((unknown, silent), (truth, silent), (relabelled, silent)):
        assert learn_trait(posterior, shown, labels, rates).sd == trait.sd
    assert learn_trait(posterior, levels, relabelled, rates).sd != trait.sd


def test_a_typical_sd_is_used_where_nothing_can_be_learned():
    truth, levels = simulate(np.random.default_rng(6), 0.7, objects=6)
    assert learned(truth, np.zeros_like(levels))[1].sd == 0.5
    flat = np.ones_like(levels)
    assert learned(truth, flat)[1].sd == 0.5


def repeats_nll(posteriors, table, columns, exact):
    """NLL of the truth after all recordings of one behavior, over pairs with TPR - FPR > .2.

    Prior: the base rate of the other objects. Counts of yes/no need no order.
    """
    sensing = table.domain.recorded
    yes = (table.levels_of(table.log_odds, 2) == 1).sum(axis=1)  # (O,E,P)
    total = table.recordings
    losses = []
    for o, posterior in enumerate(posteriors):
        truth = table.labels[o, columns] == 1
        others = (np.delete(table.labels, o, axis=0)[:, columns] == 1).mean(axis=0)
        log_odds = np.tile(np.log(others / (1 - others)), (len(sensing), 1)).T  # (N,E)
        confusion = posterior.mean[columns]
        precision = posterior.precision[columns]
        hits = yes[o].T[np.ix_(columns, sensing)]
        for value, sign in ((1, 1), (0, -1)):
            m = confusion[:, sensing, value, 1]
            s = precision[:, sensing, value]
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
