"""Robots that keep their own state, and raise when they are commanded what they cannot do."""

import warnings

import numpy as np
import pytest

from meal_bayes import Learner, Outcome, load_domain


def drawn_domain(rng):
    """Return a domain of drawn states, behaviors and effects."""
    states = [f"s{i}" for i in range(int(rng.integers(1, 5)))]
    names = [f"b{i}" for i in range(int(rng.integers(2, 7)))]
    effects = []
    for number, name in enumerate(names):
        sources = [s for s in states if number == 0 or rng.random() < 0.5] or [
            states[number % len(states)]
        ]
        for source in sources:
            target = str(rng.choice(states)) if rng.random() < 0.5 else source
            if number == 0:  # it leads through all states
                target = states[(states.index(source) + 1) % len(states)]
            probability = float(rng.choice([1.0, 0.8]))
            effects.append({"from": source, "do": name, "to": target, "probability": probability})
    return load_domain(
        {
            "name": "drawn",
            "attributes": ["red", "full"],
            "report_reward": 60.0,
            "behaviors": [
                {"name": name, "cost": round(float(rng.uniform(0.5, 5)), 1)}
                | ({"modalities": ["m"]} if rng.random() < 0.8 or name == names[-1] else {})
                for name in names
            ],
            "diagram": {"states": states, "start": states[0], "effects": effects},
        }
    )


class Machine:
    """A robot that does what the diagram says, but for a rare move that it excludes."""

    def __init__(self, domain, rng):
        self.domain = domain
        self.rng = rng
        self.state = str(rng.choice(domain.diagram.states[:-1]))
        self.effects = {(e.source, e.behavior): e for e in domain.diagram.effects}
        self.excluded = []

    def start(self):
        return self.state

    def execute(self, behavior):
        if (self.state, behavior) not in self.effects:
            raise AssertionError(f"commanded {behavior} in {self.state}")
        effect = self.effects[self.state, behavior]
        spec = self.domain.behaviors[self.domain.behavior_index(behavior)]
        sensed = {name: self.rng.normal(size=2) for name in spec.modalities} or None
        draw = self.rng.random()
        if draw < 0.1:  # it ends where nobody expected it
            after = str(self.rng.choice(self.domain.diagram.states[:-1]))
            if after not in (self.state, effect.target):
                self.excluded.append(f"{behavior} led from {self.state!r} to {after!r}")
            self.state = after
            return Outcome(after, sensed if after != effect.source else None)
        if draw < 0.3:
            return Outcome(self.state)
        self.state = effect.target
        return Outcome(self.state, sensed)


@pytest.mark.quick(3)
@pytest.mark.parametrize("seed", range(67))  # 201 sessions
def test_no_command_is_impossible_and_every_excluded_move_is_told(seed):
    rng = np.random.default_rng(seed)
    domain = drawn_domain(rng)
    agent = ("random_legal", "bayes", "greedy")[seed % 3]
    learner = Learner(domain, agent=agent, logs=None, seed=seed)
    robot = Machine(domain, rng)
    for number in range(3):
        robot.excluded.clear()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            trial = learner.ask("Is it red, and is it full?", robot, object_name=f"cup {number}")
        assert trial.ended == ""
        told = [str(warning.message) for warning in caught]
        logged = " ".join(step.warning for step in trial.steps)
        for move in robot.excluded:
            assert any(move in text for text in told), (move, told)
            assert move in logged
        learner.tell(trial, {"red": bool(number % 2), "full": True})
