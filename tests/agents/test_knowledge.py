"""The held-out object is held out of what is known; what exploring is worth by what is known."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.agents import Progress, knowledge_without
from meal_bayes.agents.exploration import first_percept_value, fitted_weights, information_value
from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.domain import load_domain
from meal_bayes.perception import table_counts
from meal_bayes.posterior import ConfusionPosterior

HELD_OUT = 3


def numbers(knowledge):
    """All that is known, in one vector."""
    posterior = knowledge.posterior
    parts = [posterior.mean, posterior.precision, posterior.counts]
    spread = 0.0 if knowledge.trait is None else knowledge.trait.sd
    rest = [knowledge.base_rates, [spread]]
    return np.concatenate([np.ravel(part) for part in (*parts, *rest)])


@pytest.mark.parametrize("object_level", [False, True])
@pytest.mark.parametrize("levels", [2, 4])
def test_every_object_but_the_held_out_one_enters(table, make, object_level, levels):
    def learn(table):
        return numbers(knowledge_without(table, HELD_OUT, levels=levels, object_level=object_level))

    before = learn(table)
    for other in range(len(table.objects)):
        after = learn(make.change_object(table, other))
        assert np.array_equal(before, after) == (other == HELD_OUT)


def test_base_rates_are_laplace_s_of_the_known_labels(table):
    labels = np.array(table.labels)
    labels[0, 0], labels[5, 0] = -1, -1
    knowledge = knowledge_without(replace(table, labels=labels), HELD_OUT)
    others = np.delete(labels[:, 0], HELD_OUT)
    expected = ((others == 1).sum() + 1) / ((others >= 0).sum() + 2)
    assert knowledge.base_rates[0] == pytest.approx(expected)
    others = np.delete(labels[:, 1], HELD_OUT)
    assert knowledge.base_rates[1] == pytest.approx(((others == 1).sum() + 1) / 9)


def test_the_paper_s_reading_takes_percepts_as_independent(table):
    knowledge = knowledge_without(table, HELD_OUT, object_level=False)
    assert np.isinf(knowledge.posterior.dispersion).all()
    assert knowledge.trait is None
    total = table_counts(table, HELD_OUT).sum(axis=0)
    np.testing.assert_array_equal(knowledge.posterior.counts, total)
    np.testing.assert_allclose(
        knowledge.posterior.mean, (total + 1) / (total + 1).sum(axis=-1, keepdims=True)
    )


def test_ours_lets_objects_differ(table):
    knowledge = knowledge_without(table, HELD_OUT)
    assert np.isfinite(knowledge.posterior.dispersion).all()
    assert 0.1 <= knowledge.trait.sd <= 2.0


TOY = load_domain("toy")
VALUE = np.array([[1.0, 2.0, 0.0], [4.0, 8.0, 0.0]])  # (P,E)
TWICE = np.full((2, 3), 2)  # each behavior once on each of two objects


def knowledge_from(counts):
    """Tables (P,E,2,K) of these counts a behavior and truth; base rates one half."""
    return Knowledge(TOY, ConfusionPosterior.from_counts(counts), np.full(2, 0.5))


def table(look=(6, 4), lift=(6, 4)):
    """Counts: so many of ten yes-percepts where false, the others turned around where true."""
    counts = np.full((2, 3, 2, 2), 5.0)
    for e, (no, yes) in enumerate((look, lift)):
        counts[:, e] = [[no, yes], [yes, no]]
    return counts


def progress(*, value=VALUE, knowledge=None, queries=9.0, **options):
    known = {
        "unit": 12.0, "instances": TWICE, "objects": TWICE, "fresh": np.ones((2, 3), bool),
        "labeled": np.zeros(2, bool),
    }  # fmt: skip
    return Progress(
        knowledge=knowledge or knowledge_from(table()), valued=lambda: value, queries=queries,
        **{**known, **options},
    )  # fmt: skip


def bonus_of(columns, **options):
    return first_percept_value(progress(**options), columns)


class TestBonus:
    def test_new_objects_pay_for_the_queried_attributes(self):
        for column in (0, 1):
            np.testing.assert_allclose(bonus_of([column]), 9 * VALUE[column] / 3)  # the third
        np.testing.assert_allclose(bonus_of([1, 0]), 9 * VALUE.sum(axis=0) / 3)

    def test_what_is_recorded_pays_nothing(self):
        assert (bonus_of([0, 1], fresh=np.zeros((2, 3), bool)) == 0).all()
        fresh = np.array([[True, False, True], [True, True, True]])  # lifted, and known to be red
        np.testing.assert_allclose(bonus_of([0], fresh=fresh), [9 * 1.0 / 3, 0.0, 0.0])

    def test_memory_pays_for_labels_of_before_as_well(self):
        bonus = bonus_of([0], labeled=np.array([False, True]))
        np.testing.assert_allclose(bonus, 3 * VALUE.sum(axis=0))

    def test_more_objects_are_worth_less_each(self):
        after = bonus_of([0], objects=np.array([[3, 2, 2], [2, 2, 2]]))
        np.testing.assert_allclose(after, [9 * 1.0 / 4, 9 * 2.0 / 3, 0.0])


class TestInformation:
    @staticmethod
    def value(counts):
        return information_value(knowledge_from(counts), reward=300.0, discount=0.99)

    def test_only_behaviors_with_modalities_have_it(self):
        value = self.value(table())
        assert value.shape == (2, 3)
        assert (value[:, 2] == 0).all()  # reinit perceives nothing
        assert (value[:, :2] > 0).all()

    def test_sure_tables_have_little_left_to_learn(self):
        few, many = self.value(table()), self.value(1000 * table())
        assert (many < 0.2 * few)[:, :2].all()

    def test_a_perfect_behavior_leaves_the_other_worthless(self):
        value = self.value(table(look=(5000, 0), lift=(6, 4)))
        assert (value[:, 1] < 1e-6).all()

    def test_attributes_are_valued_each_by_its_own_table(self):
        counts = table()
        counts[1] *= 1000
        value, alone = self.value(counts), self.value(table())
        np.testing.assert_allclose(value[0], alone[0], atol=0.1)
        assert (value[1, :2] < value[0, :2]).all()


class TestFittedWeights:
    def test_they_are_nonnegative_and_scale_with_the_queries(self):
        knowledge = knowledge_from(table(lift=(9, 1)))
        for seed in range(5):
            value = np.random.default_rng(seed).uniform(0, 5, (2, 3))
            weights = fitted_weights(progress(value=value, knowledge=knowledge, queries=10.0))
            ten = fitted_weights(progress(value=value, knowledge=knowledge, queries=100.0))
            assert min(weights) >= 0
            assert ten == pytest.approx((10 * weights[0], 10 * weights[1]))

    def test_worthless_exploring_is_not_paid(self):
        assert fitted_weights(progress(value=np.zeros((2, 3)))) == (0.0, 0.0)

    def test_a_bonus_of_equation_11_is_found_again(self):
        knowledge = knowledge_from(table(look=(9, 1), lift=(6, 4)))
        instances = np.array([[4, 2, 2], [2, 2, 2]])  # more experience of red by look
        rows = knowledge.posterior.select(range(2), exact=True)[0][:, :2]
        entropy = -(rows * np.log2(rows)).sum(axis=-1).mean(axis=-1)
        value = np.zeros((2, 3))
        value[:, :2] = (7.0 * entropy - 11.0 * instances[:, :2] / 12.0) * (TWICE[:, :2] + 1) / 5.0
        weights = fitted_weights(
            progress(value=value, knowledge=knowledge, queries=5.0, instances=instances)
        )
        assert weights == pytest.approx((7.0, 11.0))
