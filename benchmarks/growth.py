"""How the cost of learning grows with objects, recordings, behaviors and attributes.

Each size runs in a process of its own; CPU time and peak memory are the process's, the time less
what a small run takes before it (imports, compiled code). The exponent is the slope of log CPU time
over log size, from the first to the last size of a row.

    python benchmarks/growth.py                        # objects: percept table and Learner.fit
    python benchmarks/growth.py --axis attributes      # 2, 81 and 500 attributes
    python benchmarks/growth.py --json
"""

import argparse
import json
import math
import resource
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np

from meal_bayes import Learner
from meal_bayes.datasets import Dataset, make_synthetic
from meal_bayes.domain import Domain, load_domain
from meal_bayes.perception import build_percept_table

START = {"objects": 250, "recordings": 5, "behaviors": 2, "attributes": 2}
AXES = {
    "objects": (250, 500, 1000, 2000),
    "recordings": (5, 20, 100),
    "behaviors": (2, 10, 50),
    "attributes": (2, 81, 500),
}
TASKS = ("table", "fit")


def domain_of(behaviors: int, attributes: int) -> Domain:
    """Return `toy` with so many attributes and sensing behaviors, further ones like its look."""
    toy = load_domain("toy")
    look, effect = toy.behaviors[0], toy.diagram.effects[0]
    names = [f"look_{k}" for k in range(behaviors - 2)]
    effects = (*toy.diagram.effects, *(replace(effect, behavior=name) for name in names))
    return replace(
        toy,
        attributes=tuple(f"attribute_{k}" for k in range(attributes)),
        behaviors=(*toy.behaviors, *(replace(look, name=name) for name in names)),
        diagram=replace(toy.diagram, effects=effects),
    )


def data_of(sizes: dict[str, int]) -> Dataset:
    """Make a data set of these sizes."""
    return make_synthetic(
        domain_of(sizes["behaviors"], sizes["attributes"]),
        objects=sizes["objects"],
        recordings=sizes["recordings"],
        rng=np.random.default_rng(0),
    )


def work(task: str, dataset: Dataset) -> None:
    """Learn from a data set."""
    if task == "table":
        build_percept_table(dataset)
    else:
        Learner(dataset.domain, agent="bayes", logs=None).fit(dataset)


def measure(task: str, sizes: dict[str, int]) -> dict[str, float]:
    """Return CPU seconds and peak megabytes of one size, in this process."""
    work(task, data_of({**sizes, "objects": 10, "recordings": 2}))
    dataset, started = data_of(sizes), time.process_time()
    work(task, dataset)
    seconds = time.process_time() - started
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"cpu_seconds": round(seconds, 2), "peak_mb": round(kilobytes / 1024, 1)}


def rows_of(axis: str, task: str, most: int) -> list[dict[str, object]]:
    """Measure one task along one axis, each size in a process of its own."""
    rows = []
    for size in AXES[axis]:
        if size <= most:
            sizes = {**START, axis: size}
            words = [sys.executable, __file__, "--one", json.dumps([task, sizes])]
            done = subprocess.run(words, check=True, capture_output=True, text=True)
            rows.append({"task": task, **sizes, **json.loads(done.stdout)})
    return rows


def exponent(axis: str, rows: list[dict[str, object]]) -> float | None:
    """Return the slope of log CPU time over log size; None of a single size."""
    if len(rows) < 2:
        return None
    (low, first), (high, last) = (
        (float(row[axis]), max(float(row["cpu_seconds"]), 0.01)) for row in (rows[0], rows[-1])
    )
    return round(math.log(last / first) / math.log(high / low), 2)


def main() -> None:
    """Print a row for every size, and the exponents."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axis", choices=AXES, default="objects")
    parser.add_argument("--task", choices=TASKS, action="append")
    parser.add_argument("--most", type=int, default=10**9, help="largest size")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(*json.loads(options.one))))
        return
    found = {task: rows_of(options.axis, task, options.most) for task in options.task or TASKS}
    exponents = {task: exponent(options.axis, rows) for task, rows in found.items()}
    if options.json:
        rows = [row for own in found.values() for row in own]
        print(json.dumps({"axis": options.axis, "rows": rows, "exponents": exponents}))
        return
    for task, rows in found.items():
        for row in rows:
            size, seconds, peak = row[options.axis], row["cpu_seconds"], row["peak_mb"]
            print(f"{task:6} {size:>6} {options.axis}: {seconds:>8} s CPU, {peak:>7} MB")
        print(f"{task:6} exponent {exponents[task]}")


if __name__ == "__main__":
    main()
