"""Searches that were killed at any write of their logs, resumed, and read from their folder."""

import copy
import itertools
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meal_bayes.datasets import Dataset, load_percepts
from meal_bayes.errors import LogError, RobotError
from meal_bayes.learner import Learner, recall
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import check_log, read_search, read_trials
from meal_bayes.trial_log.searches import searches_in
from meal_bayes.trials import run_search

CUPS = ("mug", "a/b.search", "glass")
COLORS = np.array([[40.0, 60.0, 190.0], [200.0, 40.0, 40.0]])
FORCES = np.array([2.0, 5.5])


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


@pytest.fixture(scope="module")
def mind(dataset, make):
    return make.learner(dataset, "greedy")


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


def begun_or_resumed(learner, folder):
    """Return the session of the search of a folder; None where it is over."""
    try:
        return learner.resume_find(folder)
    except LogError as fault:
        if re.search("is over", str(fault)):
            return None
        if not re.search("begin it anew|holds no search|There is no search", str(fault)):
            raise
    return learner.begin_find("red and not full", CUPS, log=folder, **OPTIONS)


def lived(mind, kills, folder, seed, deaths):
    """Search with so many writes before each death of a process, then to the end."""
    table = Table(seed)
    lost = 0
    for death in (*deaths, -1):
        learner = copy.deepcopy(mind)  # as loaded from its file
        kills.left = death
        try:
            session = begun_or_resumed(learner, folder)
            if session is None:
                return read_search(folder), None
            search = drive(session, table)
        except kills.killed:
            lost += 1
        else:
            steps = sum(step.cost > 0 for trial in search.trials.values() for step in trial.steps)
            assert steps <= table.executed <= steps + lost  # one that a process died in
            assert_read_back(folder, search)
            return search, learner
        finally:
            kills.bury()
    raise AssertionError


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


def test_a_search_killed_at_any_write_goes_on_as_if_undisturbed(mind, undisturbed, kills, tmp_path):
    expected = undisturbed(0)
    assert len(expected.turns) > 1
    resumed = 0
    for death in itertools.count():
        folder = tmp_path / str(death)
        search, learner = lived(mind, kills, folder, 0, [death])
        assert content(search) == content(expected)
        if learner is None:  # it died with the answer written
            assert content(read_search(folder)) == content(expected)
            break
        resumed += 1
    assert resumed > 2 * sum(len(trial.steps) for trial in expected.trials.values())


@settings(max_examples=max(settings().max_examples // 10, 3), deadline=None)
@given(seed=st.integers(0, 5), deaths=st.lists(st.integers(0, 40), min_size=1, max_size=3))
@example(seed=0, deaths=[25, 12])  # in the middle of writing it again
@example(seed=0, deaths=[25, 9, 14])
def test_processes_that_die_one_after_another_lose_nothing(
    mind, make, undisturbed, tmp_path_factory, seed, deaths
):
    folder = tmp_path_factory.mktemp("search") / "it"
    with pytest.MonkeyPatch.context() as patch:
        search, _ = lived(mind, make.kills(patch), folder, seed, deaths)
    assert content(search) == content(undisturbed(seed))


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


def test_what_was_sensed_before_a_restart_is_learned_from(mind, make, tmp_path):
    whole, first = copy.deepcopy(mind), copy.deepcopy(mind)
    table = Table(1)
    undisturbed = drive(whole.begin_find("red and not full", CUPS, **OPTIONS), table)
    session = first.begin_find("red and not full", CUPS, log=tmp_path / "it", **OPTIONS)
    one_step(session, table)
    one_step(session, table)
    again = copy.deepcopy(mind)
    with pytest.raises(LogError, match="is under way in another process"):
        again.resume_find(tmp_path / "it")
    bury(session)
    resumed = again.resume_find(tmp_path)  # the one in it
    with pytest.raises(LogError, match=r"under way|holds no search"):
        copy.deepcopy(mind).resume_find(tmp_path / "it")  # one process drives
    search = drive(resumed, table)
    assert content(search) == content(undisturbed)
    recalled = copy.deepcopy(mind)
    assert len(recall(recalled, tmp_path)) == len([t for t in search.trials.values() if t.steps])
    for learner, found in ((whole, undisturbed), (again, search), (recalled, search)):
        for name in found.turns:
            learner.tell(found.trials[name], {"red": True, "full": False})
        learner.refit()
        counts = learner.knowledge().posterior.counts
        np.testing.assert_array_equal(counts, whole.knowledge().posterior.counts)
    told = found_again(tmp_path)
    assert all((told.trials[name].truth == [1, 0]).all() for name in search.turns)


class Facing:
    """A driver that knows the object in front by `turn_to` alone, as those of robots do."""

    def __init__(self, session, table, found=None):
        self.session, self.table, self.found = session, table, found
        self.front = None

    def turn_to(self, name):
        self.front = name
        explored = self.session.sessions[name]
        return self.found or explored.momdp.x_names[explored.belief.x]

    def execute(self, behavior):
        assert (self.front, behavior) == (self.session.object, self.session.behavior)
        return self.table.execute(self.session)


def broken_off(learner, folder, moves, table):
    """Search by so many turns and behaviors, and let the process die; None: it is over before."""
    session = learner.begin_find("red and not full", CUPS, log=folder, **OPTIONS)
    for _ in range(moves):
        if session.turn is not None:
            session.turned(table.turn_to(session))
        else:
            session.observe(table.execute(session))
        if session.over:
            return None
    bury(session)
    return session


def test_a_new_driver_is_told_the_object_in_front(mind, undisturbed, tmp_path):
    """Neither logged nor charged: the search is as if nothing had disturbed it."""
    for moves in itertools.count():
        folder = tmp_path / str(moves)
        table = Table(0)
        if broken_off(copy.deepcopy(mind), folder, moves, table) is None:
            break
        session = copy.deepcopy(mind).resume_find(folder)
        search = run_search(session, Facing(session, table))
        assert content(search) == content(undisturbed(0))
        assert_read_back(folder, search)
    assert moves > 5


def test_an_object_that_is_found_elsewhere_is_brought_back(mind, undisturbed, tmp_path):
    table = Table(0)
    broken_off(copy.deepcopy(mind), tmp_path / "it", 1, table)
    session = copy.deepcopy(mind).resume_find(tmp_path / "it")
    assert session.behavior is not None
    for driver in (Facing(session, table, "held"), Facing(session, table, "shelf")):
        with pytest.raises(RobotError, match=r"but the search left it in .*; bring it back"):
            run_search(session, driver)
    assert not session.over
    assert content(run_search(session, Facing(session, table))) == content(undisturbed(0))


def test_a_search_of_recorded_objects_goes_on(tmp_path):
    """Replays are where the search left them, with the failures and recordings to come."""
    boxes = ("light_blue_beans", "heavy_green_glass", "heavy_blue_beans")

    def learner():
        return Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))

    whole = learner().find("heavy and blue", boxes)
    for moves in itertools.count():
        folder = tmp_path / str(moves)
        first = learner()
        session = first.begin_find("heavy and blue", boxes, log=folder)
        robot = first.replays(session)
        for _ in range(moves):
            if session.turn is not None:
                session.turned(robot.turn_to(session.turn))
            elif session.behavior is not None:
                session.observe(robot.execute(session.behavior))
        if session.over:
            break
        bury(session)
        again = learner()
        resumed = again.resume_find(folder)
        search = run_search(resumed, again.replays(resumed))
        assert content(search) == content(whole)
        assert_read_back(folder, search)
    assert moves > 5


