"""What labels say of attributes that exclude or imply each other."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from meal_bayes.agents import joint_prior as module
from meal_bayes.agents import load_agent
from meal_bayes.agents.base_rates import learn_base_rates
from meal_bayes.agents.joint_prior import Coupled, coupled_pairs, joint_prior
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.domain import Query, load_domain

DOMAIN = load_domain("roc36")
P = len(DOMAIN.attributes)
SEEDS = st.integers(0, 2**32)


def drawn_labels(rng, objects):
    """Draw labels (O,P) of which neighbors are often the same, or never both true; some unknown."""
    labels = (rng.random((objects, P)) < rng.uniform(0.2, 0.8, P)).astype(np.int8)
    copied = rng.random((objects, P)) < rng.uniform(0.0, 1.0, P)
    for p in range(1, P):
        like = labels[:, p - 1] if p % 2 else np.minimum(labels[:, p], 1 - labels[:, p - 1])
        labels[:, p] = np.where(copied[:, p], like, labels[:, p])
    for members in DOMAIN.groups.values():
        columns = DOMAIN.columns(members)
        labels[:, columns] = np.eye(len(columns), dtype=np.int8)[
            rng.integers(len(columns), size=objects)
        ]
    labels[rng.random(labels.shape) < rng.choice([0.0, 0.2])] = -1
    return labels


def learned(labels):
    """Return base rates, and the pairs that labels couple."""
    rates = learn_base_rates(DOMAIN, labels).mean
    return rates, coupled_pairs(DOMAIN, labels, rates)


@given(SEEDS, st.integers(0, 60))
def test_pairs_keep_the_base_rates_and_lean_as_the_labels_do(seed, objects):
    labels = drawn_labels(np.random.default_rng(seed), objects)
    rates, known = learned(labels)
    variable = {name: group for group, members in DOMAIN.groups.items() for name in members}
    for (i, j), four in zip(known.pairs.tolist(), known.probability, strict=True):
        first = DOMAIN.attributes[i]
        second = DOMAIN.attributes[j]
        assert i < j
        assert variable.get(first, first) != variable.get(second, second)
        assert (four > 0).all()
        assert_allclose([four[2:].sum(), four[[1, 3]].sum()], rates[[i, j]], atol=1e-12)
        both_known = (labels[:, [i, j]] >= 0).all(axis=1)
        counts = np.bincount(2 * labels[both_known, i].astype(int) + labels[both_known, j])
        n = np.append(counts, np.zeros(4 - len(counts)))
        excess = (n[0] + 0.5) * (n[3] + 0.5) - (n[1] + 0.5) * (n[2] + 0.5)
        assert (four[0] * four[3] - four[1] * four[2]) * excess > 0
    # The order of objects does not matter, nor which names come first.
    again = learned(labels[::-1])[1]
    assert_array_equal(again.pairs, known.pairs)
    assert_allclose(again.probability, known.probability)


@given(SEEDS)
def test_few_labels_couple_nothing(seed):
    labels = drawn_labels(np.random.default_rng(seed), 4)
    assert learned(labels)[1].pairs.size == 0


def test_wrong_labels_of_independent_attributes_couple_none():
    domain = load_domain("cy101")
    rng = np.random.default_rng(3)
    truth = rng.random((200, len(domain.attributes))) < 0.15
    labels = np.asarray(truth ^ (rng.random(truth.shape) < 0.2), np.int8)
    rates = learn_base_rates(domain, labels, label_accuracy=0.8)
    assert coupled_pairs(domain, labels, rates.mean, None, rates.of_labels).pairs.size == 0
    assert coupled_pairs(domain, labels, rates.mean).pairs.size > 0  # as if never wrong


def coupled(pairs):
    """Return what is known of pairs of an odds ratio of 9, or 1 / 9, at even base rates."""
    alike = np.array([0.375, 0.125, 0.125, 0.375])
    rows = [alike if same else alike[[1, 0, 3, 2]] for _, _, same in pairs]
    places = np.array([pair[:2] for pair in pairs], np.int64).reshape(-1, 2)
    return Coupled(places, np.array(rows).reshape(-1, 4), np.full(len(pairs), 4.0))


@pytest.fixture
def prior_of(monkeypatch):
    """Return a function: the joint prior of p0, p1, ... at even base rates, from coupled pairs."""

    def prior(n, pairs, told=None):
        names = tuple(f"p{i}" for i in range(n))
        domain = load_domain({"extends": "toy", "name": "made", "attributes": list(names)})
        monkeypatch.setattr(module, "coupled_pairs", lambda *arguments: coupled(pairs))
        labels = np.empty((0, n), np.int8)
        return joint_prior(domain, labels, np.full(n, 0.5), Query(names), told)

    return prior


class TestJointPrior:
    """Of a query, from pairs."""

    @pytest.mark.parametrize("seed", range(20))
    def test_it_has_the_margins_of_rates_and_pairs(self, prior_of, seed):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 6))
        # A tree of pairs: each attribute with one before it.
        pairs = [(int(rng.integers(i)), i, bool(rng.integers(2))) for i in range(1, n)]
        joint = prior_of(n, pairs)
        values = Query(tuple(f"p{i}" for i in range(n))).values
        assert_allclose(joint.sum(), 1.0)
        assert_allclose(joint @ values, 0.5, atol=1e-9)
        for i, j, same in pairs:
            equal = joint[values[:, i] == values[:, j]].sum()
            assert equal == pytest.approx(0.75 if same else 0.25, abs=1e-9)
        # Largest entropy: an attribute tells nothing of another given the one between them.
        if n == 3 and pairs[1][0] == 1:
            table = joint.reshape(2, 2, 2)
            given_middle = table / table.sum(axis=(0, 2), keepdims=True)
            alone = given_middle.sum(axis=2)[:, :, None] * given_middle.sum(axis=0)[None]
            assert_allclose(given_middle, alone, atol=1e-9)

    @given(SEEDS)
    def test_of_the_labels_margins_are_the_base_rates(self, seed):
        rng = np.random.default_rng(seed)
        labels = drawn_labels(rng, 60)
        rates, known = learned(labels)
        columns = rng.choice(P, size=4, replace=False).tolist()
        query = DOMAIN.attributes
        query = Query(tuple(query[p] for p in columns))
        joint = joint_prior(DOMAIN, labels, rates, query)
        assert (joint is None) == (not np.isin(known.pairs, columns).all(axis=1).any())
        if joint is not None:
            assert_allclose(joint @ query.values, rates[columns], atol=1e-6)

    def test_without_a_pair_or_with_too_many_values_there_is_none(self, prior_of):
        assert prior_of(3, []) is None
        assert prior_of(8, [(0, 1, True)]) is not None
        assert prior_of(9, [(0, 1, True)]) is None

    def test_what_a_person_told_of_one_attribute_tells_of_the_other(self, prior_of):
        joint = prior_of(2, [(0, 1, True)], np.array([0.99, np.nan]))
        assert_allclose(joint[2:].sum(), 0.99)
        assert_allclose(joint[[1, 3]].sum(), 0.99 * 0.75 + 0.01 * 0.25)

    @given(SEEDS)
    def test_the_order_of_a_question_does_not_matter(self, seed):
        rng = np.random.default_rng(seed)
        labels = drawn_labels(rng, 60)
        rates, _ = learned(labels)
        names = [DOMAIN.attributes[p] for p in rng.choice(P, size=3, replace=False)]
        joint = joint_prior(DOMAIN, labels, rates, Query(tuple(names)))
        turned = joint_prior(DOMAIN, labels, rates, Query(tuple(names[::-1])))
        if joint is None:
            assert turned is None
            return
        query, backwards = Query(tuple(names)), Query(tuple(names[::-1]))
        places = [backwards.index_of(row[::-1]) for row in query.values]
        assert_allclose(turned[places], joint, atol=1e-9)


class TestAgent:
    """Which agents have it, and of which queries."""

    def knowledge(self):
        rng = np.random.default_rng(0)
        labels = drawn_labels(rng, 36)
        labels[:, 0] = np.arange(36) % 2
        group = self.group_of(DOMAIN.attributes[0])
        attribute = next(p for p in range(P) if DOMAIN.attributes[p] not in group)
        labels[:, attribute] = 1 - labels[:, 0]
        labels[::3, attribute] = 0  # never both, sometimes neither
        counts = np.ones((36, P, len(DOMAIN.behaviors), 2, 2), np.int64)
        names = DOMAIN.attributes[0], DOMAIN.attributes[attribute]
        return knowledge_of(DOMAIN, counts, labels, object_level=False), names

    def group_of(self, name):
        return next((m for m in DOMAIN.groups.values() if name in m), (name,))

    def test_only_queries_with_a_coupled_pair_have_a_joint_prior(self):
        knowledge, names = self.knowledge()
        agent = dataclasses.replace(
            load_agent("morc"), name="mine", base_rates=True, co_occurrence=True
        )
        plain = dataclasses.replace(agent, co_occurrence=False)
        joint = agent.model(Query(names), knowledge)
        assert joint.joint[3] < 0.05 < joint.joint[0]
        independent = plain.model(Query(names), knowledge)
        assert independent.joint is None
        assert_allclose(joint.prior, independent.prior, atol=1e-12)
        # What is not coupled is what it was, to the last bit.
        alone = agent.model(Query(names[:1]), knowledge)
        assert alone.joint is None
        assert_array_equal(alone.prior, plain.model(Query(names[:1]), knowledge).prior)
        voted = agent.model(Query(names), knowledge, told=np.array([0.99, np.nan]))
        assert voted.prior[0] == pytest.approx(0.99)
        assert voted.prior[1] < joint.prior[1]

    def test_without_base_rates_there_is_none(self):
        knowledge, names = self.knowledge()
        uniform = dataclasses.replace(load_agent("bayes"), base_rates=False)
        momdp = uniform.model(Query(names), knowledge)
        assert momdp.joint is None
        assert_array_equal(momdp.prior, 0.5)
