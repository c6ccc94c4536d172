"""Sessions of a learner: their tasks and logs, models and policies, with a bonus or without.

Here Algorithm 1, l. 1-5, and Algorithm 2, l. 7-10, become code.
"""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import Agent, FittedITRSBonus, ITRSBonus, NoBonus
from meal_bayes.datasets import object_index
from meal_bayes.domain import Query, read_query
from meal_bayes.errors import LogError, SettingsError
from meal_bayes.files import file_name
from meal_bayes.learner.experience import Key
from meal_bayes.learner.fitted import Fitted, HeldOut
from meal_bayes.learner.percepts import Witness
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import Perceiver
from meal_bayes.planners import POMCP, Policy, Remembering
from meal_bayes.planners.pomcp.policy import POMCPPolicy
from meal_bayes.robots import Boundary
from meal_bayes.robots.recorded import RecordedRobot, replayable
from meal_bayes.seeds import stream
from meal_bayes.trial_log import TrialWriter, read_header, remove_drafts, salvage
from meal_bayes.trial_log.names import drafts_of, stem_of
from meal_bayes.trials import FaultTolerant, Session, Task, Trial

if TYPE_CHECKING:
    from meal_bayes.learner.learner import Learner

Question = str | Sequence[str] | Query | Task
NO_TABLE = "Give a robot, or fit a percept table (build_percept_table) to replay its objects."
NO_CLASSIFIERS = (
    "A percept table holds no classifiers for a robot's sensors; fit recordings (load_dataset), or "
    "name an object of the table."
)


class LiveLog(TrialWriter):
    """A log of one trial alone: open when it is made, closed when the trial ends.

    In a folder it is called such as logs/kitchen/20260131-142507-381904-blue_cup-a3f9c2.mcap, by
    the time (UTC) and the object's `name`; no other process or thread has this name.
    """

    def __init__(self, place: Path, header: Mapping[str, object], name: str = "") -> None:
        if place.suffix != ".mcap":
            begun = datetime.now(UTC).strftime("%Y%m%d-%H%M%S-%f")
            place /= f"{begun}-{file_name(name)}-{secrets.token_hex(3)}.mcap"
        super().__init__(place, header)
        self.__enter__()

    def end(self, trial: Trial) -> None:
        """Write the outcome, and give the whole log its name."""
        super().end(trial)
        self.__exit__(None, None, None)
        remove_drafts(self.path)  # of processes that were killed in this trial


def interrupted(log: Path) -> tuple[Trial, Path, dict[str, Any]]:
    """Return the trial that a killed process left in a log, the name of that, and its header."""
    draft = next((path for path in [log, *drafts_of(log)] if path.is_file()), log)
    header, trials = read_header(draft), list(salvage(draft))
    last = trials[-1] if trials else None
    if not isinstance(last, Trial) or not last.ended or not isinstance(header.get("begun"), dict):
        raise LogError(f"{draft} holds no trial that was broken off; there is nothing to resume.")
    return last, draft.with_name(stem_of(draft) + ".mcap"), header


def open_session(
    learner: "Learner", question: Question, object_name: str | None, *,
    key: str | int | None = None, log: str | Path | None = None, state: str | None = None,
    **options: Any,
) -> Session:  # fmt: skip
    """Return the session of a question, logged, but not started yet."""
    task, streams = task_of(learner, question, object_name, key)
    session = session_of(learner, task, streams, **options)
    record(learner, session, question, log, learn=options.get("learn", True), state=state)
    return session


def record(
    learner: "Learner", session: Session, question: Question, log: str | Path | None = None,
    **begun: Any,
) -> None:  # fmt: skip
    """Log a session, in the folder of logs by default, if there is one; with how it was begun."""
    if log is None and learner.logs is None:
        return
    place = Path(learner.logs or "") / file_name(learner.domain.name) if log is None else Path(log)
    config = {"command": "Learner.ask", "question": str(question), "agent": learner.agent.name}
    header = {
        "config": config, "seed": learner.seed, "data": learner.domain.data,
        "streams": list(session.key),
        "begun": {**begun, "max_steps": int(session.max_steps), "max_cost": session.max_cost},
    }  # fmt: skip
    session.record(LiveLog(place, header, session.task.object_name))


