"""How often a person who is asked by a behavior is right: learned from labels that are told."""

import pytest

from meal_bayes.learner import Learner, recall
from meal_bayes.robots import Outcome


class Asks:
    """A robot that asks a person, who says always the same."""

    def __init__(self, said):
        self.said = said

    def start(self):
        return "table"

    def execute(self, behavior):
        return Outcome("table", answers={"red": self.said})


def accuracy(learner):
    """Return how often answers are right by what was learned."""
    return learner.knowledge().domain.behaviors[-1].answer_accuracy


def test_the_rate_of_right_answers_is_learned(make, tmp_path):
    kitchen = {
        **make.kitchen,
        "behaviors": [
            *make.kitchen["behaviors"],
            {"name": "ask", "cost": 2, "answer_accuracy": 0.7},
        ],
        "diagram": {
            **make.kitchen["diagram"],
            "effects": [
                *make.kitchen["diagram"]["effects"],
                {"from": "table", "do": "ask", "to": "table"},
            ],
        },
    }
    agent = make.agent("ask", **make.ours)
    learner = Learner(kitchen, agent=agent, logs=tmp_path / "logs")
    assert accuracy(learner) == 0.7
    trials = []
    for n in range(8):
        trials.append(learner.ask("red", Asks(n != 0)))
        assert accuracy(learner) == pytest.approx((1.4 + max(n - 1, 0)) / (2 + n), abs=0.05)
        learner.tell(trials[-1], {"red": True})
    assert accuracy(learner) == pytest.approx(0.84, abs=0.05)  # 7 of 8, and two at .7
    learner.refit()
    assert accuracy(learner) == pytest.approx((1.4 + 7) / 10)
    momdp = learner.problem("red")
    assert momdp.rows[0, -1, 1, -1] == pytest.approx(0.84)
    learner.save(tmp_path / "learner")
    loaded = Learner.load(tmp_path / "learner", agent=agent, logs=None)
    recalled = Learner(kitchen, agent=agent, logs=None)
    recall(recalled, tmp_path / "logs")
    for other in (loaded, recalled):
        assert accuracy(other) == accuracy(learner)
    learner.forget(trials[0], recordings=True)  # the wrong one
    assert accuracy(learner) == pytest.approx((1.4 + 7) / 9)
