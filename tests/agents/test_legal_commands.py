"""No named agent ever commands what is not legal, whether its percepts tell much or nothing."""

import numpy as np
import pytest

from meal_bayes.agents import AGENTS
from meal_bayes.datasets import make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.errors import RobotError
from meal_bayes.learner import Learner
from meal_bayes.robots import RecordedRobot


@pytest.fixture
def refusing(monkeypatch):
    """Recorded robots raise at a behavior that their diagram does not list where they are."""
    start, execute = RecordedRobot.start, RecordedRobot.execute

    def begin(robot):
        robot.state = start(robot)
        return robot.state

    def checked(robot, behavior):
        if behavior not in robot._domain.diagram.successes(robot.state):
            raise RobotError(f"{behavior!r} is not possible in {robot.state!r}.")
        outcome = execute(robot, behavior)
        robot.state = outcome.state
        return outcome

    monkeypatch.setattr(RecordedRobot, "start", begin)
    monkeypatch.setattr(RecordedRobot, "execute", checked)


@pytest.mark.parametrize("name", AGENTS)
def test_nor_is_it_while_learning(refusing, name):
    rng, toy = np.random.default_rng(0), load_domain("toy")
    dataset = make_synthetic(toy, objects=8, recordings=2, signal=1.0, rng=rng)
    learner = Learner(toy, agent=name, logs=None, refit_every=4)
    for number in range(6):  # from nothing, and with recordings
        if number == 3:
            learner.fit(dataset)
        robot = RecordedRobot(toy, number, 2, *rng.spawn(2), dataset)
        trial = learner.ask(("red", "heavy")[: 1 + number % 2], robot)
        assert trial.last_belief.x == trial.momdp.terminal
        learner.tell(trial, dict(zip(toy.attributes, dataset.labels[number] == 1, strict=True)))


@pytest.mark.parametrize("trials", [6, pytest.param(200, marks=pytest.mark.long)])
@pytest.mark.parametrize("signal", [0.0, 2.0])
@pytest.mark.parametrize("name", AGENTS)
def test_nothing_illegal_is_commanded(make, refusing, name, signal, trials):
    table = make.table("ispy32", signal=signal)
    learner = make.learner(table, name)
    for index in range(trials):
        n = 1 + 2 * (index % 2)
        task = make.task(table, index // 2 % 8, *table.domain.attributes[index // 16 :][:n])
        trial = learner.ask(task)
        assert trial.last_belief.x == trial.momdp.terminal
