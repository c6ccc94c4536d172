"""A lab from nothing: a domain in Python, a driver whose microphone dies, labels, a restart."""

import numpy as np
import pytest

import meal_bayes as mb

LAB = {
    "name": "bench",
    "attributes": ["full", "metal"],
    "report_reward": 60.0,
    "behaviors": [
        {"name": "press", "cost": 2.0, "modalities": ["force"]},
        {"name": "lift", "cost": 4.0, "modalities": ["wrist"]},
        {"name": "shake", "cost": 3.0, "modalities": ["audio", "wrist"]},
    ],
    "diagram": {
        "states": ["table", "hand"],
        "start": "table",
        "effects": [
            {"from": "table", "do": "press", "to": "table"},
            {"from": "table", "do": "lift", "to": "hand", "probability": 0.9},
            {"from": "hand", "do": "shake", "to": "hand"},
        ],
    },
}
LEGAL = {"table": ("press", "lift"), "hand": ("shake",)}


class Bench:
    """Pretends to hold an object; raises at a behavior that its state does not allow."""

    def __init__(self, item, rng, *, deaf=False):
        self.item, self.rng, self.deaf = item, rng, deaf
        self.executed = []

    def start(self):
        self.state = "table"
        return self.state

    def execute(self, behavior):
        assert behavior in LEGAL[self.state]
        self.executed.append(behavior)
        full, metal = self.item["full"], self.item["metal"]
        noise = self.rng.normal
        if behavior == "press":
            return mb.Outcome(self.state, {"force": noise([3.0 * metal], 1)})
        if behavior == "lift":
            if self.rng.random() < 0.1:
                return mb.Outcome(self.state)
            self.state = "hand"
            return mb.Outcome(self.state, {"wrist": noise([2 + 3 * full, 0], 1)})
        percept = {"wrist": noise([2.0 + full, 0], 1)}
        if not self.deaf:
            percept["audio"] = noise([4.0 * full, 3.0 * metal, 0], 1)
        return mb.Outcome(self.state, percept)


def test_a_lab_begins_with_nothing(tmp_path):
    rng = np.random.default_rng(5)
    learner = mb.Learner(LAB, logs=tmp_path / "logs")
    right = []
    for number in range(40):
        item = {"full": bool(rng.integers(2)), "metal": bool(rng.integers(2))}
        trial = learner.ask("Is it full, and is it metal?", Bench(item, rng), truth=item)
        learner.tell(trial, item)
        right.append(trial.success)
        if number == 25:  # the process restarts
            learner.save(tmp_path / "bench.mind")
            learner = mb.Learner.load(tmp_path / "bench.mind", logs=tmp_path / "logs")
    assert np.mean(right[20:]) >= 0.8
    assert len(list(mb.read_trials(tmp_path / "logs"))) == 40
    for number in range(4):  # the microphone dies
        item = {"full": number % 2 == 0, "metal": number % 3 == 0}
        robot = Bench(item, rng, deaf=True)
        with pytest.warns(UserWarning, match="shake"):
            trial = learner.ask("Is it full, and is it metal?", robot, truth=item)
        assert any("audio" in step.warning for step in trial.steps)
        assert trial.report is not None


def test_shaping_pays_no_robot_without_end():
    rng = np.random.default_rng(5)
    learner = mb.Learner(LAB, agent="morc_itrs", logs=None)
    item = {"full": True, "metal": False}
    trial = learner.ask("Is it full, and is it metal?", Bench(item, rng), truth=item)
    assert 5 < len(trial.steps) < 40  # 3 behaviors, each paid ten times at most
