"""Sessions of a learner: their models and policies, with a bonus for exploring, and without."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import FittedITRSBonus, ITRSBonus, NoBonus
from meal_bayes.domain import Domain, Query, read_query
from meal_bayes.errors import SettingsError
from meal_bayes.files import file_name
from meal_bayes.learner.experience import Key
from meal_bayes.learner.fitted import Fitted
from meal_bayes.learner.live_log import LiveLog, interrupted
from meal_bayes.learner.percepts import Witness
from meal_bayes.learner.tasks import Question, live_task, replay_task
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import SampledPercepts
from meal_bayes.planners import POMCP, Policy, Remembering, Solver
from meal_bayes.robots import Boundary
from meal_bayes.seeds import stream
from meal_bayes.trials import Environment, FaultTolerant, Session, Step, Streams, Task, Trial

if TYPE_CHECKING:
    from meal_bayes.learner.learner import Learner

Limit = NDArray[np.float64]  # (E,) percepts that a trial can have


def query_of(question: Question, domain: Domain) -> Query:
    """Return the query of a sentence, a comma list, attribute names, a query or a task."""
    if isinstance(question, Task):
        return question.query
    return question if isinstance(question, Query) else read_query(question, domain)


def header_of(learner: "Learner", question: Question) -> dict[str, Any]:
    """Return the header of a trial's log."""
    config = {"command": "Learner.ask", "question": str(question), "agent": learner.agent.name}
    return {"config": config, "seed": learner.seed, "data": learner.domain.data}


def open_session(
    learner: "Learner",
    question: Question,
    object_name: str | None,
    key: str | int | None,
    log: str | Path | None,
    **options: Any,
) -> Session:
    """Return the session of a question, logged, but not started yet."""
    if isinstance(question, Task):
        task, streams = question, question.key
    else:
        query = query_of(question, learner.domain)
        with learner.lock:
            number, learner.asked = learner.asked, learner.asked + 1
        task, streams = live_task(
            query, learner.domain, number if key is None else key, object_name
        )
    place = None if log is None else Path(log)
    if place is None and learner.logs is not None:
        place = learner.logs / file_name(learner.domain.name)
    if place is not None:
        header = {**header_of(learner, question), "streams": list(streams)}
        options["recorder"] = LiveLog(place, header, task.object_name)
    return _session(learner, task, streams, **options)


def replay(
    learner: "Learner",
    question: Question,
    object_name: str,
    key: str | int | None,
    log: str | Path | None,
    **options: Any,
) -> Trial:
    """Answer a question about an object of the percept table."""
    runner, query = learner.runner, query_of(question, learner.domain)
    task = replay_task(query, runner.table, object_name, key)
    recorder = None if log is None else LiveLog(Path(log), header_of(learner, question))
    return runner.run(task, recorder=recorder, **options)


def resume_session(learner: "Learner", log: Path) -> Session:
    """Return the session of a trial whose process ended in the middle of it."""
    before, streams, recorder = interrupted(log)
    session = _session(learner, before.task, streams, truth=before.truth)
    start = learner.domain.diagram.start
    session.start(before.momdp.x_names[before.steps[0].x] if before.steps else start)
    session.repeat(before.steps)
    session.record(recorder)
    return session


def _session(
    learner: "Learner",
    task: Task,
    streams: Key,
    *,
    learn: bool = True,
    truth: Mapping[str, bool] | ArrayLike | None = None,
    limit: ArrayLike = np.inf,
    on_step: Callable[[Step], None] | None = None,
    **options: Any,
) -> Session:
    """Return the session of a task, whose steps become experience if it learns."""
    if learner.table is not None:
        raise SettingsError(
            "A percept table holds no classifiers for a robot's sensors; fit recordings "
            "(load_dataset), or name an object of the table."
        )
    agent = learner.agent
    if learn and agent.trained_by is not None:
        agent = replace(agent.trained_by, name=agent.name)
    fit, domain, experience = learner.fitted(agent), learner.domain, learner.experience
    columns = domain.columns(task.query.attributes)
    limits = np.broadcast_to(np.asarray(limit, float), (len(domain.behaviors),))
    with learner.lock:
        if learn:
            experience.trial(task.key)
        momdp, policy = prepare(
            learner, fit, task.query, task.object_name, streams, limits, explore=learn
        )
    if task.object_index < 0:  # recordings run out, the sensors of a robot fail
        policy = FaultTolerant(
            momdp, _solves(fit, task.query, policy, momdp, learner.seed, streams)
        )
    drawn = None
    if fit.settings.drawn is not None:
        confusion, _ = fit.refitted.posterior.select(range(len(domain.attributes)), exact=True)
        drawn = SampledPercepts(domain, fit.settings.drawn, confusion)
    witness = Witness(experience, (task.key, task.object_name), fit.perception, drawn)

    def stepped(step: Step) -> None:
        if learn:
            with learner.lock:
                witness.record(session.trial, step)
        if on_step is not None:
            on_step(step)

    def ended(trial: Trial) -> None:
        with learner.lock:  # of an object that is recognized, labels are known
            learner.fits.update(experience.shown(trial.task.key))

    environment = Environment(
        Boundary(domain, object_index=task.object_index, sizes=experience.sizes),
        witness,
        Streams.of(learner.seed, streams, agent.name),
        truth,
        fit.knowledge.posterior.counts[columns],
    )
    session = Session(
        task, momdp, policy, environment, agent=agent.name, on_step=stepped,
        on_end=ended if learn else None, **options,
    )  # fmt: skip
    return session


