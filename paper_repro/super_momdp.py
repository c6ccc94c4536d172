"""Fig. 9's "super" MOMDP: relevant attributes, which are asked, and irrelevant ones beside them.

All of them are in the state and are perceived; a report names the relevant ones alone. A flat
solver's states double with every attribute. In a factored model an irrelevant attribute is one
more marginal to update, and no decision looks at it.
"""

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from frame import Estimate, Setting
from numpy.typing import NDArray

import meal_bayes
from meal_bayes.agents import OfflineRunner, Streams, Task, load_agent, run_trial
from meal_bayes.datasets import Instance, PerceptTable
from meal_bayes.domain import Query
from meal_bayes.evaluation import clustered_se
from meal_bayes.experiments import offline_tasks
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.experiments.store import Store
from meal_bayes.files import write_whole
from meal_bayes.momdp import MOMDP, Belief, FlatPOMDP, percept_probabilities
from meal_bayes.perception import Perceiver, recorded_percepts, sampled_percepts
from meal_bayes.planners import PBVI, AlphaVectors, Decision, Factored, History, Policy, unvalued
from meal_bayes.robots import CheckedRobot, RecordedRobot
from meal_bayes.seeds import stream

UNIT = 10  # trials that are kept together
ASKED = 2  # relevant attributes, the first ones of a super query


@dataclass(frozen=True, slots=True)
class Super:
    """A task whose query goes on with irrelevant attributes, and its MOMDP."""

    task: Task
    asked: MOMDP  # of the relevant attributes alone
    whole: MOMDP

    @property
    def n_states(self) -> int:
        """States of a flat model."""
        return self.whole.n_states

    def narrow(self, belief: Belief) -> Belief:
        """Take the relevant part of a belief."""
        return Belief(
            belief.x, belief.weight[:ASKED], belief.seen[:ASKED], belief.log_share[:ASKED]
        )

    def report(self, belief: Belief, asked: NDArray[np.bool_]) -> int:
        """Give the action that reports values of the relevant attributes."""
        values = np.concatenate([asked, belief.best_report[ASKED:]])
        return self.whole.n_behaviors + self.whole.query.index_of(values)


def super_momdp(table: PerceptTable, morc: OfflineRunner, task: Task, irrelevant: int) -> Super:
    """Add irrelevant attributes to a task, drawn from all others in seeded order.

    A person who is asked answers for the relevant attributes, and tells nothing of the others.
    """
    asked, _ = morc.prepare(task)
    others = [name for name in table.domain.attributes if name not in task.query.attributes]
    drawn = stream(morc.seed, "irrelevant", *task.key).permutation(len(others))[:irrelevant]
    query = Query((*task.query.attributes, *(others[i] for i in drawn)))
    columns = [table.domain.attribute_index(name) for name in query.attributes]
    confusion, precision = morc.knowledge(task.object_index).posterior.select(columns, exact=True)
    whole = meal_bayes.build_momdp(
        table.domain, query, confusion, precision, limit=asked.limit, abstain=True
    )
    rows = whole.confusion.copy()
    for e, behavior in enumerate(table.domain.behaviors):
        if behavior.answer_accuracy is not None:
            rows[:ASKED, e], rows[ASKED:, e] = asked.confusion[:, e], 0.5
    return Super(replace(task, query=query), asked, replace(whole, confusion=rows))


@dataclass(frozen=True, slots=True)
class SuperPerceiver:
    """Perceives all attributes; a person answers for the relevant ones only."""

    source: Perceiver
    answering: frozenset[str]  # behaviors

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Give percept levels of all attributes; a coin's where nobody is asked."""
        asked, rest = query.attributes[:ASKED], query.attributes[ASKED:]
        levels = self.source.observe(instance, Query(asked), rng)
        if not rest:
            return levels
        aside = rng.spawn(1)[0]  # the relevant percepts are the same with any number of others
        if instance.behavior in self.answering:
            others = aside.integers(2, size=len(rest)).astype(np.int8)
        else:
            others = self.source.observe(instance, Query(rest), aside)
        return np.concatenate([levels, others])


