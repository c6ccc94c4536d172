"""What a person says after a trial and what follows from it; what nobody should say."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.learner import Feedback, Learner
from meal_bayes.robots import Outcome


@pytest.fixture(scope="module")
def trial():
    learner = Learner("roc36", agent="predefined", logs=None).fit(load_percepts("roc36"))
    return learner.ask("heavy, blue", "heavy_blue_beans")


class TestFeedback:
    @staticmethod
    def said(trial, report, truth, **options):
        trial = replace(
            trial,
            report=None if report is None else np.array(report, bool),
            truth=np.array(truth, bool),
        )
        return Feedback(**options).labels(trial, np.random.default_rng(0)).tolist()

    @pytest.mark.parametrize(
        ("report", "truth", "told"),
        [
            ([1], [1], [1]),
            ([1], [0], [0]),
            ([0], [1], [1]),
            ([0], [0], [0]),
            (None, [1], [-1]),
            ([1, 0], [1, 0], [1, 0]),
            ([1, 0], [1, 1], [-1, -1]),
            ([0, 1], [1, 0], [-1, -1]),
            (None, [1, 1], [-1, -1]),
        ],
    )
    def test_a_verdict_teaches_what_it_implies(self, trial, report, truth, told):
        assert self.said(trial, report, truth) == told

    @pytest.mark.parametrize("report", [[1, 0], [0, 0], None])
    def test_all_answers_teach_everything(self, trial, report):
        assert self.said(trial, report, [0, 1], answers="all") == [0, 1]

    @pytest.mark.statistical
    @pytest.mark.parametrize("answers", ["verdict", "all"])
    def test_people_err_as_often_as_said(self, trial, answers):
        one = replace(trial, report=np.array([True]), truth=np.array([True]))
        feedback, rng, n = Feedback(answers, 0.2), np.random.default_rng(1), 4000
        wrong = sum(feedback.labels(one, rng)[0] == 0 for _ in range(n))
        assert abs(wrong / n - 0.2) < 5 * np.sqrt(0.2 * 0.8 / n)

    def test_an_erring_verdict_on_two_attributes_labels_the_wrong_report(self, trial):
        two = replace(trial, report=np.array([True, False]), truth=np.array([True, True]))
        feedback, rng = Feedback("verdict", 0.5), np.random.default_rng(1)
        labels = {tuple(feedback.labels(two, rng).tolist()) for _ in range(50)}
        assert labels == {(-1, -1), (1, 0)}

    @pytest.mark.parametrize(
        ("wrong", "message"),
        [
            ({"answers": "verdikt"}, "did you mean 'verdict'"),
            ({"error": 1.0}, "give 0 to below 1"),
            ({"error": float("nan")}, "give 0 to below 1"),
        ],
    )
    def test_settings_are_checked(self, wrong, message):
        with pytest.raises(SettingsError, match=message):
            Feedback(**wrong)


def test_another_value_of_a_group_replaces_the_earlier_one():
    learner = Learner("roc36", agent="greedy", logs=None)
    learner.tell("jar", {"content": "rice"})
    learner.tell("jar", {"beans": True})
    known = dict(
        zip(learner.domain.attributes, learner.experience.labels_for(["jar"])[0], strict=True)
    )
    assert (known["rice"], known["beans"]) == (0, 1)


class Arm:
    def start(self):
        return "x0"

    def execute(self, behavior):
        return Outcome("x0")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda learner: learner.ask("red", Arm), "A robot is an object with start"),
        (lambda learner: learner.begin("red", key=1.5), r"key is 1\.5; give a text"),
        (lambda learner: learner.begin("red", object_name=3), "object_name is 3; give a text"),
        (lambda learner: learner.begin(3), "A question is a sentence or names; found 3"),
        (lambda learner: learner.tell(3, {"red": True}), "object's name; found 3"),
        (lambda learner: learner.tell("cup", {"red": [1, 0]}), "^red: "),
        (lambda learner: Learner("toy", reward=1e100), "reward is 1e\\+100; give a finite number"),
    ],
)
def test_values_of_other_types_are_one_line(call, message):
    with pytest.raises((SettingsError, QueryError), match=message):
        call(Learner("toy", logs=None))
