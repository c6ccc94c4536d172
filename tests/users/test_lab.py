"""A lab from nothing, whose microphone dies, and labs that nobody thought of."""

import warnings

import numpy as np
import pytest

import meal_bayes as mb
from meal_bayes.agents import AGENTS

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
        self.item = item
        self.rng = rng
        self.deaf = deaf
        self.executed = []

    def start(self):
        self.state = "table"
        return self.state

    def execute(self, behavior):
        assert behavior in LEGAL[self.state]
        self.executed.append(behavior)
        full = self.item["full"]
        metal = self.item["metal"]
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


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*yielded nothing:UserWarning")  # lift may fail twice
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
    shaken = 0
    for number in range(4):  # the microphone dies
        item = {"full": number % 2 == 0, "metal": number % 3 == 0}
        robot = Bench(item, rng, deaf=True)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            trial = learner.ask("Is it full, and is it metal?", robot, truth=item)
        told = any("shake" in str(warning.message) for warning in caught)
        in_log = any("audio" in step.warning for step in trial.steps)
        assert told == in_log == ("shake" in robot.executed)
        shaken += told
        assert not trial.ended  # it came to an answer, or to "I do not know"
    assert shaken > 0  # a trial may be settled by what comes before


def test_shaping_pays_no_robot_without_end():
    rng = np.random.default_rng(5)
    learner = mb.Learner(LAB, agent="morc_itrs", logs=None)
    item = {"full": True, "metal": False}
    trial = learner.ask("Is it full, and is it metal?", Bench(item, rng), truth=item)
    assert 5 < len(trial.steps) < 40  # 3 behaviors, each paid ten times at most


def random_lab(rng):
    """Draw a domain: one-way steps, free behaviors, such that fail, sense nothing, or lead away."""
    every = [f"s{i}" for i in range(rng.integers(1, 5))]
    effects = []
    for e in range(rng.integers(1, 6)):
        for x in every:
            if rng.random() < 0.5 or (e == 0 and x == "s0"):
                chance = float(rng.choice([1.0, 0.9, 0.5, 0.05]))
                to = str(rng.choice(every))
                senses = bool(rng.random() < 0.8)
                effects.append(
                    {"from": x, "do": f"b{e}", "to": to, "probability": chance, "senses": senses}
                )
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
        self.features = signal * np.array(values, float)
        self.rng = rng
        self.dead = dead

    def start(self):
        self.state = "s0"
        return self.state

    def execute(self, behavior):
        effect = self.effects[self.state, behavior]  # a KeyError where it is not legal
        if self.dead or self.rng.random() > effect["probability"]:
            return mb.Outcome(self.state)
        self.state = effect["to"]
        percept = {"m": self.features + self.rng.normal(size=len(self.features))}
        senses = behavior in self.sensing and effect["senses"]
        return mb.Outcome(self.state, percept if senses else None)


@pytest.mark.quick(10)
@pytest.mark.filterwarnings("ignore:The agent .* answered without touching")
@pytest.mark.parametrize("asked", [["full"], ["full", "metal"]])
@pytest.mark.parametrize("agent", AGENTS)
def test_what_senses_nothing_is_no_plan(agent, asked):
    """The only behavior has a microphone, and is heard in no state."""
    effects = [{"from": "table", "do": "tap", "to": "table", "senses": False}]
    lab = {
        **LAB,
        "behaviors": [{"name": "tap", "cost": 1.0, "modalities": ["audio"]}],
        "diagram": {"states": ["table"], "start": "table", "effects": effects},
        "predefined": ["tap"],
    }
    learner = mb.Learner(lab, agent=agent, logs=None)

    class Deaf:
        def start(self):
            return "table"

        def execute(self, behavior):
            return mb.Outcome("table")

    trial = learner.ask(asked, Deaf(), max_steps=4)
    assert trial.ended == ""
    assert trial.last_belief.positive.tolist() == trial.first_belief.positive.tolist()


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
