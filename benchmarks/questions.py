"""What kinds of questions are worth: the value of a group, yes or no, coupled attributes.

    python benchmarks/questions.py groups [--objects 300]
    python benchmarks/questions.py events [--models A1 A2 A3] [--episodes 300]
    python benchmarks/questions.py coupled [--dataset ispy32]

`groups`: every object is asked for the value of each of ROC36's groups, and of groups of 2 to 6
values in synthetic data with weak features, once as a group and once with attributes that are
independent; gains of `bayes` with 1.96 standard errors. `events`: whether all attributes of a model
of `planner.py` are true, by plans, by search, and the certified bound; the reward of a report is
its expectation given all percepts. `coupled`: of every pair of attributes that runs ask and the
labels couple, each object is asked for both values, by `bayes`, by `bayes` with independent
attributes, and by the latter with open-loop plans alone, which tells what the prior changes from
what the planner does; standard errors by object. Recordings and failures are paired. `--json`.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from measuring import options_of, show
from planner_models import momdp_of
from rollout import simulate

from meal_bayes import Learner, build_percept_table, load_percepts
from meal_bayes.agents import load_agent
from meal_bayes.agents.base_rates import learn_base_rates
from meal_bayes.agents.joint_prior import coupled_pairs
from meal_bayes.datasets import PerceptTable, make_synthetic
from meal_bayes.domain import Domain, Event, Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import clustered
from meal_bayes.experiments import askable
from meal_bayes.momdp import MOMDP, answer_value, initial_belief
from meal_bayes.planners import POMCP, Factored, OpenLoop
from meal_bayes.trials import Task

SIZES = range(2, 7)  # values of the synthetic groups
SEEDS = range(10)  # of random models, without a number

Row = dict[str, Any]


def groups(options: argparse.Namespace) -> Iterator[Row]:
    """Compare both ways to ask for values of groups."""
    roc36 = load_percepts("roc36")
    for group in roc36.domain.groups:
        yield about_group(roc36, group)
    for size in SIZES:
        yield about_group(synthetic(size, options.objects), "kind")


def about_group(table: PerceptTable, group: str) -> Row:
    """Ask every object for the value of a group, as a group and of independent attributes."""
    learner = Learner(table.domain, agent="bayes", logs=None).fit(table)
    members = table.domain.groups[group]
    queries = (Query(members, (tuple(range(len(members))),)), Query(members))
    rewards = np.array(
        [
            [
                learner.ask(Task(name, query, o, name, ("groups", group, name)), None).reward
                for query in queries
            ]
            for o, name in enumerate(table.objects)
        ]
    )
    gain = rewards[:, 0] - rewards[:, 1]
    return {
        "data": table.domain.name,
        "group": group,
        "values": len(members),
        "coupled": rewards[:, 0].mean(),
        "independent": rewards[:, 1].mean(),
        "gain": gain.mean(),
        "margin": 1.96 * gain.std(ddof=1) / np.sqrt(len(gain)),
    }


def synthetic(size: int, objects: int) -> PerceptTable:
    """Build the held-out percepts of objects with a group of so many values."""
    values = [f"value {number}" for number in range(size)]
    domain = load_domain(
        {"extends": "toy", "name": f"of_{size}", "attributes": values, "groups": {"kind": values}}
    )
    rng = np.random.default_rng(size)
    return build_percept_table(make_synthetic(domain, objects=objects, recordings=3, rng=rng))


def events(options: argparse.Namespace) -> Iterator[Row]:
    """Compare plans and search with the bound, a row a model."""
    for model in (each for name in options.models for each in models(name)):
        momdp = whether_all(momdp_of(model))
        row: Row = {"model": model, "at_once": answer_value(momdp, initial_belief(momdp))}
        search = POMCP(milliseconds=options.milliseconds, simulations=10**6)
        for name, solver in (("plans", OpenLoop()), ("search", search)):
            policy = solver.solve(momdp, np.random.default_rng(0))
            played = simulate(momdp, policy, options.episodes, np.random.default_rng(1))
            row |= {name: played.value, f"{name}_se": played.value_se}
        try:
            bound = Factored().solve(momdp, np.random.default_rng(0)).upper_bound
            row |= {"bound": bound, "gap": 1 - row["search"] / bound}
        except SettingsError:  # finite precision
            pass
        yield row


def models(name: str) -> Iterator[str]:
    """List models by name; a family of random ones has three to five attributes in turn."""
    if name in ("random", "noisy"):
        yield from (f"{name}{seed}-{3 + seed % 3}" for seed in SEEDS)
    else:
        yield name


def whether_all(momdp: MOMDP) -> MOMDP:
    """Return the problem whether all attributes are true; of one attribute it is the same."""
    if len(momdp.query) == 1:
        return momdp
    return replace(momdp, query=replace(momdp.query, event=Event((True,) * len(momdp.query))))


def coupled(options: argparse.Namespace) -> Iterator[Row]:
    """Compare agents on questions about coupled pairs, the first with the joint prior."""
    ours = load_agent("bayes")
    product = replace(ours, name="product", co_occurrence=False)
    plans = replace(product, name="product, plans alone", solver=planned_open_loop)
    for name in options.dataset:
        table = load_percepts(name)
        tasks = coupled_tasks(table)
        objects = [task.object_index for task in tasks]
        with_joint = np.empty(0)
        for agent in (ours, product, plans) if tasks else ():
            learner = Learner(table.domain, agent=agent, logs=None).fit(table)
            trials = [learner.ask(task, None) for task in tasks]
            rewards = np.array([trial.reward for trial in trials])
            with_joint = with_joint if len(with_joint) else rewards
            reward, gain = clustered(rewards, objects), clustered(with_joint - rewards, objects)
            yield {
                "dataset": name,
                "agent": agent.name,
                "trials": len(trials),
                "reward": reward.estimate,
                "reward_se": reward.se,
                "gain_of_joint": gain.estimate,
                "gain_se": gain.se,
                "right": float(np.mean([trial.success for trial in trials])),
                "seconds": float(np.mean([trial.cost for trial in trials])),
            }


def planned_open_loop(domain: Domain, query: Query) -> OpenLoop:
    """Return open-loop plans, as the solver of any query."""
    return OpenLoop()


def coupled_tasks(table: PerceptTable) -> list[Task]:
    """Return the questions about each pair that the labels of an object's others couple."""
    names = set(askable(table))
    tasks = []
    for o, name in enumerate(table.objects):
        labels = np.delete(table.labels, o, axis=0)
        rates = learn_base_rates(table.domain, labels).mean
        for pair in coupled_pairs(table.domain, labels, rates).pairs.tolist():
            attributes = tuple(table.domain.attributes[p] for p in pair)
            if set(attributes) <= names and (table.labels[o, pair] >= 0).all():
                key = ("coupled", table.domain.data, name, *attributes)
                tasks.append(Task(name, Query(attributes), o, name, key))
    return tasks


PARTS = {"groups": groups, "events": events, "coupled": coupled}


def main() -> None:
    """Measure one kind of question, and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--objects", type=int, default=60, help="of the synthetic groups")
    parser.add_argument("--models", nargs="+", default=["A1", "A2", "A3"])
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--milliseconds", type=float, default=1.0, help="CPU time a decision")
    parser.add_argument("--dataset", nargs="+", default=["roc36", "ispy32", "cy101"])
    options = parser.parse_args()
    rows = list(PARTS[options.part](options))
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
