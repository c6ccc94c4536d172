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

from meal_bayes.datasets import load_percepts
from meal_bayes.errors import LogError, RobotError
from meal_bayes.learner import Learner, recall
from meal_bayes.trial_log import read_search
from meal_bayes.trial_log.searches import searches_in
from meal_bayes.trials import run_search


def begun_or_resumed(searching, learner, folder):
    """Return the session of the search of a folder; None where it is over."""
    try:
        return learner.resume_find(folder)
    except LogError as fault:
        if re.search("is over", str(fault)):
            return None
        if not re.search("begin it anew|holds no search|There is no search", str(fault)):
            raise
    return learner.begin_find("red and not full", searching.CUPS, log=folder, **searching.OPTIONS)


def lived(searching, mind, kills, folder, seed, deaths):
    """Search with so many writes before each death of a process, then to the end."""
    table = searching.Table(seed)
    lost = 0
    for death in (*deaths, -1):
        learner = copy.deepcopy(mind)  # as loaded from its file
        kills.left = death
        try:
            session = begun_or_resumed(searching, learner, folder)
            if session is None:
                return read_search(folder), None
            search = searching.drive(session, table)
        except kills.killed:
            lost += 1
        else:
            steps = sum(step.cost > 0 for trial in search.trials.values() for step in trial.steps)
            assert steps <= table.executed <= steps + lost  # one that a process died in
            searching.assert_read_back(folder, search)
            return search, learner
        finally:
            kills.bury()
    raise AssertionError


def test_a_search_killed_at_any_write_goes_on_as_if_undisturbed(
    searching, mind, undisturbed, kills, tmp_path
):
    expected = undisturbed(0)
    assert len(expected.turns) > 1
    resumed = 0
    for death in itertools.count():
        folder = tmp_path / str(death)
        search, learner = lived(searching, mind, kills, folder, 0, [death])
        assert searching.content(search) == searching.content(expected)
        if learner is None:  # it died with the answer written
            assert searching.content(read_search(folder)) == searching.content(expected)
            break
        resumed += 1
    assert resumed > 2 * sum(len(trial.steps) for trial in expected.trials.values())


@settings(max_examples=max(settings().max_examples // 10, 3), deadline=None)
@given(seed=st.integers(0, 5), deaths=st.lists(st.integers(0, 40), min_size=1, max_size=3))
@example(seed=0, deaths=[25, 12])  # in the middle of writing it again
@example(seed=0, deaths=[25, 9, 14])
def test_processes_that_die_one_after_another_lose_nothing(
    searching, mind, make, undisturbed, tmp_path_factory, seed, deaths
):
    folder = tmp_path_factory.mktemp("search") / "it"
    with pytest.MonkeyPatch.context() as patch:
        search, _ = lived(searching, mind, make.kills(patch), folder, seed, deaths)
    assert searching.content(search) == searching.content(undisturbed(seed))


def test_what_was_sensed_before_a_restart_is_learned_from(searching, mind, make, tmp_path):
    whole = copy.deepcopy(mind)
    first = copy.deepcopy(mind)
    table = searching.Table(1)
    undisturbed = searching.drive(
        whole.begin_find("red and not full", searching.CUPS, **searching.OPTIONS), table
    )
    session = first.begin_find(
        "red and not full", searching.CUPS, log=tmp_path / "it", **searching.OPTIONS
    )
    searching.one_step(session, table)
    searching.one_step(session, table)
    again = copy.deepcopy(mind)
    with pytest.raises(LogError, match="is under way in another process"):
        again.resume_find(tmp_path / "it")
    searching.bury(session)
    resumed = again.resume_find(tmp_path)  # the one in it
    with pytest.raises(LogError, match=r"under way|holds no search"):
        copy.deepcopy(mind).resume_find(tmp_path / "it")  # one process drives
    search = searching.drive(resumed, table)
    assert searching.content(search) == searching.content(undisturbed)
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
        self.session = session
        self.table = table
        self.found = found
        self.front = None

    def turn_to(self, name):
        self.front = name
        explored = self.session.sessions[name]
        return self.found or explored.momdp.x_names[explored.belief.x]

    def execute(self, behavior):
        assert (self.front, behavior) == (self.session.object, self.session.behavior)
        return self.table.execute(self.session)


def broken_off(searching, learner, folder, moves, table):
    """Search by so many turns and behaviors, and let the process die; None: it is over before."""
    session = learner.begin_find(
        "red and not full", searching.CUPS, log=folder, **searching.OPTIONS
    )
    for _ in range(moves):
        if session.turn is not None:
            session.turned(table.turn_to(session))
        else:
            session.observe(table.execute(session))
        if session.over:
            return None
    searching.bury(session)
    return session


def test_a_new_driver_is_told_the_object_in_front(searching, mind, undisturbed, tmp_path):
    """Neither logged nor charged: the search is as if nothing had disturbed it."""
    for moves in itertools.count():
        folder = tmp_path / str(moves)
        table = searching.Table(0)
        if broken_off(searching, copy.deepcopy(mind), folder, moves, table) is None:
            break
        session = copy.deepcopy(mind).resume_find(folder)
        search = run_search(session, Facing(session, table))
        assert searching.content(search) == searching.content(undisturbed(0))
        searching.assert_read_back(folder, search)
    assert moves > 5


def test_an_object_that_is_found_elsewhere_is_brought_back(searching, mind, undisturbed, tmp_path):
    table = searching.Table(0)
    broken_off(searching, copy.deepcopy(mind), tmp_path / "it", 1, table)
    session = copy.deepcopy(mind).resume_find(tmp_path / "it")
    assert session.behavior is not None
    for driver in (Facing(session, table, "held"), Facing(session, table, "shelf")):
        with pytest.raises(RobotError, match=r"but the search left it in .*; bring it back"):
            run_search(session, driver)
    assert not session.over
    assert searching.content(run_search(session, Facing(session, table))) == searching.content(
        undisturbed(0)
    )


def test_a_search_of_recorded_objects_goes_on(searching, tmp_path):
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
        searching.bury(session)
        again = learner()
        resumed = again.resume_find(folder)
        search = run_search(resumed, again.replays(resumed))
        assert searching.content(search) == searching.content(whole)
        searching.assert_read_back(folder, search)
    assert moves > 5


def found_again(folder):
    """Return the search of a folder with what was told of its objects since."""
    problems = []
    ((_, search),) = searches_in(folder, problems.append)
    assert problems == []
    return search


KILLED = """
import os, signal, sys
sys.path.insert(0, {here!r})
import conftest as make
searching = make.SEARCHING
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
def test_another_process_goes_on_where_one_was_killed(
    searching, mind, undisturbed, tmp_path, steps
):
    here = Path(__file__).parent
    environment = {**os.environ, "PYTHONPATH": str(here.parents[1])}
    code = KILLED.format(here=str(here))
    command = [sys.executable, "-c", code, str(steps), str(tmp_path / "it")]
    done = subprocess.run(command, env=environment, check=False)
    assert done.returncode == -signal.SIGKILL
    session = copy.deepcopy(mind).resume_find(tmp_path / "it")
    assert sum(len(each.steps) for each in session.sessions.values()) == steps
    assert searching.content(searching.drive(session, searching.Table(0))) == searching.content(
        undisturbed(0)
    )
    searching.assert_read_back(tmp_path / "it", session.search)
