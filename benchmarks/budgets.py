"""How long a decision takes beside its budget, by the numbers of attributes and behaviors.

Problems are drawn as in `large_robots.py`, of six states, and rates are known. An episode is
simulated; its first decision, which makes plans and tables, stands apart. Each size runs in a
process of its own, after a small problem that loads the compiled code.

    python benchmarks/budgets.py [--json] [--milliseconds 1] [--sizes 5x10 8x30 12x60]
"""

import statistics
import sys
import time

import numpy as np
from large_robots import problem
from measuring import alone, options_of, show

from meal_bayes.momdp import MOMDP
from meal_bayes.planners import POMCP, Decision, History, Policy
from meal_bayes.planners.rollout import simulate

SIZES = tuple(f"{n}x{e}" for n in (1, 2, 3, 4, 5, 6, 8, 10, 12) for e in (10, 30, 60))
STATES = 6
EPISODES = 20


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


def measure(attributes: int, behaviors: int, milliseconds: float) -> dict[str, float]:
    """Return the milliseconds of the first decision and of all later ones."""
    play(problem(5, 5, 0, attributes=attributes), milliseconds, 2)
    played = play(problem(behaviors, STATES, 1, attributes=attributes), milliseconds, EPISODES)
    first, *later = played.milliseconds
    return {
        "first_ms": round(first),
        "median_ms": round(statistics.median(later), 2),
        "largest_ms": round(max(later), 2),
        "decisions": len(later),
        "searched": sum(map(bool, played.simulations[1:])),
    }


def main() -> None:
    """Print a row for every size."""
    parser = options_of(__doc__)
    parser.add_argument("--sizes", nargs="+", default=SIZES, help="attributes x behaviors")
    parser.add_argument("--milliseconds", type=float, default=1.0, help="a decision's budget")
    options = parser.parse_args()
    rows = []
    for size in options.sizes:
        n, e = map(int, size.split("x"))
        measured = alone(measure, n, e, options.milliseconds)
        rows.append({"attributes": n, "behaviors": e, **measured})
        print(rows[-1], file=sys.stderr, flush=True)
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