def task_of(
    learner: "Learner", question: Question, object_name: str | None, key: str | int | None = None
) -> tuple[Task, Key]:
    """Return the task of a question, and the key of its random streams.

    With a robot the task's own key has an identity that no other trial has, of whatever session,
    nor has an object without a name. What is drawn does not depend on it, but on `key`.
    """
    if isinstance(question, Task):
        return question, question.key
    for part, value in (("key", key), ("object_name", object_name)):
        if not isinstance(value, str | int | None if part == "key" else str | None):
            raise SettingsError(f"{part} is {value!r:.60}; give a text.")
    query = question if isinstance(question, Query) else read_query(question, learner.domain)
    text, data = f"{query.report_name([True] * len(query))}?", learner.domain.data
    if learner.table is not None:
        if object_name is None:
            raise SettingsError(NO_CLASSIFIERS)
        o = object_index(learner.table.objects, object_name)
        named = () if key is None else ("key", key)
        streams: Key = (learner.table.domain.data, "ask", object_name, *query.attributes, *named)
        return Task(text, query, o, object_name, streams), streams
    with learner.lock:
        number, learner.asked = learner.asked, learner.asked + 1
    key, identity = number if key is None else key, secrets.token_hex(8)
    name, drawn = (f"object {n}" if object_name is None else object_name for n in (identity, key))
    task = Task(text, query, -1, name, (data, "live", identity, *query.attributes))
    return task, (data, "live", key, drawn, *query.attributes)


def check_robot(learner: "Learner", robot: object) -> None:
    """Refuse what is no robot, and a robot where objects of a percept table are replayed."""
    if isinstance(robot, type) or not (robot is None or hasattr(robot, "execute")):
        raise SettingsError(
            f"A robot is an object with start() and execute(behavior); found {robot!r:.60}."
        )
    if (robot is None) == (learner.table is None):
        raise SettingsError(NO_TABLE if robot is None else NO_CLASSIFIERS)


def robot_of(learner: "Learner", task: Task, seed: int) -> RecordedRobot:
    """Return the robot that replays the object of a task; a seed names its draws."""
    table = learner.table
    assert table is not None
    return RecordedRobot(
        table.domain, task.object_index, replayable(table)[task.object_index],
        stream(seed, "recordings", *task.key), stream(seed, "robot", *task.key),
        repeats=learner.fits.settings.percepts == "model",
    )  # fmt: skip


def session_of(
    learner: "Learner", task: Task, key: Key, *, learn: bool = True,
    limit: ArrayLike = np.inf, **options: Any,
) -> Session:  # fmt: skip
    """Return the session of a task whose random streams `key` names; replays teach nothing."""
    learn = learn and learner.table is None
    with learner.lock:
        fit = fit_of(learner, task, learn=learn)
        momdp, policy = prepare(learner, fit, task, key, limit, explore=learn)
        if learn:
            learner.experience.trial(task.key)  # it is the learner's own from now on
    if task.object_index < 0:  # recordings run out, the sensors of a robot fail
        usual = learner.domain.diagram.compile(learner.domain.behavior_names).transition
        policy = FaultTolerant(momdp, policy, partial(_solve, learner, fit, task, key), usual)
    return commanded(
        learner, fit, task, momdp, policy=policy, learn=learn, seed=learner.seed, key=key, **options
    )


