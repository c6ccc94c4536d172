"""Base rates: pooled over attributes that stand alone, a symmetric Dirichlet over a group."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from meal_bayes import Learner
from meal_bayes.agents import knowledge_without
from meal_bayes.agents.base_rates import RATES, learn_base_rates
from meal_bayes.domain import load_domain

TOY = load_domain("toy")
CY101 = load_domain("cy101")
ROW = st.lists(st.integers(-1, 1), min_size=len(CY101.attributes), max_size=len(CY101.attributes))
LABELS = st.lists(ROW, max_size=12)


def label_rows(rows):
    return np.array(rows, np.int8).reshape(-1, len(CY101.attributes))


def by_sampling(labels, draws=400_000):
    """Posterior means of the hierarchy by importance sampling: no grid over mu."""
    rng = np.random.default_rng(3)
    mu = rng.beta(1, 2, draws)
    strength = 2.0 ** rng.integers(0, 7, draws)
    rates = rng.beta((strength * mu)[:, None], (strength * (1 - mu))[:, None], (draws, 2))
    true = (labels == 1).sum(axis=0)
    false = (labels == 0).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        log_weight = (np.where(true > 0, true * np.log(rates), 0.0)).sum(axis=1)
        log_weight += (np.where(false > 0, false * np.log1p(-rates), 0.0)).sum(axis=1)
    weight = np.exp(log_weight)
    return weight @ rates / weight.sum()


@pytest.mark.parametrize("rows", [[], [[1, 0]], [[1, 0], [1, -1], [1, 1]], [[0, 0]] * 4])
def test_rates_are_the_posterior_means_of_the_hierarchy(rows):
    labels = np.array(rows, np.int8).reshape(-1, 2)
    rates = learn_base_rates(TOY, labels)
    np.testing.assert_allclose(rates.mean, by_sampling(labels), atol=0.005)


def test_nobody_says_yes_by_a_tie_who_was_told_nothing():
    for name in ("toy", "cy101", "ispy32", "roc36"):
        domain = load_domain(name)
        rates = learn_base_rates(domain, np.empty((0, len(domain.attributes)), np.int8)).mean
        assert (rates < 0.4).all()
    rates = Learner("cy101", logs=None).knowledge().base_rates
    np.testing.assert_allclose(rates, 1 / 3, atol=1e-3)


def test_labels_of_other_attributes_tell_of_one_that_was_never_told():
    told = np.full((6, len(CY101.attributes)), -1)
    told[:, :-1] = 0
    rare = learn_base_rates(CY101, told).mean
    told[:, :-1] = 1
    common = learn_base_rates(CY101, told).mean
    assert rare[-1] < 0.1
    assert common[-1] > 0.8
    told[:, : len(CY101.attributes) // 2] = 0
    assert 0.3 < learn_base_rates(CY101, told).mean[-1] < 0.7  # rates that differ say little


@given(LABELS, st.integers(0, 9), st.booleans())
def test_given_how_far_rates_are_pooled_a_label_moves_one_rate(rows, attribute, value):
    labels = label_rows(rows)
    before = learn_base_rates(CY101, labels)
    more = np.vstack([labels, np.full_like(labels, -1, shape=(1, labels.shape[1]))])
    more[-1, attribute] = value
    after = learn_base_rates(CY101, more, before.weights)
    change = after.mean - before.mean
    assert (change[attribute] > 0) == value
    assert change[attribute] != 0
    np.testing.assert_array_equal(np.delete(change, attribute), 0)


@given(LABELS)
def test_probabilities_are_those_of_the_mixture_of_betas(rows):
    rates = learn_base_rates(CY101, label_rows(rows))
    prob = rates.probabilities
    np.testing.assert_allclose(prob.sum(axis=1), 1.0)
    np.testing.assert_allclose(prob @ RATES, rates.mean, atol=2e-3)


def test_probabilities_of_a_value_of_a_group_are_its_beta():
    domain = load_domain("roc36")
    columns = domain.columns(domain.groups["weight"])
    labels = np.full((5, len(domain.attributes)), -1, np.int8)
    labels[:, columns] = 0
    labels[:, columns[0]] = 1
    prob = learn_base_rates(domain, labels).probabilities[columns[0]]
    at_most = beta.cdf(0.5, 6, 2)
    assert prob[RATES < 0.49].sum() + prob[len(RATES) // 2] / 2 == pytest.approx(at_most, abs=0.01)


def test_labels_of_an_object_that_is_left_out_count_for_no_rate(table):
    labels = np.array(table.labels)
    labels[0, 0] = -1
    known = knowledge_without(replace(table, labels=labels), 3)
    others = np.delete(labels, 3, axis=0)
    np.testing.assert_array_equal(known.base_rates, learn_base_rates(table.domain, others).mean)


@given(st.lists(st.integers(-1, 2), min_size=1, max_size=9), st.integers(0, 2))
def test_rates_of_a_group_sum_to_one(values, ruled_out):
    """Of each object the weight is one of three values, or not known, or known not to be one."""
    domain = load_domain("roc36")
    columns = domain.columns(domain.groups["weight"])
    labels = np.full((len(values), len(domain.attributes)), -1, np.int8)
    for row, value in zip(labels, values, strict=True):
        row[columns] = -1 if value < 0 else np.arange(3) == value
    rates = learn_base_rates(domain, labels).mean
    for members in domain.groups.values():
        assert rates[domain.columns(members)].sum() == pytest.approx(1.0)
    known = [values.count(value) for value in range(3)]
    np.testing.assert_allclose(rates[columns], (np.array(known) + 1) / (sum(known) + 3))
    # One more object that is not one of the values: the odds of the two others stay.
    more = np.append(labels, np.full_like(labels[:1], -1), axis=0)
    more[-1, columns[ruled_out]] = 0
    after = learn_base_rates(domain, more).mean[columns]
    assert after.sum() == pytest.approx(1.0)
    assert after[ruled_out] < rates[columns][ruled_out]
    others = np.delete(np.arange(3), ruled_out)
    before = rates[columns][others]
    np.testing.assert_allclose(after[others] / after[others].sum(), before / before.sum())


@given(st.floats(0.05, 0.95), st.floats(0.75, 1.0), st.integers(0, 2**32))
def test_rates_behind_labels_that_may_be_wrong_are_found(rate, accuracy, seed):
    rng = np.random.default_rng(seed)
    truth = rng.random((2_000, 2)) < rate
    said = np.where(rng.random(truth.shape) < accuracy, truth, ~truth).astype(np.int8)
    rates = learn_base_rates(TOY, said, label_accuracy=accuracy)
    np.testing.assert_allclose(rates.mean, truth.mean(axis=0), atol=0.05 / (2 * accuracy - 1))
    np.testing.assert_allclose(rates.of_labels, said.mean(axis=0), atol=0.02)


def test_labels_that_may_be_wrong_count_less_while_there_are_few():
    told = np.full((3, len(CY101.attributes)), -1)
    told[:, 0] = 1
    rates = [learn_base_rates(CY101, told, label_accuracy=a).mean[0] for a in (0.6, 0.8, 0.99, 1.0)]
    assert rates == sorted(rates)
    assert rates[0] < 0.5 < rates[-1]
    domain = load_domain("roc36")  # groups count labels in full
    labels = np.zeros((2, len(domain.attributes)), np.int8)
    labels[:, domain.columns([members[0] for members in domain.groups.values()])] = 1
    doubted = learn_base_rates(domain, labels, label_accuracy=0.8).mean
    np.testing.assert_array_equal(doubted, learn_base_rates(domain, labels).mean)
