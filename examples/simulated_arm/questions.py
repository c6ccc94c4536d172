"""Questions about objects that the arm in physics meets, through the public `Learner` alone."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from meal_bayes import Learner, Query, RobotError, Trial, run_trial
from simulated_arm.arm import SimulatedArm
from simulated_arm.objects import attributes_of, draw_object
from simulated_arm.physics import OnFrame
from simulated_arm.streams import stream


def ask_new(
    learner: Learner,
    question: str | Query,
    seed: int,
    number: int = 0,
    *,
    population: str = "new",
    on_frame: OnFrame | None = None,
    log: Path | None = None,
    learn: bool = False,
) -> Trial:
    """Ask a learner about an object of which nothing is recorded; by default in a test.

    Where the robot fails, the trial goes as far as it went, and says why it `ended`.
    """
    parameters = draw_object(seed, population, number)
    arm = SimulatedArm(parameters, seed, population, number, on_frame=on_frame)
    session = learner.begin(
        question,
        f"{population} {seed}-{number}",
        state=arm.start(),
        truth=attributes_of(parameters),
        log=log,
        learn=learn,
    )
    with contextlib.suppress(RobotError):
        run_trial(session, arm)
    return session.trial


def learn_live(
    learner: Learner, trials: int, seed: int, *, logs: Path | None = None
) -> Iterator[Trial]:
    """Answer questions about one new object after another, and learn from each.

    It is asked one random attribute of each new object; after its answer a person says all that is
    true of it. Objects are numbered from 1.
    """
    for number in range(1, trials + 1):
        rng = stream(seed, "simulated questions", number)
        query = Query((str(rng.choice(learner.domain.attributes)),))
        log = None if logs is None else logs / f"{number:05d}.mcap"
        trial = ask_new(learner, query, seed, number, population="live", log=log, learn=True)
        if not trial.ended:
            learner.tell(trial, attributes_of(draw_object(seed, "live", number)))
        yield trial
