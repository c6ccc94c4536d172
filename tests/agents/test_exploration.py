"""What exploring is paid, by what is known; Eq. 11 with weights from the posterior."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.agents import Horizon, LearningBonus, Progress
from meal_bayes.agents.base_rates import learn_base_rates
from meal_bayes.agents.exploration import (
    AHEAD,
    as_equation_11,
    experience_bits,
    explained,
    learning_prices,
    prices,
    rates_ahead,
)
from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp
from meal_bayes.posterior import ConfusionPosterior

TOY = load_domain("toy")
P = len(TOY.attributes)
E = len(TOY.behaviors)
NEW = np.zeros((P, E, 2, 2))


def knowledge_of(percepts, base_rates=(0.5, 0.5), domain=TOY):
    nobody = np.empty((0, len(base_rates)), np.int8)
    return Knowledge(domain, ConfusionPosterior.from_counts(percepts), np.array(base_rates), nobody)


def progress(percepts=NEW, **options):
    """Of a robot that was told everything so far, and expects a hundred questions."""
    objects = percepts.sum(axis=(2, 3)).astype(int)
    known = {
        "knowledge": knowledge_of(percepts), "horizon": Horizon(expected=100.0), "reward": 100.0,
        "discount": 1.0, "percepts": percepts, "told_fraction": 0.99, "unit": 12.0,
        "instances": objects,
        "objects": objects, "fresh": np.ones((P, E), bool), "labeled": np.zeros(P, bool),
    }  # fmt: skip
    return Progress(**{**known, **options})


def shown(n, yes_of_true):
    """Percepts of n objects by each behavior, half of them true; the false ones the other way."""
    percepts = np.empty((P, E, 2, 2))
    percepts[:, :, 1] = n / 2 * np.array([1 - yes_of_true, yes_of_true])
    percepts[:, :, 0] = n / 2 * np.array([yes_of_true, 1 - yes_of_true])
    return percepts


class TestPrices:
    def test_ignorance_is_paid_less_the_more_objects_were_perceived(self):
        paid = [learning_prices(progress(shown(n, 0.5)), 1)[0] for n in (0, 2, 8, 32, 128, 1000)]
        assert (np.diff(paid, axis=0)[:, :2] < 0).all()
        assert (paid[-1] < 0.01 * paid[0] + 1e-9).all()

    def test_what_perceives_nothing_is_worth_nothing(self):
        paid = learning_prices(progress(), 1)
        senses = np.isin(np.arange(E), TOY.recorded)
        assert (paid[:, ~senses] == 0).all()
        assert (paid[:, senses] > 0).all()

    def test_one_push_of_an_object_does_not_end_exploring(self):
        once = np.zeros((P, E, 2, 2))
        once[:, :, 1] = [0.5, 0.5]  # by a classifier that cannot tell yet
        paid = learning_prices(progress(once), 1)[:, 0]
        assert (paid > TOY.behaviors[0].cost).all()

    @pytest.mark.parametrize("horizon", [Horizon(expected=0.0), Horizon(expected=1.0)])
    def test_knowledge_that_comes_too_late_is_worth_nothing(self, horizon):
        assert (learning_prices(progress(horizon=horizon), 1) == 0).all()

    @given(st.integers(0, 2**32 - 1))
    def test_relabeled_attributes_permute_it(self, seed):
        percepts = np.random.default_rng(seed).uniform(0, 6, NEW.shape)
        mixed = percepts[::-1]
        turned = progress(mixed, knowledge=knowledge_of(mixed, (0.7, 0.3)))
        plain = progress(percepts, knowledge=knowledge_of(percepts, (0.3, 0.7)))
        straight = learning_prices(plain, 1)
        np.testing.assert_allclose(learning_prices(turned, 1), straight[::-1], rtol=1e-9)

    @given(st.integers(0, 2**32 - 1), st.sampled_from([0.5, 4.0]))
    def test_rewards_and_costs_in_another_unit_scale_it(self, seed, unit):
        percepts = np.random.default_rng(seed).uniform(0, 6, NEW.shape)
        behaviors = tuple(replace(b, cost=unit * b.cost) for b in TOY.behaviors)
        domain = replace(TOY, behaviors=behaviors, report_reward=unit * TOY.report_reward)
        other = progress(
            percepts, knowledge=knowledge_of(percepts, domain=domain), reward=unit * 100.0
        )
        expected = unit * learning_prices(progress(percepts), 1)
        np.testing.assert_allclose(learning_prices(other, 1), expected, rtol=1e-6, atol=1e-6)

    def test_base_rates_alone_move_it(self):
        """No value is kept: three labels of one truth end exploring only as long as they hold."""
        percepts = shown(4, 0.5)
        rare = progress(percepts, knowledge=knowledge_of(percepts, (0.97, 0.97)))
        even = progress(percepts, knowledge=knowledge_of(percepts, (0.54, 0.54)))
        assert (learning_prices(rare, 1)[:, 0] < 0.5 * learning_prices(even, 1)[:, 0]).all()

    def test_a_substitute_is_worth_what_it_adds(self):
        gain = np.maximum(np.linspace(-2.2, 2.2, 9), 0.0)[None, None] * np.ones((1, 2, 1))
        known = explained(np.ones((1, 2, 2, 2)), np.full((1, 1), 0.5))
        questions = np.maximum(20.0 - AHEAD, 0.0)
        alone = prices(gain[:, :1], known[:, :1], questions, np.array([0.1]))
        both = prices(gain, known, questions, np.array([0.1, 0.2]))
        assert both[0, 0] == pytest.approx(alone[0, 0])
        assert 0 < both[0, 1] < alone[0, 0]
        dear = prices(gain, known, questions, np.array([1000.0, 1000.0]))
        np.testing.assert_allclose(dear, alone[0, 0])  # neither will be learned

    @given(st.floats(0.01, 0.99), st.floats(0.5, 200.0), st.floats(0.05, 0.95))
    def test_rates_ahead_have_the_posterior_s_mean_and_what_is_explained_grows(self, m, n, p):
        alpha = np.array([[[n * (1 - m), n * m], [n * m, n * (1 - m)]]]) + 0.1
        rates = rates_ahead(alpha)
        mean = alpha[..., 1] / alpha.sum(axis=-1)
        np.testing.assert_allclose(rates[:, 4], np.clip(mean, 0.01, 0.99))
        assert (np.diff(rates[0, :, 1]) >= 0).all()
        assert (np.diff(rates[0, :, 0]) <= 0).all()
        part = explained(alpha, np.array([p]))
        assert (np.diff(part) > 0).all()
        assert part[0, 0] > 0
        assert part[0, -1] < 1


class TestEquation11:
    def test_its_terms_make_the_price(self):
        for percepts in (NEW, shown(4, 0.5), shown(12, 0.8)):
            terms = as_equation_11(progress(percepts))
            expected = learning_prices(progress(percepts), 1)
            np.testing.assert_allclose(terms.bonus, expected, atol=1e-12)
            assert (terms.experience < terms.entropy).all()
            assert (terms.weight >= 0).all()

    def test_of_nothing_a_percept_teaches_a_quarter_of_a_bit(self):
        terms = as_equation_11(progress())
        np.testing.assert_allclose(terms.entropy, 1.0)
        np.testing.assert_allclose(terms.experience, 0.7213, atol=1e-4)

    @given(st.integers(0, 50), st.floats(0, 1))
    def test_what_a_percept_teaches_falls_as_one_over_the_objects(self, n, part):
        k = part * n
        alpha = np.array([[1 + n - k, 1 + k], [1 + n - k, 1 + k]])
        mean = alpha[0, 1] / alpha[0].sum()
        entropy = -(mean * np.log2(mean) + (1 - mean) * np.log2(1 - mean))
        teaches = entropy - experience_bits(alpha, np.array(0.5))
        assert 0.99 <= 1.79 * (n + 2) * teaches <= 1.29


def paid(known, asked=0):
    """Seconds that a first percept of each behavior is paid where one attribute is asked, (E,)."""
    query = Query((TOY.attributes[asked],))
    momdp = build_momdp(TOY, query, np.full((1, E, 2, 2), 0.5), np.inf)
    return LearningBonus().shape(momdp, known).bonus[0, :, 0]


class TestBonus:
    def test_a_pair_that_is_recorded_pays_nothing(self):
        fresh = np.ones((P, E), bool)
        fresh[:, 0] = False
        each = paid(progress(fresh=fresh))
        assert each[0] == 0
        assert each[1] > 0

    @pytest.mark.parametrize("told", [0.01, 0.3, 0.8])
    def test_others_attributes_are_paid_as_often_as_they_are_told(self, told):
        known = progress(told_fraction=told)
        each = learning_prices(known, 1)
        np.testing.assert_allclose(paid(known), each[0] + told * each[1])

    def test_an_object_that_is_known_again_is_paid_for_what_was_told_of_it(self):
        known = progress(told_fraction=0.1, labeled=np.array([False, True]))
        each = learning_prices(known, 1)
        np.testing.assert_allclose(paid(known), each[0] + each[1])

    def test_gains_are_means_over_the_rates_that_may_be_true(self):
        """Of a rate that is hardly known a percept may change the answer; of one that is not."""
        labels = np.zeros((2, P), np.int8)
        few = learn_base_rates(TOY, labels)
        known = knowledge_of(NEW, few.mean)
        uncertain = learning_prices(progress(knowledge=replace(known, rates=few)), 1)
        certain = learning_prices(progress(knowledge=known), 1)
        senses = np.isin(np.arange(E), TOY.recorded)
        assert (uncertain[:, senses] > 0).all()
        assert not np.allclose(uncertain, certain)
        many = learn_base_rates(TOY, np.tile(np.array([[0, 1]], np.int8), (4000, 1)))
        sure = knowledge_of(NEW, many.mean)
        np.testing.assert_allclose(
            learning_prices(progress(knowledge=replace(sure, rates=many)), 1),
            learning_prices(progress(knowledge=sure), 1),
            atol=0.5,
        )

    def test_it_is_paid_whatever_the_truth(self):
        momdp = build_momdp(TOY, Query(TOY.attributes[:1]), np.full((1, E, 2, 2), 0.5), np.inf)
        bonus = LearningBonus().shape(momdp, progress()).bonus
        assert bonus.shape == (1, E, 2)
        np.testing.assert_array_equal(bonus[..., 0], bonus[..., 1])


class TestHorizon:
    def test_a_robot_expects_as_many_questions_as_it_was_asked_and_twenty(self):
        assert Horizon().questions == 20
        assert Horizon(asked=80).questions == 100
        assert Horizon(asked=80, expected=7.0).questions == 7

    @given(st.integers(0, 1000), st.integers(0, 1000))
    def test_the_expectations_agree_with_each_other(self, asked, more):
        """The chance to be asked so many more, times what is then expected."""
        now = Horizon(asked)
        then = Horizon(asked + more)
        chance = (now.questions / (now.questions + more)) ** 2
        assert float(now.after(np.array(float(more)))) == pytest.approx(chance * then.questions)

    def test_a_number_is_counted_down(self):
        left = Horizon(expected=10.0).after(np.array([0.0, 4.0, 16.0]))
        np.testing.assert_array_equal(left, [10, 6, 0])