@dataclass(frozen=True, slots=True)
class FactoredPolicy:
    """Plans on the relevant factors of the belief, all of which are updated."""

    problem: Super
    policy: Policy

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Decide as if the irrelevant attributes were not there: they change nothing."""
        belief, asked = history.belief, self.problem.asked
        decision = self.policy.decide(replace(history, belief=self.problem.narrow(belief)), rng)
        if decision.action < asked.n_behaviors:
            return decision
        values = asked.query.values_of(decision.action - asked.n_behaviors)
        return replace(decision, action=self.problem.report(belief, values))


@dataclass(frozen=True, slots=True)
class FlatPolicy:
    """Follows alpha vectors over all states of the super MOMDP."""

    problem: Super
    alpha: AlphaVectors

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Take the first action of the best plan."""
        belief, whole, asked = history.belief, self.problem.whole, self.problem.asked
        flat = np.zeros(self.problem.n_states)
        n_y = 2 ** len(whole.query)
        flat[belief.x * n_y : (belief.x + 1) * n_y] = belief.joint
        action = self.alpha.best_action(flat)
        if action >= whole.n_behaviors:
            values = asked.query.values_of(action - whole.n_behaviors)
            action = self.problem.report(belief, values)
        return unvalued(whole, action)


def flat_pomdp(problem: Super) -> FlatPOMDP:
    """Write the super MOMDP out over all its states, with reports of the relevant attributes."""
    momdp, asked = problem.whole, problem.asked
    n_e, n_y, end = momdp.n_behaviors, 2 ** len(momdp.query), momdp.terminal
    n_s, n_a, n_z = problem.n_states, n_e + 2**ASKED, momdp.levels ** len(momdp.query) + 1
    transition = np.zeros((n_a, n_s, n_s))
    observation = np.zeros((n_a, n_s, n_s, n_z))
    reward = np.zeros((n_s, n_a))
    transition[:, :, -1] = 1.0  # reports, and term itself
    observation[..., -1] = 1.0
    for e in range(n_e):
        transition[e, :-1, :-1] = np.kron(momdp.transition[e, :end, :end], np.eye(n_y))
        transition[e, :-1, -1] = np.repeat(momdp.transition[e, :end, end], n_y)
        percepts, comes = percept_probabilities(momdp, e), momdp.informative[e, :end, :end]
        blocks = observation[e, :-1, :-1].reshape(end, n_y, end, n_y, n_z)
        for y in range(n_y):
            blocks[:, y, :, y, :-1] = comes[..., None] * percepts[y]
            blocks[:, y, :, y, -1] = 1.0 - comes
        observation[e, :-1, :-1] = blocks.reshape(n_s - 1, n_s - 1, n_z)
        reward[:-1, e] = -momdp.cost[e]
    truth = np.tile(momdp.query.values[:, :ASKED], (end, 1))
    for y, values in enumerate(asked.query.values):
        reward[:-1, n_e + y] = momdp.report_reward((truth == values).astype(float))
    start = np.zeros(n_s)
    start[momdp.start * n_y : (momdp.start + 1) * n_y] = 1 / n_y  # uniform, as the paper's
    return FlatPOMDP(
        state_names=tuple(map(str, range(n_s))),
        action_names=tuple(map(str, range(n_a))),
        observation_names=tuple(map(str, range(n_z))),
        transition=transition,
        observation=observation,
        reward=reward,
        start=start,
        discount=momdp.discount,
    )


@dataclass(frozen=True, slots=True)
class Point:
    """One point of the curve: trials of one planner with so many irrelevant attributes."""

    planner: str  # "factored" or "flat"
    protocol: str
    irrelevant: int
    trials: int
    seconds: float  # a query, of the flat solver


Points = Mapping[tuple[str, int], list[dict[str, float]]]  # trials by curve and number


def run_points(points: Mapping[tuple[str, int], Point], setting: Setting) -> Points:
    """Run the trials of all points, or take them from the logs; points with more states first."""
    work = [
        _Unit(key, point, first, setting.seed, setting.logs)
        for key, point in points.items()
        for first in range(0, point.trials, UNIT)
    ]
    work.sort(key=lambda unit: (unit.point.planner != "flat", -unit.point.irrelevant))
    total = sum(point.trials for point in points.values())
    done: dict[tuple[str, int], dict[int, list[dict[str, float]]]] = {key: {} for key in points}
    for unit, trials in in_parallel(_run_or_read, work, jobs=setting.jobs):
        done[unit.key][unit.first] = trials
        if setting.on_progress is not None:
            setting.on_progress(sum(len(t) for u in done.values() for t in u.values()), total)
    return {key: [t for first in sorted(u) for t in u[first]] for key, u in done.items()}