def found_again(folder):
    """Return the search of a folder with what was told of its objects since."""
    problems = []
    ((_, search),) = searches_in(folder, problems.append)
    assert problems == []
    return search


def test_a_learner_that_knows_other_things_goes_on_with_no_search(mind, make, dataset, tmp_path):
    session = copy.deepcopy(mind).begin_find("red", 2, log=tmp_path)
    one_step(session, Table(0))
    bury(session)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    labels = np.array([[i // 4 % 2, i // 2 % 2] for i in range(len(dataset.objects))], np.int8)
    blind = Dataset(dataset.domain, dataset.objects, dataset.features, labels)  # to what is red
    other = make.learner(blind, "greedy")
    with pytest.raises(LogError, match="learned other things since"):
        other.resume_find(tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    drive(copy.deepcopy(mind).resume_find(tmp_path), Table(0))


def test_a_second_search_never_mixes_with_a_first(mind, tmp_path):
    session = copy.deepcopy(mind).begin_find("red", CUPS, log=tmp_path / "it")
    trials = tmp_path / "trials"
    copy.deepcopy(mind).begin("red", "mug", log=trials / "a.mcap").cancel()
    for folder in (tmp_path / "it", trials):  # under way; of other trials
        learner = copy.deepcopy(mind)
        with pytest.raises(LogError, match=r"name another.*resume_find"):
            learner.begin_find("full", CUPS, log=folder)
        assert list(learner.experience.trials) == list(mind.experience.trials)
    drive(session, Table(0))
    with pytest.raises(LogError, match="name another"):
        copy.deepcopy(mind).begin_find("red", CUPS, log=tmp_path / "it")
    assert_read_back(tmp_path / "it", session.search)
    with pytest.raises(LogError, match="is over"):
        copy.deepcopy(mind).resume_find(tmp_path / "it")


def test_by_default_every_search_has_a_new_folder(dataset, make, tmp_path):
    learner = make.learner(dataset, "greedy", logs=tmp_path)
    sessions = [learner.begin_find("red", CUPS) for _ in range(2)]
    folders = sorted(path for path in (tmp_path / "kitchen").iterdir())
    assert len(folders) == 2
    for session in sessions:
        bury(session)
    with pytest.raises(LogError, match=r"2 searches that were broken off: red in .*resume_find"):
        learner.resume_find()
    with pytest.raises(LogError, match=r"no trial that was broken off.*resume_find\(\)"):
        learner.resume()
    drive(learner.resume_find(folders[0]), Table(0))
    drive(learner.resume_find(), Table(0))


KILLED = """
import os, signal, sys
sys.path.insert(0, {here!r})
import conftest as make
import test_find_resumed as searching
class Table(searching.Table):
    def execute(self, session):
        if self.executed == int(sys.argv[1]):
            os.kill(os.getpid(), signal.SIGKILL)
        return super().execute(session)
learner = make.make_learner(make.make_dataset(), "greedy")
options = dict(searching.OPTIONS, log=sys.argv[2])
searching.drive(learner.begin_find("red and not full", searching.CUPS, **options), Table(0))
"""


@pytest.mark.long
@pytest.mark.parametrize("steps", [0, 3])
def test_another_process_goes_on_where_one_was_killed(mind, undisturbed, tmp_path, steps):
    here = Path(__file__).parent
    environment = {**os.environ, "PYTHONPATH": str(here.parents[1])}
    code = KILLED.format(here=str(here))
    command = [sys.executable, "-c", code, str(steps), str(tmp_path / "it")]
    done = subprocess.run(command, env=environment, check=False)
    assert done.returncode == -signal.SIGKILL
    session = copy.deepcopy(mind).resume_find(tmp_path / "it")
    assert sum(len(each.steps) for each in session.sessions.values()) == steps
    assert content(drive(session, Table(0))) == content(undisturbed(0))
    assert_read_back(tmp_path / "it", session.search)
