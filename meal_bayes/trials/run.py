"""A trial from its beginning to its answer, by a robot that can wait."""

from meal_bayes.arrays import check_kind
from meal_bayes.errors import SettingsError
from meal_bayes.robots import Robot
from meal_bayes.trials.session import Session
from meal_bayes.trials.trial import Trial


def run_trial(session: Session, robot: Robot) -> Trial:
    """Run a trial to its end: execute what the session names, until it answers.

    One that has begun goes on: the robot is where the session says, and is not started.

    An exception of robot, perceiver or policy, an interruption too, ends the trial: the recorder
    gets the trial so far, with `ended`, and the exception is raised again.

    Examples
    --------
    >>> import meal_bayes
    >>> class Still:
    ...     def start(self):
    ...         return "ready"
    ...     def execute(self, behavior):
    ...         return meal_bayes.Outcome("ready")
    >>> learner = meal_bayes.Learner("toy", agent="prior", logs=None)
    >>> session = learner.begin("Is it red?", "a cup")
    >>> trial = meal_bayes.run_trial(session, Still())
    >>> trial.agent
    'prior'
    """
    check_kind("session", session, Session)
    if not hasattr(robot, "execute"):
        raise SettingsError(f"robot is {robot!r:.60}; give one that has execute(behavior).")
    with session:
        if not session.begun:
            session.start(robot.start())
        while (behavior := session.behavior) is not None:
            session.observe(robot.execute(behavior))
    return session.trial
