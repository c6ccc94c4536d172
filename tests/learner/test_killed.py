"""A trial whose process was killed at any write of its log goes on; also one that had answered."""

import pytest

from meal_bayes import Learner, Outcome, load_domain
from meal_bayes.errors import LogError
from meal_bayes.learner import recall
from meal_bayes.trial_log import Logs, check_log

PLAN = ("look", "look")
QUESTIONS = {
    "values": {"question": "red"},
    "yes or no": {"question": "not red", "answer": "yes or no", "payoffs": (9, -9, 5, -70)},
    "test": {"question": "red", "learn": False},
}


def domain_of(make, states):
    """Return the kitchen, or one where the robot is always in one place."""
    if states == 2:
        return load_domain(make.kitchen)
    effects = [{"from": "table", "do": "look", "to": "table"}]
    diagram = {"states": ["table"], "start": "table", "effects": effects}
    behaviors = make.kitchen["behaviors"][:1]
    return load_domain({**make.kitchen, "diagram": diagram, "behaviors": behaviors})


def drive(session):
    """Show what depends on the number of the step alone."""
    while session.behavior is not None:
        session.observe(Outcome("table", {"color": [60.0 * len(session.steps), 40.0, 90.0]}))
    return session.trial


def decided(trial):
    """Return all that a trial decided and believed; names that are drawn aside."""
    steps = [(s.decision.action, s.x, s.next_x, s.cost, s.warning) for s in trial.steps]
    beliefs = [step.belief.positive.tolist() for step in trial.steps]
    return steps, beliefs, trial.answer, trial.ended, trial.cost


@pytest.mark.quick(3)
@pytest.mark.parametrize("states", [1, 2])
@pytest.mark.parametrize("asked", QUESTIONS)
def test_a_trial_killed_at_any_write_goes_on_as_if_undisturbed(
    make, kills, tmp_path, states, asked
):
    agent = make.agent(*PLAN, **make.ours)
    domain = domain_of(make, states)
    whole = Learner(domain, agent=agent, logs=None)
    expected = drive(whole.begin(**QUESTIONS[asked]))
    begun = over = 0
    for death in range(99):
        folder = tmp_path / str(death)
        kills.left = death
        try:
            drive(Learner(domain, agent=agent, logs=folder).begin(**QUESTIONS[asked]))
        except kills.killed:
            kills.bury()
        else:
            kills.bury()
            break
        learner = Learner(domain, agent=agent, logs=folder)
        try:
            session = learner.resume(state="table" if death % 2 or states == 2 else None)
        except LogError:
            over += bool(begun)  # only what had not begun is lost
            if not over:
                continue
            if expected.task.learn:
                assert len(recall(learner, folder)) == 1
        else:
            begun += 1
            assert decided(drive(session)) == decided(expected)
            (log,) = folder.rglob("*.mcap*")
            assert check_log(log).whole
        assert len(learner.experience.executions) == len(whole.experience.executions)
        (trial,) = Logs(folder).trials()
        assert decided(trial) == decided(expected)
    assert begun == len(PLAN) + 2  # from each step, and from the answer
    assert over > 0
