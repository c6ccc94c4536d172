"""What a robot's computer needs: CPU seconds and memory, by the size of the problem.

    python benchmarks/costs.py learning [--axis attributes] [--task fit]
    python benchmarks/costs.py learning --sizes 500x60x200x3 [--agents morc,bayes]
    python benchmarks/costs.py robots [--sizes 40x5 80x5 60x60]
    python benchmarks/costs.py decisions [--sizes 5x10 8x30 12x60] [--milliseconds 1]
    python benchmarks/costs.py start [--before FOLDER]
    python benchmarks/costs.py live [--trials 1000]

`learning`: percept table and `Learner.fit` by the number of objects, recordings, behaviors or
attributes, and the exponent: the slope of log CPU time over log size; with `--sizes`, `Learner.fit`
of agents at objects x behaviors x attributes x recordings. `robots`: the first decision,
by behaviors x states, of drawn diagrams: every behavior is possible in three of ten states and
leads back to where it began, or somewhere else; two attributes are asked. `decisions`: the first
and later decisions beside their budget, by attributes x behaviors, of such diagrams of six states.
Each size runs in a process of its own, after a small problem that loads the compiled code. `start`:
small commands, and the demo with nothing compiled, as after an install, of this version and of
another one. `live`: `bayes` begins with nothing, is asked for one attribute of a recorded object of
ROC36 and told all of its labels, over and over; with logs and without, and its longest `tell`: CPU
seconds of its thread, and seconds on the clock. It needs the recordings. `--json`.
"""

import argparse
import math
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from measuring import ROOT, alone, cpu_seconds, options_of, peak_mb, show
from rollout import simulate

from meal_bayes import Learner, build_momdp, initial_belief, load_dataset, load_domain
from meal_bayes.datasets import Dataset, make_synthetic
from meal_bayes.domain import Domain, Query
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import build_percept_table
from meal_bayes.planners import POMCP, Decision, History, Policy
from meal_bayes.robots.recorded import RecordedRobot, replayable
from meal_bayes.seeds import stream

Row = dict[str, Any]

FIRST = {"objects": 250, "recordings": 5, "behaviors": 2, "attributes": 2}
AXES = {
    "objects": (250, 500, 1000, 2000),
    "recordings": (5, 20, 100),
    "behaviors": (2, 10, 50),
    "attributes": (2, 81, 500),
}
ROBOTS = ("11x6", "40x5", "80x5", "40x40", "60x60")
DECISIONS = tuple(f"{n}x{e}" for n in (1, 2, 3, 4, 5, 6, 8, 10, 12) for e in (10, 30, 60))
STATES = 6
EPISODES = 20
COMMANDS = {  # words behind `python`
    "--help": ("-m", "meal_bayes", "--help"),
    "data list": ("-m", "meal_bayes", "data", "list", "roc36"),
    "log info": ("-m", "meal_bayes", "log", "info", str(ROOT / "logs" / "sample.mcap")),
}
DEMO = (  # on one core
    "import os, sys\n"
    "os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])\n"
    "from meal_bayes.cli import main\n"
    "main(['demo', '--logs', sys.argv[1]])"
)


def learning(options: argparse.Namespace) -> list[Row]:
    """Measure the cost of learning along an axis."""
    if options.sizes:
        names = ("objects", "behaviors", "attributes", "recordings")
        each = [dict(zip(names, map(int, size.split("x")), strict=True)) for size in options.sizes]
        return [
            {"agent": agent, **sizes, **alone(learn, "fit", sizes, agent)}
            for sizes in each
            for agent in options.agents.split(",")
        ]
    axis = options.axis
    rows = []
    for task in ("table", "fit") if options.task is None else (options.task,):
        mine = []
        for size in AXES[axis]:
            sizes = {**FIRST, axis: size}
            mine.append({"task": task, **sizes, **alone(learn, task, sizes)})
        (low, *_, high) = mine
        growth = max(high["cpu_seconds"], 0.01) / max(low["cpu_seconds"], 0.01)
        high["exponent"] = round(math.log(growth) / math.log(high[axis] / low[axis]), 2)
        rows += mine
    return rows


def learn(task: str, sizes: dict[str, int], agent: str = "bayes") -> Row:
    """Return CPU seconds and peak megabytes of one size, in this process."""
    work(task, data_of({**sizes, "objects": 10, "recordings": 2}), agent)
    dataset = data_of(sizes)
    started = time.process_time()
    work(task, dataset, agent)
    seconds = time.process_time() - started
    return {"cpu_seconds": round(seconds, 2), "peak_mb": round(peak_mb(), 1)}


