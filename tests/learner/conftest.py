"""A kitchen with two attributes, its recordings, arms that work in it, and searches of cups."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest

from meal_bayes.agents import Agent
from meal_bayes.datasets import Dataset
from meal_bayes.domain import domain_from_table
from meal_bayes.learner import Learner
from meal_bayes.planners import OpenLoop, Predefined
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import check_log, read_search, read_trials, writer
from meal_bayes.trial_log.writer import TrialWriter

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
        replace = writer.replace_whole

        def counted(log, *args, **options):
            self.writers.append(log)
            self.count()
            put(log, *args, **options)

        def renamed(*paths):
            self.count()
            replace(*paths)

        monkeypatch.setattr(TrialWriter, "_put", counted)
        monkeypatch.setattr(writer, "replace_whole", renamed)

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


CUPS = ("mug", "a/b.search", "glass")


class Table:
    """Cups on a table, whose outcomes depend on the cup and the number of the step alone."""

    def __init__(self, seed):
        self.seed = seed
        self.executed = 0

    def turn_to(self, session):
        explored = session.sessions[session.turn]
        return explored.momdp.x_names[explored.belief.x]

    def execute(self, session):
        self.executed += 1
        place = list(session.sessions).index(session.object)
        explored = session.sessions[session.object]
        rng = np.random.default_rng([self.seed, place, len(explored.steps)])
        if session.behavior == "look":
            return Outcome("table", {"color": COLORS[place % 2] + rng.normal(0, 50, 3)})
        if session.behavior == "reset":
            return Outcome("table")
        if rng.random() < 0.2:
            return Outcome("table")
        return Outcome("held", {"force": FORCES[[place // 2]] + rng.normal(0, 1.2, 1)})


def drive(session, table):
    while not session.over:
        if session.turn is not None:
            session.turned(table.turn_to(session))
        else:
            session.observe(table.execute(session))
    return session.search


def content(search):
    """Return all that a search decided and believed; names that are drawn aside."""
    trials = [
        (
            name,
            [(s.decision.action, s.x, s.next_x, s.belief.positive.tolist()) for s in trial.steps],
            [None if s.observation is None else s.observation.tolist() for s in trial.steps],
            trial.truth.tolist(),
            trial.ended,
        )
        for name, trial in search.trials.items()
    ]
    named = (search.question, search.turns, search.states, search.claim, search.ended)
    return trials, named, search.cost, search.none, search.turn_cost, search.success


def assert_read_back(folder, search):
    read = read_search(folder)
    assert content(read) == content(search)
    for name, trial in read.trials.items():
        assert trial.task == search.trials[name].task
        np.testing.assert_array_equal(trial.momdp.confusion, search.trials[name].momdp.confusion)
    explored = [trial for trial in search.trials.values() if trial.steps]
    assert len(list(read_trials(folder))) == len(explored)
    assert not list(folder.glob("*.active"))
    assert all(check_log(file).whole for file in folder.glob("*.mcap"))


OPTIONS = {
    "truth": {"a/b.search": {"red": True, "full": False}}, "turn_cost": 0.5, "none": -3.0,
    "max_steps": 9, "key": "k",
}  # fmt: skip


def bury(session):
    """Let go of what the process of a search held when it died."""
    for recorder in (session._recorder, *(each._recorder for each in session.sessions.values())):
        if recorder is not None:
            recorder._file.close()
            if recorder._resumed is not None:
                recorder._resumed.release()


def one_step(session, table):
    while session.turn is not None:
        session.turned(table.turn_to(session))
    session.observe(table.execute(session))


SEARCHING = SimpleNamespace(
    CUPS=CUPS, OPTIONS=OPTIONS, Table=Table, drive=drive, content=content, bury=bury,
    one_step=one_step, assert_read_back=assert_read_back,
)  # fmt: skip


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


@pytest.fixture(scope="session")
def searching():
    """A table of cups that are searched, and what drives, ends and compares such searches."""
    return SEARCHING


@pytest.fixture(scope="module")
def mind(dataset, make):
    return make.learner(dataset, "greedy")


@pytest.fixture(scope="module")
def undisturbed(mind):
    """The search that nothing disturbs, by the seed of its table."""
    searches = {}

    def of(seed):
        if seed not in searches:
            session = copy.deepcopy(mind).begin_find("red and not full", CUPS, **OPTIONS)
            searches[seed] = drive(session, Table(seed))
        return searches[seed]

    return of
