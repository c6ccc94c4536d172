"""A sensor that is dead, or a motion that never works, costs two executions and a warning."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from meal_bayes.agents import load_agent
from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import Objective, build_momdp, initial_belief
from meal_bayes.planners import History
from meal_bayes.robots import Outcome, OutcomeChecker
from meal_bayes.trials import FaultTolerant, Session, Task, run_trial
from meal_bayes.trials.faults import CHANCE, faults_of

DOMAIN = load_domain("ispy32")
USUAL = DOMAIN.diagram.compile(DOMAIN.behavior_names)


class Faulty:
    """Moves as the diagram says, without failures; of one behavior the sensor or motion is dead."""

    def __init__(self, behavior, *, moves):
        self.behavior = behavior
        self.moves = moves
        self.executed = []

    def start(self):
        self.state = DOMAIN.diagram.start
        return self.state

    def execute(self, behavior):
        self.executed.append(behavior)
        dead = behavior == self.behavior
        if self.moves or not dead:
            self.state = DOMAIN.diagram.successes(self.state)[behavior]
        senses = DOMAIN.behaviors[DOMAIN.behavior_index(behavior)].senses
        return Outcome(self.state, recording=None if dead or not senses else 0)


class Undecided:
    """Percepts that say true and false in turn."""

    def __init__(self):
        self.count = 0

    def observe(self, instance, query, rng):
        self.count += 1
        return np.full(len(query), self.count % 2, np.int8)


def trial_of(name, robot, momdp):
    agent = load_agent(name)
    task = Task("a task", momdp.query, 0, "object", ("test",))

    def solve(problem):
        return agent.solver(DOMAIN, momdp.query).solve(problem, np.random.default_rng(0))

    policy = FaultTolerant(momdp, solve(momdp), solve, USUAL)
    checker = OutcomeChecker(DOMAIN)
    session = Session(
        task, momdp, policy, checker, Undecided(), agent=name, truth=[True], max_steps=40
    )
    return run_trial(session, robot)


def momdp_of(behavior):
    """A problem of one attribute of which this behavior tells most."""
    rows = np.tile([[0.6, 0.4], [0.4, 0.6]], (1, len(DOMAIN.behaviors), 1, 1))
    rows[:, DOMAIN.behavior_index(behavior)] = [[0.95, 0.05], [0.05, 0.95]]
    goal = Objective(discount=1.0, abstain=True)
    return build_momdp(DOMAIN, Query(DOMAIN.attributes[:1]), rows, objective=goal)


@pytest.mark.quick(8)
@pytest.mark.parametrize("moves", [True, False])
@pytest.mark.parametrize("behavior", ["look", "press"])
@pytest.mark.parametrize("name", ["random_legal", "predefined_plus", "greedy", "morc", "bayes"])
def test_nothing_is_repeated_that_yields_nothing(name, behavior, moves):
    robot = Faulty(behavior, moves=moves)
    momdp = momdp_of(behavior)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        trial = trial_of(name, robot, momdp)
    leads_on = behavior == "look" and moves  # whoever draws at random may still go by it
    if not (leads_on and name == "random_legal"):
        assert robot.executed.count(behavior) <= 2
    texts = [str(warning.message) for warning in caught]
    assert len(texts) == (robot.executed.count(behavior) >= 2)
    assert all(repr(behavior) in text for text in texts)
    assert trial.last_belief.x == momdp.terminal


def test_what_only_moves_is_warned_of_as_moving_nothing():
    momdp = momdp_of("look")
    solver = load_agent("random_legal").solver(DOMAIN, momdp.query)
    solve = partial(solver.solve, rng=np.random.default_rng(0))
    policy = FaultTolerant(momdp, solve(momdp), solve, USUAL)
    history = History(initial_belief(momdp))
    for behavior, state in (("look", "x1"), ("push", "x5")):
        there = history.belief.at(DOMAIN.diagram.states.index(state))
        history = history.after(there, DOMAIN.behavior_index(behavior), True, 1.0)
    reinit = DOMAIN.behavior_index("reinit")
    for _ in range(2):  # the object does not come back
        history = history.after(history.belief, reinit, False, 1.0)
    with pytest.warns(UserWarning, match="'reinit' moved nothing several times") as caught:
        policy.decide(history, np.random.default_rng(0))
    assert not any("yielded nothing" in str(warning.message) for warning in caught)


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("behavior", DOMAIN.behavior_names)
def test_a_behavior_whose_recordings_are_used_up_is_one_that_moves_alone(behavior, moves):
    """It fails where it does not move though it should, and not where it moves, or never did."""
    e = DOMAIN.behavior_index(behavior)
    back = DOMAIN.behavior_index("look" if behavior == "ask" else "ask")
    momdp = replace(momdp_of("look"), limit=np.ones(len(DOMAIN.behaviors)))
    for x in np.flatnonzero(momdp.legal[:, e]).tolist():
        after = int(USUAL.transition[e, x].argmax()) if moves else x
        history = History(initial_belief(momdp))
        history = history.after(history.belief.at(x), e, True, 1.0)
        for _ in range(3):
            history = history.after(history.belief.at(after), e, False, 1.0)
            history = history.after(history.belief.at(x), back, True, 1.0)
        failing, stuck = faults_of(momdp, history, USUAL)
        unlikely = USUAL.transition[e, x, x] ** 3 <= CHANCE
        assert failing[e] == stuck[e] == (after == x and unlikely)


def test_failures_that_chance_explains_are_repeated():
    """Shakes of the published diagram are perceived once in twenty times."""
    domain = load_domain("roc36_published")
    rows = np.tile([[0.8, 0.2], [0.2, 0.8]], (1, len(domain.behaviors), 1, 1))
    momdp = build_momdp(domain, Query(domain.attributes[:1]), rows)
    usual = domain.diagram.compile(domain.behavior_names)
    history = History(initial_belief(momdp))
    shake = domain.behavior_index("shake")
    for _ in range(10):
        history = history.after(history.belief.at(4), shake, False, 1.0)
    failing, _ = faults_of(momdp, history, usual)
    assert not failing.any()
    # What cannot be read says nothing of chance: two are enough.
    for _ in range(2):
        history = history.after(history.belief, shake, False, 1.0, unread=True)
    failing, _ = faults_of(momdp, history, usual)
    assert np.flatnonzero(failing).tolist() == [shake]


def test_failures_that_were_learned_explain_no_more_of_them():
    momdp = momdp_of("look")
    history = History(initial_belief(momdp))
    look = DOMAIN.behavior_index("look")
    for _ in range(2):
        history = history.after(history.belief, look, False, 1.0)
    learned = replace(momdp, observation_probability=momdp.observation_probability * 0.05)
    failing, _ = faults_of(learned, history, USUAL)
    assert np.flatnonzero(failing).tolist() == [look]