def mean(trials: Sequence[Mapping[str, float]], measure: str) -> Estimate:
    """Estimate a measure of a point; objects are clusters."""
    values, clusters = ([trial[name] for trial in trials] for name in (measure, "object"))
    return Estimate(float(np.mean(values)), clustered_se(values, clusters))


def timing(found: Points) -> str:
    """Tell what planning and deciding a trial takes."""
    told = [
        f"{kind} {np.mean([trial['planning_s'] + trial['trial_s'] for trial in trials]):.2f} at {k}"
        for (kind, k), trials in found.items()
    ]
    return "Seconds of planning and deciding a trial: " + ", ".join(told) + "."


class _Unit(NamedTuple):
    key: tuple[str, int]
    point: Point
    first: int  # trial
    seed: int
    logs: Path


def _run_or_read(unit: _Unit) -> tuple[_Unit, list[dict[str, float]]]:
    point = unit.point
    config = {"point": repr(point), "seed": unit.seed, "script": _digest()}
    store = Store.of(unit.logs, f"fig9-{point.planner}-{point.irrelevant}", config)
    path = store.folder / f"trials-{unit.first:04d}.json"
    if not path.is_file():
        write_whole(path, json.dumps(_run(point, unit.first, unit.seed)))
    return unit, json.loads(path.read_text(encoding="utf-8"))


def _run(point: Point, first: int, seed: int) -> list[dict[str, float]]:
    table = meal_bayes.load_percepts("ispy32")
    morc = OfflineRunner(table, load_agent("morc"), seed, _PERCEPTS[point.protocol])
    solve: Mapping[str, Callable[..., Policy]] = {"factored": _factored, "flat": _flat}
    rows = []
    for task in offline_tasks(table, ASKED, point.trials, seed)[first : first + UNIT]:
        problem = super_momdp(table, morc, task, point.irrelevant)
        begin = time.perf_counter()
        policy = solve[point.planner](problem, point.seconds, stream(seed, "solver", *task.key))
        planned = time.perf_counter()
        rows.append(_trial(problem, policy, table, morc, point.protocol))
        rows[-1]["planning_s"] = planned - begin
        rows[-1]["trial_s"] = time.perf_counter() - planned
    return rows


def _trial(
    problem: Super, policy: Policy, table: PerceptTable, morc: OfflineRunner, protocol: str
) -> dict[str, float]:
    task, domain, seed = problem.task, table.domain, morc.seed
    columns = [domain.attribute_index(name) for name in task.query.attributes]
    source: Perceiver = recorded_percepts(table)
    if protocol == "published":
        posterior = morc.knowledge(task.object_index).posterior
        every, _ = posterior.select(range(len(domain.attributes)), exact=True)
        source = sampled_percepts(domain, table.labels, every)
    answering = frozenset(b.name for b in domain.behaviors if b.answer_accuracy is not None)
    robot = RecordedRobot(
        domain, task.object_index, table.recordings, stream(seed, "recordings", *task.key),
        stream(seed, "robot", *task.key), repeats=protocol == "published",
    )  # fmt: skip
    trial = run_trial(
        task, problem.whole, policy, CheckedRobot(robot, domain, object_index=task.object_index),
        SuperPerceiver(source, answering), Streams.of(seed, task, "morc"),
        truth=table.labels[task.object_index, columns] == 1,
    )  # fmt: skip
    asked = problem.asked
    right, paid = False, 0.0
    if trial.report is not None:
        right = bool((trial.report[:ASKED] == trial.truth[:ASKED]).all())
        paid = asked.correct if right else asked.incorrect
    return {
        "object": task.object_index,
        "success": float(right),
        "cost": trial.cost,
        "reward": paid - trial.cost,
        "states": float(problem.n_states),
    }


def _factored(problem: Super, seconds: float, rng: np.random.Generator) -> Policy:
    return FactoredPolicy(problem, Factored().solve(problem.asked, rng))


def _flat(problem: Super, seconds: float, rng: np.random.Generator) -> Policy:
    return FlatPolicy(problem, PBVI(seconds=seconds).solve_flat(flat_pomdp(problem), rng))


_PERCEPTS = {"published": "model", "recorded": "recorded"}


def _digest() -> str:
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
