"""How the cost of learning grows with objects, recordings, behaviors and attributes.

Each size runs in a process of its own; CPU time and peak memory are the process's, the time less
what a small run takes before it (imports, compiled code). The exponent is the slope of log CPU time
over log size, from the first to the last size of a row.

    python benchmarks/growth.py                        # objects: percept table and Learner.fit
    python benchmarks/growth.py --axis attributes      # 2, 81 and 500 attributes
    python benchmarks/growth.py --json
"""

import math
import time
from dataclasses import replace

import numpy as np
from measuring import alone, options_of, peak_mb, show

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
    dataset = data_of(sizes)
    started = time.process_time()
    work(task, dataset)
    seconds = time.process_time() - started
    return {"cpu_seconds": round(seconds, 2), "peak_mb": round(peak_mb(), 1)}


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
    parser = options_of(__doc__)
    parser.add_argument("--axis", choices=AXES, default="objects")
    parser.add_argument("--task", choices=TASKS, action="append")
    parser.add_argument("--most", type=int, default=10**9, help="largest size")
    options = parser.parse_args()
    rows = []
    exponents = {}
    for task in options.task or TASKS:
        all_sizes = [{**START, options.axis: size} for size in AXES[options.axis]]
        mine = [
            {"task": task, **sizes, **alone(measure, task, sizes)}
            for sizes in all_sizes
            if sizes[options.axis] <= options.most
        ]
        rows += mine
        exponents[task] = exponent(options.axis, mine)
    report = {"axis": options.axis, "rows": rows, "exponents": exponents}
    show(rows, report if options.json else None)
    if not options.json:
        print(f"exponents: {exponents}")


if __name__ == "__main__":
    main()
