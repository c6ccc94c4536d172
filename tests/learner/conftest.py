"""A kitchen with two attributes, its recordings, and arms that work in it."""

from types import SimpleNamespace

import numpy as np
import pytest

from meal_bayes.agents import Agent
from meal_bayes.datasets import Dataset
from meal_bayes.domain import domain_from_table
from meal_bayes.learner import Learner
from meal_bayes.planners import OpenLoop, Predefined
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import file as log_file
from meal_bayes.trial_log.file import TrialWriter

OBJECTS = 12
RECORDINGS = 3
KITCHEN = {
    "name": "kitchen",
    "attributes": ["red", "full"],
    "report_reward": 60.0,
    "behaviors": [
        {"name": "look", "cost": 1.0, "modalities": ["color"]},
        {"name": "lift", "cost": 3.0, "modalities": ["force"]},
        {"name": "reset", "cost": 1.0},
    ],
    "diagram": {
        "states": ["table", "held"],
        "start": "table",
        "effects": [
            {"from": "table", "do": "look", "to": "table"},
            {"from": "table", "do": "lift", "to": "held", "probability": 0.9},
            {"from": "held", "do": "reset", "to": "table"},
        ],
    },
}
COLORS = np.array([[40.0, 60.0, 190.0], [200.0, 40.0, 40.0]])  # of what is not red, and red
FORCES = np.array([2.0, 5.5])


def make_dataset(seed=0):
    rng = np.random.default_rng(seed)
    domain = domain_from_table(KITCHEN)
    labels = np.array([[i % 2, (i // 2) % 2] for i in range(OBJECTS)], np.int8)
    look = COLORS[labels[:, 0]][:, None] + rng.normal(0, 50, (OBJECTS, RECORDINGS, 3))
    lift = FORCES[labels[:, 1]][:, None, None] + rng.normal(0, 1.2, (OBJECTS, RECORDINGS, 1))
    features = {("look", "color"): look, ("lift", "force"): lift}
    names = tuple(f"cup {i}" for i in range(OBJECTS))
    return Dataset(domain, names, {k: v.astype(np.float32) for k, v in features.items()}, labels)


class Arm:
    """A robot of one's own, with one object in front of it."""

    def __init__(self, red=False, full=True, seed=0):
        self.rng = np.random.default_rng(seed)
        self.red = red
        self.full = full
        self.executed = []

    def start(self):
        self.state = "table"
        return self.state

    def execute(self, behavior):
        self.executed.append(behavior)
        if behavior == "look":
            color = COLORS[int(self.red)] + self.rng.normal(0, 50, 3)
            return Outcome(self.state, {"color": color})
        if behavior == "reset":
            self.state = "table"
            return Outcome(self.state)
        self.state = "held"
        return Outcome(self.state, {"force": FORCES[[int(self.full)]] + self.rng.normal(0, 1.2, 1)})


class Faulty:
    """Looks as it is told to, however often."""

    def __init__(self, outcome):
        self.outcome = outcome

    def start(self):
        return "table"

    def execute(self, behavior):
        return self.outcome() if callable(self.outcome) else self.outcome


class Killed(BaseException):
    """The end of a process."""


class Kills:
    """Ends the process before the n-th write, or renaming, of any log from now on."""

    killed = Killed

    def __init__(self, monkeypatch):
        self.left = -1
        self.writers = []
        put = TrialWriter._put
        renamings = {name: getattr(log_file, name) for name in ("replace_whole", "name_new")}

        def counted(log, *args, **options):
            self.writers.append(log)
            self.count()
            put(log, *args, **options)

        def counting(rename):
            def renamed(*paths):
                self.count()
                rename(*paths)

            return renamed

        monkeypatch.setattr(TrialWriter, "_put", counted)
        for name, rename in renamings.items():
            monkeypatch.setattr(log_file, name, counting(rename))

    def count(self):
        if self.left == 0:
            raise Killed
        self.left -= 1

    def bury(self):
        """Let go of all that the dead process held."""
        self.left = -1
        for log in self.writers:
            log._file.close()
            if log._resumed is not None:
                log._resumed.release()
        self.writers.clear()


def agent_of(*behaviors, **options):
    """Make an agent that executes behaviors in order, and then reports."""
    return Agent("script", lambda domain, query: Predefined(behaviors), **options)


OURS = {"object_level": True, "shared_trait": True, "base_rates": True, "levels": 4}


def make_learner(dataset, agent=None, **options):
    agent = agent or Agent("ours", lambda domain, query: OpenLoop(), **OURS)
    return Learner(
        dataset.domain, agent=agent, **{"logs": None, "refit_every": None, **options}
    ).fit(dataset)


@pytest.fixture(scope="session")
def dataset():
    return make_dataset()


@pytest.fixture(scope="session")
def make():
    """The makers."""
    return SimpleNamespace(
        arm=Arm,
        faulty=Faulty,
        agent=agent_of,
        learner=make_learner,
        dataset=make_dataset,
        ours=OURS,
        kitchen=KITCHEN,
        kills=Kills,
    )


@pytest.fixture
def kills(monkeypatch):
    """What ends a process before the writes of its logs."""
    return Kills(monkeypatch)