def _solves(
    fit: Fitted, query: Query, policy: Policy, momdp: MOMDP, seed: int, streams: Key
) -> Callable[[MOMDP], Policy]:
    """Return what makes the policy of a problem: one that was made, and anew of another."""

    def solve(problem: MOMDP) -> Policy:
        if problem is momdp:
            return policy
        return _solver(fit, query).solve(problem, stream(seed, "solver", fit.agent.name, *streams))

    return solve


def prepare(
    learner: "Learner", fit: Fitted, query: Query, object_name: str, streams: Key, limit: Limit,
    *, explore: bool,
) -> tuple[MOMDP, Policy]:  # fmt: skip
    """Build and solve a query's MOMDP (Alg. 1, l. 1-5; Alg. 2, l. 7-10).

    Parameters
    ----------
    learner, fit : Learner, Fitted
        Who asks, and what is known.
    query, object_name : Query, str
        What is asked, of which object.
    streams : tuple
        Names the planner's random stream.
    limit : (E,) array
        Percepts of each behavior that the trial can have.
    explore : bool
        Plan for queries to come as well, and with the labels of an object that is recognized.
    """
    agent, rng = fit.agent, stream(learner.seed, "solver", fit.agent.name, *streams)
    solver = _solver(fit, query)
    if not explore or (isinstance(agent.exploration, NoBonus) and not agent.memory):
        return _answer(learner, fit, query, limit, solver, rng)
    labels = None
    if agent.memory and object_name in learner.experience.objects:
        columns = learner.domain.columns(query.attributes)
        known = learner.experience.known.values[learner.experience.objects[object_name]]
        labels = known[columns]
    plain = _model(learner, fit, query, limit, labels)
    momdp = _shaped(learner, fit, plain, object_name)
    if not isinstance(solver, POMCP):
        return momdp, solver.solve(momdp, rng)
    key = query.attributes, limit.tobytes()
    if key not in fit.exploring:  # searches of equal queries share a plan library
        new = _model(learner, fit, query, limit, None)
        fit.exploring[key] = solver.solve(_shaped(learner, fit, new, None), rng)
    return momdp, fit.exploring[key].sharing_plans(momdp)


def _answer(
    learner: "Learner", fit: Fitted, query: Query, limit: Limit, solver: Solver,
    rng: np.random.Generator,
) -> tuple[MOMDP, Policy]:  # fmt: skip
    """Return model and policy without a bonus; deterministic ones until the posterior moves."""
    key = query.attributes, limit.tobytes()
    if key in fit.answering:
        return fit.answering[key]
    momdp = _model(learner, fit, query, limit, None)
    if fit.settings.shaped_answers and isinstance(
        fit.agent.exploration, ITRSBonus | FittedITRSBonus
    ):
        momdp = _shaped(learner, fit, momdp, None)
    policy = solver.solve(momdp, rng)
    if not getattr(policy, "deterministic", False):
        return momdp, policy
    fit.answering[key] = momdp, Remembering(policy)
    return fit.answering[key]


def _solver(fit: Fitted, query: Query) -> Solver:
    solver = fit.agent.solver(fit.knowledge.domain, query)
    return replace(solver, paid=fit.agent.exploration.paid) if isinstance(solver, POMCP) else solver


def _model(
    learner: "Learner", fit: Fitted, query: Query, limit: Limit, labels: NDArray[np.int8] | None
) -> MOMDP:
    return fit.agent.model(
        query, fit.knowledge, limit=limit, reward=learner.reward, labels=labels,
        trust=learner.trust,
    )  # fmt: skip


def _shaped(learner: "Learner", fit: Fitted, momdp: MOMDP, object_name: str | None) -> MOMDP:
    """Add the exploration bonus; `object_name` None: of a new object."""
    queries = learner.horizon * len(momdp.query) / len(learner.domain.attributes)
    return fit.agent.exploration.shape(momdp, fit.progress(object_name, queries))
