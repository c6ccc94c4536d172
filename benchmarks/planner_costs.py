"""What planning costs: the first answer after an install, policies, trials, memory.

Behind `python benchmarks/planner.py --costs`. Times are CPU seconds of whole processes, or CPU
milliseconds of one: `first_answer_cpu_s` is `meal-bayes demo` with an empty kernel cache,
`all_kernels_cpu_s` a process that decides once with every solver that has kernels. A policy is
the median over queries of building the MOMDP's policy, plans and tables included; a trial is a
whole one on recorded percepts, what was learned without the object included where it is not known
from an earlier trial.
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

DATASETS = ("roc36", "cy101", "ispy32")
AGENTS = ("random", "random_legal", "predefined_plus", "greedy", "morc", "olfc", "bayes")
QUERIES, TRIALS = 10, 40
_KERNELS = (
    "from meal_bayes.planners import POMCP, Factored, OpenLoop, warm_up\n"
    "for solver in (POMCP(), OpenLoop(), Factored()): warm_up(solver)"
)
_COSTS = "import planner_costs as c, json; print(json.dumps(c.cost({!r}, {}, {!r})))"


def measure_costs() -> dict[str, Any]:
    """Measure everything; rows are told on standard error as they are ready."""
    cold = {
        "first_answer_cpu_s": _cpu_of("-m", "meal_bayes", "demo"),
        "all_kernels_cpu_s": _cpu_of("-c", _KERNELS),
    }
    print(cold, file=sys.stderr)
    return {"cold": cold, "costs": list(_rows())}


def _rows() -> Iterator[dict[str, Any]]:
    for dataset, n, agent in product(DATASETS, (1, 2, 3), AGENTS):
        code = _COSTS.format(dataset, n, agent)
        folder = Path(__file__).parent
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=folder, check=True, capture_output=True, text=True
        )
        row = json.loads(done.stdout.splitlines()[-1])
        print(row, file=sys.stderr)
        yield row


def cost(dataset: str, n: int, agent: str) -> dict[str, Any]:
    """Measure one agent on N attributes of a data set, in a process of its own."""
    from meal_bayes.datasets import load_percepts  # noqa: PLC0415
    from meal_bayes.experiments import offline_tasks  # noqa: PLC0415
    from meal_bayes.learner import Learner  # noqa: PLC0415

    table = load_percepts(dataset)
    tasks = offline_tasks(table, n, TRIALS, 0)
    learner = Learner(dataset, agent=agent, logs=None).fit(table)
    learner.ask(tasks[0])  # loads or compiles the kernels
    policies = []
    for task in tasks[1 : 1 + QUERIES]:
        known = learner.knowledge(task.object_name)
        begin = time.process_time()
        momdp = learner.agent.model(task.query, known, limit=table.recordings)
        policy = learner.agent.solver(known.domain, task.query).solve(momdp, _generator())
        getattr(policy, "plans", None)
        policies.append(1e3 * (time.process_time() - begin))
    begin = time.process_time()
    for task in tasks:
        learner.ask(task)
    return {
        "dataset": dataset,
        "attributes": n,
        "agent": agent,
        "policy_ms": statistics.median(policies),
        "trial_ms": 1e3 * (time.process_time() - begin) / len(tasks),
        "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def _generator() -> Any:
    import numpy as np  # noqa: PLC0415

    return np.random.default_rng(0)


def _cpu_of(*arguments: str) -> float:
    """Run Python with an empty kernel cache; return its CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, *arguments],
            env={**os.environ, "NUMBA_CACHE_DIR": folder},
            cwd=folder,
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def table_of(found: dict[str, Any]) -> str:
    """Write the costs as a table."""
    lines = [", ".join(f"{name} {value:.1f}" for name, value in found["cold"].items())]
    lines.append(f"{'dataset':8s} N {'agent':16s}{'policy ms':>10s}{'trial ms':>10s}{'MB':>6s}")
    lines += [
        f"{row['dataset']:8s} {row['attributes']} {row['agent']:16s}"
        f"{row['policy_ms']:10.2f}{row['trial_ms']:10.1f}{row['rss_mb']:6.0f}"
        for row in found["costs"]
    ]
    return "\n".join(lines)