def commanded(
    learner: "Learner", fit: Fitted | HeldOut, task: Task, momdp: MOMDP, *,
    policy: Policy | None = None, learn: bool = False, **options: Any,
) -> Session:  # fmt: skip
    """Return the session of a problem that a policy, or somebody else, decides.

    Options are those of `Session`; the truth of a table's object is its labels by default.
    """
    domain, o = fit.knowledge.domain, task.object_index
    columns = domain.columns(task.query.attributes)
    if isinstance(options.get("truth"), Mapping):
        options["truth"] = domain.labels(options["truth"])[columns]
    if isinstance(fit, HeldOut):
        perceiver: Perceiver = fit.perceiver
        if options.get("truth") is None:
            options["truth"] = fit.table.labels[o, columns]
    else:
        perceiver = witness = Witness(learner, task, momdp, fit, options.get("on_step"))
        if learn:
            options |= {"on_step": witness.record, "on_end": witness.end}
    boundary = Boundary(domain, object_index=o, sizes=lambda: learner.experience.sizes)
    return Session(
        task, momdp, policy, boundary, perceiver, agent=learner.agent.name,
        counts=fit.knowledge.posterior.counts[columns], **options,
    )  # fmt: skip


def fit_of(learner: "Learner", task: Task, *, learn: bool) -> Fitted | HeldOut:
    """Return what is known for a trial, by who runs it: training trials may be another agent's."""
    agent = learner.agent
    if learn and agent.trained_by is not None:
        agent = replace(agent.trained_by, name=agent.name)
    if learner.table is None:
        return learner.fitted(agent)
    return learner.fits.held_out(learner.table, agent, task.object_index)


def prepare(
    learner: "Learner", fit: Fitted | HeldOut, task: Task, streams: Key, limit: ArrayLike = np.inf,
    *, explore: bool = False,
) -> tuple[MOMDP, Policy]:  # fmt: skip
    """Build and solve a query's MOMDP (Alg. 1, l. 1-5; Alg. 2, l. 7-10).

    `streams` names the planner's random stream, `limit` (E,) is how many percepts of each behavior
    a trial with a robot can have; to explore is to plan for queries to come as well.
    """
    query, agent, exploration = task.query, fit.agent, fit.agent.exploration
    labels = known_labels(learner, agent, task)
    limits = np.broadcast_to(np.minimum(limit, fit.limit), len(learner.domain.behaviors))
    model = partial(agent.model, query, fit.knowledge, limit=limits, reward=learner.reward)
    if isinstance(fit, HeldOut):
        momdp = model(labels=labels)
        return momdp, _solve(learner, fit, task, (task.object_name, *query.attributes), momdp)
    solve = partial(_solve, learner, fit, task, streams)
    progress = partial(fit.progress, learner.horizon * len(query) / len(learner.domain.attributes))
    key = query, limits.tobytes()
    if not explore or (isinstance(exploration, NoBonus) and labels is None):
        if labels is not None or key not in fit.answering:
            momdp = model(labels=labels)
            if fit.settings.shaped_answers and isinstance(exploration, ITRSBonus | FittedITRSBonus):
                momdp = exploration.shape(momdp, progress())
            policy = solve(momdp)
            if labels is not None or not getattr(policy, "deterministic", False):
                return momdp, policy
            fit.answering[key] = momdp, Remembering(policy)  # until the posterior moves
        return fit.answering[key]
    momdp = exploration.shape(model(labels=labels), progress(task.object_name))
    if not isinstance(agent.solver(fit.knowledge.domain, query), POMCP):
        return momdp, solve(momdp)
    if key not in fit.exploring:  # searches of equal queries share a plan library
        fit.exploring[key] = cast(POMCPPolicy, solve(exploration.shape(model(), progress())))
    return momdp, fit.exploring[key].sharing_plans(momdp)


def known_labels(learner: "Learner", agent: Agent, task: Task) -> NDArray[np.int8] | None:
    """Return the labels (N,) that people gave to a task's object, if it is recognized by any."""
    columns = learner.domain.columns(task.query.attributes)
    labels = learner.experience.labels_for([task.object_name])[0, columns]
    return labels if agent.memory and (labels >= 0).any() else None


def _solve(
    learner: "Learner", fit: Fitted | HeldOut, task: Task, streams: Key, momdp: MOMDP
) -> Policy:
    solver = fit.agent.solver(fit.knowledge.domain, task.query)
    if isinstance(solver, POMCP):
        solver = replace(solver, paid=fit.agent.exploration.paid)
    return solver.solve(momdp, stream(learner.seed, "solver", fit.agent.name, *streams))
