import numpy as np
import pytest

from meal_bayes.datasets import Instance
from meal_bayes.domain import Query
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.perception import RecordedPercepts, SampledPercepts
from meal_bayes.perception.perceiver import answer

BOTH = Query(("heavy", "red"))  # not in the domain's order


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def test_recorded_percepts_are_looked_up_by_object_recording_and_behavior(small_table, rng):
    for levels in (2, 4):
        perceiver = RecordedPercepts(small_table, levels)
        for o in range(4):
            for r in range(3):
                instance = Instance(o, "lift", r)
                raw = small_table.log_odds[o, r, 1, [1, 0]]
                expected = small_table.levels_of(raw, levels)
                assert perceiver.observe(instance, BOTH, rng).tolist() == expected.tolist()


def test_levels_must_divide_the_bins(small_table):
    with pytest.raises(SettingsError, match=r"3 levels; expected one of \[2, 4, 8\]"):
        RecordedPercepts(small_table, 3)


@pytest.mark.statistical
@pytest.mark.parametrize("n", [1, 2, 3])
def test_each_attribute_of_an_answer_is_right_with_its_accuracy(rng, n):
    labels = np.array([1, 0, 1], np.int8)[:n]
    trials = 4000
    right = np.mean([answer(labels, 0.7, 4, rng) == labels * 3 for _ in range(trials)], axis=0)
    assert (abs(right - 0.7) < 5 * np.sqrt(0.7 * 0.3 / trials)).all()


def test_answers_come_from_the_labels_and_in_extreme_levels(small_table):
    perceiver = RecordedPercepts(small_table, 4)
    sure = small_table.domain.behaviors[3].answer_accuracy
    assert sure == 0.7
    drawn = [
        perceiver.observe(Instance(1, "ask", 0), BOTH, np.random.default_rng(seed)).tolist()
        for seed in range(50)
    ]
    assert {level for row in drawn for level in row} == {0, 3}
    truth = [0, 3]  # heavy: no, red: yes
    assert (np.mean(np.array(drawn) == truth, axis=0) > 0.5).all()


def test_nobody_knows_is_a_coin(rng):
    yes = [int(answer(np.array([-1], np.int8), 1.0, 2, rng)[0]) for _ in range(400)]
    assert 100 < sum(yes) < 300


def test_a_seed_gives_the_same_percepts(small_table):
    perceiver = RecordedPercepts(small_table, 2)
    first, second = (
        [perceiver.observe(Instance(0, "ask", 0), BOTH, rng).tolist() for _ in range(20)]
        for rng in (np.random.default_rng(5), np.random.default_rng(5))
    )
    assert first == second


@pytest.mark.statistical
def test_the_sampler_draws_from_the_row_of_the_truth(small_table, rng):
    confusion = np.random.default_rng(0).dirichlet(np.ones(4), size=(2, 4, 2))
    sampler = SampledPercepts(small_table.domain, small_table.labels, confusion)
    instance = Instance(0, "lift", 0)  # red: false, heavy: true
    drawn = np.array([sampler.observe(instance, BOTH, rng) for _ in range(4000)])
    for column, row in ((0, confusion[1, 1, 1]), (1, confusion[0, 1, 0])):
        share = np.bincount(drawn[:, column], minlength=4) / len(drawn)
        assert (np.abs(share - row) < 5 * np.sqrt(row * (1 - row) / len(drawn)) + 1e-9).all()


def test_the_sampler_answers_like_a_person(small_table, rng):
    sampler = SampledPercepts(small_table.domain, small_table.labels, np.full((2, 4, 2, 4), 0.25))
    said = [sampler.observe(Instance(0, "ask", 0), BOTH, rng).tolist() for _ in range(200)]
    assert {level for row in said for level in row} == {0, 3}


def test_the_sampler_refuses_matrices_of_another_domain(small_table):
    with pytest.raises(DataError, match=r"expected \(2,4,2,K\)"):
        SampledPercepts(small_table.domain, small_table.labels, np.full((2, 3, 2, 2), 0.5))
