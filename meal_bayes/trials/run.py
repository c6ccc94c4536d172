"""A trial, or a search, from its beginning to its answer, by a robot that can wait."""

from meal_bayes.arrays import check_kind
from meal_bayes.errors import RobotError, SettingsError
from meal_bayes.robots import Robot
from meal_bayes.trials.search import Search, SearchingRobot
from meal_bayes.trials.search_session import SearchSession
from meal_bayes.trials.session import Session
from meal_bayes.trials.trial import Trial


def run_trial(session: Session, robot: Robot) -> Trial:
    """Run a trial to its end: execute what the session names, until it answers.

    One that has begun goes on: the robot is where the session says, and is not started.

    An exception of robot, perceiver or policy, an interruption too, ends the trial: the recorder
    gets the trial so far, with `ended`, and the exception is raised again.
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


def run_search(session: SearchSession, robot: SearchingRobot) -> Search:
    """Run a search to its end: turn, and execute what the session names, until it answers.

    An exception of robot or perceiver ends the search and its trials, and is raised again. One that
    has begun goes on: a robot is turned to the object in front first, which is neither logged nor
    charged, as it is no other object; until then nothing that goes wrong ends the search.

    Raises
    ------
    RobotError
        The object in front is in another state than the search says.
    """
    if session.object is not None and session.turn is None and not session.over:
        _face(session.object, session.sessions[session.object], robot)
    with session:
        while not session.over:
            if session.turn is not None:
                session.turned(robot.turn_to(session.turn))
            elif session.behavior is not None:
                session.observe(robot.execute(session.behavior))
    return session.search


def _face(name: str, explored: Session, robot: SearchingRobot) -> None:
    """Tell a robot which object is in front: in a new process nobody has."""
    expected = explored.momdp.x_names[explored.belief.x]
    state = robot.turn_to(name)
    if state != expected:
        raise RobotError(
            f"turn_to({name!r}) found {state!r}, but the search left it in {expected!r}; bring it "
            "back to that, and run the search again. Robots that replay recordings are brought "
            "there by Learner.replays(session)."
        )
