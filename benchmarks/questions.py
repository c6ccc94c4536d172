"""What questions of yes or no are worth, by model: plans, search, and the certified bound.

    python benchmarks/questions.py A1 A2 A3 --episodes 600
    python benchmarks/questions.py random noisy --episodes 200      # three to five attributes each

Every attribute is asked for, "and" between them, prior and rates as in `planner_models`. The reward
of a report is its expectation given all percepts, so that the standard error is small.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from planner_models import momdp_of

from meal_bayes.domain import Event
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, answer_value, initial_belief
from meal_bayes.planners import POMCP, OpenLoop
from meal_bayes.planners.rollout import simulate
from meal_bayes.planners.table.policy import Factored

SEEDS = range(10)  # of random models, without a number


def asked(momdp: MOMDP) -> MOMDP:
    """Return the problem whether all attributes are true; of one attribute it is the same."""
    if len(momdp.query) == 1:
        return momdp
    return replace(momdp, query=replace(momdp.query, event=Event((True,) * len(momdp.query))))


def models(name: str) -> Iterator[str]:
    """List models by name; a family of random ones has three to five attributes in turn."""
    if name in ("random", "noisy"):
        yield from (f"{name}{seed}-{3 + seed % 3}" for seed in SEEDS)
    else:
        yield name


def main() -> None:
    """Print a table, a row a model."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("models", nargs="+")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--milliseconds", type=float, default=1.0, help="CPU time a decision")
    options = parser.parse_args()
    print("model          at once        plans       search        bound   gap")
    gaps = []
    for model in (each for name in options.models for each in models(name)):
        momdp = asked(momdp_of(model))
        cells = [f"{model:<12}{answer_value(momdp, initial_belief(momdp)):10.1f}"]
        for solver in (OpenLoop(), POMCP(milliseconds=options.milliseconds, simulations=10**6)):
            policy = solver.solve(momdp, np.random.default_rng(0))
            rollouts = simulate(momdp, policy, options.episodes, np.random.default_rng(1))
            cells.append(f"{rollouts.value:7.1f} ±{rollouts.value_se:4.1f}")
        try:
            bound = Factored().solve(momdp, np.random.default_rng(0)).upper_bound
            gaps.append(1 - rollouts.value / bound)
            cells.append(f"{bound:9.1f} {gaps[-1]:6.1%}")
        except SettingsError:  # finite precision
            cells.append("        -")
        print(" ".join(cells), flush=True)
    if gaps:
        print(f"mean gap {np.mean(gaps):.1%} of {len(gaps)}")


if __name__ == "__main__":
    main()