def work(task: str, dataset: Dataset, agent: str) -> None:
    """Learn from a data set."""
    if task == "table":
        build_percept_table(dataset)
    else:
        Learner(dataset.domain, agent=agent, logs=None).fit(dataset)


def data_of(sizes: dict[str, int]) -> Dataset:
    """Make a data set of these sizes."""
    domain = domain_of(sizes["behaviors"], sizes["attributes"])
    rng = np.random.default_rng(0)
    return make_synthetic(domain, objects=sizes["objects"], recordings=sizes["recordings"], rng=rng)


def domain_of(behaviors: int, attributes: int) -> Domain:
    """Return `toy` with so many attributes and sensing behaviors, further ones like its look."""
    toy = load_domain("toy")
    look = toy.behaviors[0]
    effect = toy.diagram.effects[0]
    names = [f"look_{k}" for k in range(behaviors - 2)]
    effects = (*toy.diagram.effects, *(replace(effect, behavior=name) for name in names))
    return replace(
        toy,
        attributes=tuple(f"attribute_{k}" for k in range(attributes)),
        behaviors=(*toy.behaviors, *(replace(look, name=name) for name in names)),
        diagram=replace(toy.diagram, effects=effects),
    )


def robots(options: argparse.Namespace) -> list[Row]:
    """Measure the first decision of robots of some sizes."""
    rows = []
    for size in options.sizes or ROBOTS:
        behaviors, states = map(int, size.split("x"))
        rows.append({"behaviors": behaviors, "states": states, **alone(first, behaviors, states)})
    return rows


def first(behaviors: int, states: int) -> Row:
    """Return CPU seconds, megabytes and the value of the first decision, in this process."""
    decide(problem(5, 5, 0))
    momdp = problem(behaviors, states, 1)
    memory = peak_mb()
    started = time.process_time()
    value = decide(momdp)
    seconds = time.process_time() - started
    return {"cpu_seconds": round(seconds, 2), "mb": round(peak_mb() - memory), "value": value}


def decide(momdp: MOMDP) -> float:
    """Decide once; return what the best action is worth."""
    policy = POMCP(points=0).solve(momdp, np.random.default_rng(0))
    decision = policy.decide(History(initial_belief(momdp)), np.random.default_rng(0))
    return float(np.nanmax(decision.values))


def problem(behaviors: int, states: int, seed: int, attributes: int = 2) -> MOMDP:
    """Return a problem on a drawn diagram, whose states form a ring."""
    asked = [f"a{i}" for i in range(attributes)]
    rng = np.random.default_rng([behaviors, states, seed])
    names = [f"b{e}" for e in range(behaviors)]
    effects = [
        {
            "from": f"x{x}",
            "do": name,
            "to": f"x{(x + 1) % states if e == 0 else rng.choice([x, rng.integers(states)])}",
            "probability": float(rng.choice([1.0, 0.95, 0.9])),
        }
        for e, name in enumerate(names)
        for x in range(states)
        if e == 0 or x == e % states or rng.random() < 0.3
    ]
    table = {
        "name": "large",
        "attributes": asked,
        "report_reward": 500.0,
        "behaviors": [
            {"name": name, "cost": round(float(rng.lognormal(1.0, 0.8)), 2)}
            | ({"modalities": ["m"]} if rng.random() < 0.8 else {})
            for name in names
        ],
        "diagram": {
            "states": [f"x{x}" for x in range(states)],
            "start": "x0",
            "effects": effects,
        },
    }
    apart = rng.beta(1.2, 3.0, (attributes, behaviors))
    middle = rng.uniform(0.15, 0.85, (attributes, behaviors))
    yes = np.stack([middle * (1 - apart), middle + apart * (1 - middle)], axis=2).clip(0.03, 0.97)
    rows = np.stack([1 - yes, yes], axis=3)
    return build_momdp(load_domain(table), Query(tuple(asked)), rows)


def decisions(options: argparse.Namespace) -> list[Row]:
    """Measure all decisions of some episodes beside their budget."""
    rows = []
    for size in options.sizes or DECISIONS:
        n, e = map(int, size.split("x"))
        rows.append({"attributes": n, "behaviors": e, **alone(later, n, e, options.milliseconds)})
        print(rows[-1], file=sys.stderr, flush=True)
    return rows


