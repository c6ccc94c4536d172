"""What a joint prior earns on questions about coupled attributes: paired, by `bayes`.

python benchmarks/coupled.py [--dataset NAME ...] [--trials N --attributes N] [--json]

Of every pair of attributes that runs ask and the labels couple, each object is asked for both
values: by `bayes`, by `bayes` with independent attributes, and by the latter with open-loop plans
alone, which tells what the prior changes from what the planner does. Recordings and failures are
paired. Rewards, what `bayes` gains, accuracy of both values, seconds; standard errors by object.
With --trials, the questions are those of so many trials of `run offline` in which any attributes
are coupled; in all others agents are the same. `gain_of_all` is of all these trials.

Of pairs that no training object has both of: how often both are reported true (`both`), how often
both false (`neither`), and how often both are false, with the difference of these two.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from co_occurrence import mean_and_error
from measuring import options_of, show

from meal_bayes import Learner, load_percepts
from meal_bayes.agents import Agent, load_agent
from meal_bayes.agents.base_rates import learn_base_rates
from meal_bayes.agents.joint_prior import coupled_pairs as pairs_coupled
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Query
from meal_bayes.experiments import askable, offline_tasks
from meal_bayes.planners import OpenLoop
from meal_bayes.trials import Task, Trial


class Asked(NamedTuple):
    """One task, and the places of a pair in its query that no training object has both of."""

    task: Task
    exclusive: tuple[int, int] | None


def planned_open_loop(domain: object, query: object) -> OpenLoop:
    """Return open-loop plans, as the solver of any query."""
    return OpenLoop()


def agents() -> dict[str, Agent]:
    """Return the agents to compare, the first with the joint prior."""
    ours = load_agent("bayes")
    product = replace(ours, name="product", co_occurrence=False)
    plans = replace(product, name="product, plans alone", solver=planned_open_loop)
    return {agent.name: agent for agent in (ours, product, plans)}


def coupled_pairs(table: PerceptTable) -> list[list[tuple[int, int]]]:
    """Return of each object the pairs of columns that the labels of the others couple."""
    pairs = []
    for o in range(len(table.objects)):
        labels = np.delete(table.labels, o, axis=0)
        known = pairs_coupled(table.domain, labels, learn_base_rates(table.domain, labels).mean)
        pairs.append([(first, second) for first, second in known.pairs.tolist()])
    return pairs


def every_pair(table: PerceptTable) -> list[Task]:
    """Return each coupled pair of each object that has both labels."""
    names = askable(table)
    tasks = []
    for o, pairs in enumerate(coupled_pairs(table)):
        name = table.objects[o]
        for pair in pairs:
            attributes = tuple(table.domain.attributes[p] for p in pair)
            if set(attributes) <= set(names) and (table.labels[o, list(pair)] >= 0).all():
                key = ("coupled", table.domain.data, name, *attributes)
                tasks.append(Task(name, Query(attributes), o, name, key))
    return tasks


def asked_of(table: PerceptTable, tasks: list[Task]) -> list[Asked]:
    """Return the tasks in which any attributes are coupled."""
    coupled = coupled_pairs(table)
    asked = []
    for task in tasks:
        columns = table.domain.columns(task.query.attributes)
        pairs = [pair for pair in coupled[task.object_index] if {*pair} <= {*columns}]
        labels = np.delete(table.labels, task.object_index, axis=0)
        exclusive = [
            (columns.index(first), columns.index(second))
            for first, second in pairs
            if not (labels[:, [first, second]] == 1).all(axis=1).any()
        ]
        if pairs:
            asked.append(Asked(task, exclusive[0] if exclusive else None))
    return asked


def shares(trials: list[Trial], asked: list[Asked]) -> dict[str, Any]:
    """Return how often both values are reported true and false, and are, of exclusive pairs."""
    some = [
        (trial.report[list(case.exclusive)], trial.truth[list(case.exclusive)], case)
        for trial, case in zip(trials, asked, strict=True)
        if case.exclusive is not None and trial.report is not None
    ]
    if not some:
        return {}
    reports = np.array([report for report, _, _ in some])
    truths = np.array([truth for _, truth, _ in some]) == 1
    objects = np.array([case.task.object_index for _, _, case in some])
    surplus = (~reports).all(axis=1).astype(float) - (~truths).all(axis=1)
    difference, error = mean_and_error(surplus, objects)
    return {
        "exclusive": len(some),
        "both": int(reports.all(axis=1).sum()),
        "neither": float((~reports).all(axis=1).mean()),
        "neither_true": float((~truths).all(axis=1).mean()),
        "neither_surplus": difference,
        "neither_se": error,
    }


def measure(name: str, trials_of_run: int, attributes: int) -> list[dict[str, Any]]:
    """Measure one data set: a row for each agent."""
    table = load_percepts(name)
    tasks = every_pair(table)
    if trials_of_run:
        tasks = offline_tasks(table, attributes, trials_of_run, seed=0)
    asked = asked_of(table, tasks)
    if not asked:
        return [{"dataset": name, "trials": 0}]
    place = np.array([case.task.object_index for case in asked])
    rows = []
    ours = np.empty(0)
    for agent in agents().values():
        learner = Learner(table.domain, agent=agent, logs=None).fit(table)
        trials = [learner.ask(case.task, None) for case in asked]
        rewards = np.array([trial.reward for trial in trials])
        ours = ours if len(ours) else rewards
        reward, reward_se = mean_and_error(rewards, place)
        gain, gain_se = mean_and_error(ours - rewards, place)
        rows.append(
            {
                "dataset": name,
                "agent": agent.name,
                "trials": len(trials),
                "reward": reward,
                "reward_se": reward_se,
                "gain_of_joint": gain,
                "gain_se": gain_se,
                "gain_of_all": gain * len(asked) / len(tasks),
                "all_se": gain_se * len(asked) / len(tasks),
                "right": float(np.mean([trial.success for trial in trials])),
                "seconds": float(np.mean([trial.cost for trial in trials])),
                **shares(trials, asked),
            }
        )
    return rows


def main() -> None:
    """Measure the data sets and print a table, or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--dataset", nargs="+", default=["roc36", "ispy32", "cy101"])
    parser.add_argument("--trials", type=int, default=0, help="of `run offline`")
    parser.add_argument("--attributes", type=int, default=2, help="of them")
    options = parser.parse_args()
    rows = [
        row for name in options.dataset for row in measure(name, options.trials, options.attributes)
    ]
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
