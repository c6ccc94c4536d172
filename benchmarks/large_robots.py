"""What the first decision of a large robot costs, by its numbers of behaviors and states.

The diagrams are drawn: every behavior is possible in three of ten states and leads back to where it
began, or somewhere else. Two attributes are asked. Each size runs in a process of its own, after a
small problem that loads the compiled code; memory is what the process takes beyond that.

    python benchmarks/large_robots.py [--json] [--sizes 40x5 80x5 60x60]
"""

import time

import numpy as np
from measuring import alone, options_of, peak_mb, show

from meal_bayes import build_momdp, initial_belief, load_domain
from meal_bayes.domain import Query
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import POMCP, History

SIZES = ("11x6", "40x5", "80x5", "40x40", "60x60")


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


def decide(momdp: MOMDP) -> float:
    """Decide once; return what the best action is worth."""
    policy = POMCP(points=0).solve(momdp, np.random.default_rng(0))
    decision = policy.decide(History(initial_belief(momdp)), np.random.default_rng(0))
    return float(np.nanmax(decision.values))


def measure(behaviors: int, states: int) -> dict[str, float]:
    """Return CPU seconds, megabytes and the value of the first decision, in this process."""
    decide(problem(5, 5, 0))
    momdp = problem(behaviors, states, 1)
    memory = peak_mb()
    started = time.process_time()
    value = decide(momdp)
    seconds = time.process_time() - started
    return {"cpu_seconds": round(seconds, 2), "mb": round(peak_mb() - memory), "value": value}


def main() -> None:
    """Print a row for every size."""
    parser = options_of(__doc__)
    parser.add_argument("--sizes", nargs="+", default=SIZES, help="behaviors x states")
    options = parser.parse_args()
    rows = []
    for size in options.sizes:
        behaviors, states = map(int, size.split("x"))
        rows.append({"behaviors": behaviors, "states": states, **alone(measure, behaviors, states)})
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