def later(attributes: int, behaviors: int, milliseconds: float) -> Row:
    """Return the milliseconds of the first decision and of all later ones."""
    play(problem(5, 5, 0, attributes=attributes), milliseconds, 2)
    played = play(problem(behaviors, STATES, 1, attributes=attributes), milliseconds, EPISODES)
    at_first, *others = played.milliseconds
    return {
        "first_ms": round(at_first),
        "median_ms": round(statistics.median(others), 2),
        "largest_ms": round(max(others), 2),
        "decisions": len(others),
        "searched": sum(map(bool, played.simulations[1:])),
    }


class Timed:
    """A policy that notes the CPU milliseconds of each decision."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.milliseconds: list[float] = []
        self.simulations: list[int] = []

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Decide as the policy does."""
        started = time.thread_time()
        decision = self.policy.decide(history, rng)
        self.milliseconds.append(1e3 * (time.thread_time() - started))
        self.simulations.append(decision.simulations)
        return decision


def play(momdp: MOMDP, milliseconds: float, episodes: int) -> Timed:
    """Return the policy after some episodes."""
    policy = Timed(POMCP(milliseconds=milliseconds).solve(momdp, np.random.default_rng(0)))
    simulate(momdp, policy, episodes, np.random.default_rng(1), max_steps=30)
    return policy


def start(options: argparse.Namespace) -> list[Row]:
    """Measure small commands, and the demo with nothing compiled; Linux only."""
    rows = [{"command": name, "cpu_s": cpu_seconds(words)} for name, words in COMMANDS.items()]
    versions = {"now": ROOT}
    if options.before is not None:
        versions["before"] = options.before.resolve()
    for name, folder in versions.items():
        with tempfile.TemporaryDirectory() as cache:
            words = ("-P", "-c", DEMO, cache)
            spent = cpu_seconds(words, PYTHONPATH=str(folder), NUMBA_CACHE_DIR=cache)
        rows.append({"command": f"demo, nothing compiled, {name}", "cpu_s": spent})
    return rows


def live(options: argparse.Namespace) -> list[Row]:
    """Measure trials from nothing, with logs and without."""
    return [live_trials(options.trials, logs) for logs in (True, False)]


def live_trials(trials: int, logs: bool) -> Row:
    """Ask and tell; return the CPU seconds of all, and the longest call of each kind."""
    dataset = load_dataset("roc36")
    domain = dataset.domain
    longest = {"ask": 0.0, "tell": 0.0, "tell_cpu": 0.0}
    with tempfile.TemporaryDirectory() as folder:
        learner = Learner(domain, logs=folder if logs else None)
        for n in range(-1, trials):  # the first one loads the compiled code
            if n <= 0:
                begin = time.process_time()
            o = (n * 7) % len(dataset.objects)
            luck = (stream(n + 1, "live", part) for part in ("order", "failures"))
            robot = RecordedRobot(domain, o, replayable(dataset)[o], *luck, dataset)
            clock = time.perf_counter()
            trial = learner.ask([domain.attributes[n * 5 % len(domain.attributes)]], robot)
            asked = time.perf_counter()
            cpu = time.thread_time()
            known = zip(domain.attributes, dataset.labels[o].tolist(), strict=True)
            learner.tell(trial, {name: bool(value) for name, value in known if value >= 0})
            if n >= 0:
                longest["tell_cpu"] = max(longest["tell_cpu"], time.thread_time() - cpu)
                longest["tell"] = max(longest["tell"], time.perf_counter() - asked)
                longest["ask"] = max(longest["ask"], asked - clock)
        learner.knowledge()  # a refit may be under way
        seconds = time.process_time() - begin
    return {"logs": logs, "trials": trials, "cpu_s": seconds} | {
        f"longest_{name}_s": value for name, value in longest.items()
    }


PARTS = {
    "learning": learning,
    "robots": robots,
    "decisions": decisions,
    "start": start,
    "live": live,
}


def main() -> None:
    """Measure one part, and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--axis", choices=AXES, default="objects")
    parser.add_argument("--task", choices=("table", "fit"))
    parser.add_argument("--sizes", nargs="+")
    parser.add_argument("--agents", default="morc,bayes", help="that learn, by comma")
    parser.add_argument("--milliseconds", type=float, default=1.0, help="a decision's budget")
    parser.add_argument("--before", type=Path, help="folder of another version")
    parser.add_argument("--trials", type=int, default=1000, help="live ones")
    options = parser.parse_args()
    rows = PARTS[options.part](options)
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
