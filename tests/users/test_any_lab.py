"""Labs that nobody thought of: whatever the diagram, no agent commands what is not legal."""

import warnings

import numpy as np
import pytest

import meal_bayes as mb
from meal_bayes.agents import AGENTS


def random_lab(rng):
    """Draw a domain: one-way steps, free behaviors, such that fail, sense nothing, or lead away."""
    every = [f"s{i}" for i in range(rng.integers(1, 5))]
    effects = []
    for e in range(rng.integers(1, 6)):
        for x in every:
            if rng.random() < 0.5 or (e == 0 and x == "s0"):
                chance = float(rng.choice([1.0, 0.9, 0.5, 0.05]))
                to = str(rng.choice(every))
                effects.append({"from": x, "do": f"b{e}", "to": to, "probability": chance})
    reached = {"s0"}
    for _ in every:
        reached |= {effect["to"] for effect in effects if effect["from"] in reached}
    effects = [effect for effect in effects if effect["from"] in reached]
    behaviors = [
        {"name": name, "cost": float(rng.choice([0.0, 0.5, 2.0, 20.0])),
         "modalities": ["m"] if name == "b0" or rng.random() < 0.8 else []}
        for name in sorted({effect["do"] for effect in effects})
    ]  # fmt: skip
    return {
        "name": "any", "attributes": ["red", "full", "metal"][: rng.integers(1, 4)],
        "report_reward": float(rng.choice([5.0, 60.0, 500.0])), "behaviors": behaviors,
        "diagram": {"states": sorted(reached), "start": "s0", "effects": effects},
    }  # fmt: skip


class Bot:
    """Raises at a behavior that is not legal; `dead`: nothing works."""

    def __init__(self, lab, values, signal, rng, *, dead):
        self.effects = {(e["from"], e["do"]): e for e in lab["diagram"]["effects"]}
        self.sensing = {each["name"] for each in lab["behaviors"] if each["modalities"]}
        self.features, self.rng, self.dead = signal * np.array(values, float), rng, dead

    def start(self):
        self.state = "s0"
        return self.state

    def execute(self, behavior):
        effect = self.effects[self.state, behavior]  # a KeyError where it is not legal
        if self.dead or self.rng.random() > effect["probability"]:
            return mb.Outcome(self.state)
        self.state = effect["to"]
        percept = {"m": self.features + self.rng.normal(size=len(self.features))}
        return mb.Outcome(self.state, percept if behavior in self.sensing else None)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
def test_no_agent_commands_what_is_not_legal(seed):
    rng = np.random.default_rng(seed)
    for agent in AGENTS:
        lab = random_lab(rng)
        learner = mb.Learner(lab, agent=agent, logs=None, seed=seed)
        signal = rng.choice([0.0, 0.5, 5.0])
        for number in range(4):
            values = rng.integers(2, size=len(lab["attributes"])).astype(bool)
            truth = dict(zip(lab["attributes"], values.tolist(), strict=True))
            bot = Bot(lab, values, signal, rng, dead=number == 3)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                trial = learner.ask(lab["attributes"], bot, truth=truth)
            assert len(trial.steps) <= 101
            learner.tell(trial, truth)
