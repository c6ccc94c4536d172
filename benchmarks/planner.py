"""Planners on query problems: value, accuracy, cost, CPU time, the gap to an upper bound, peers.

Models are in `planner_models.py`, policies in `planner_policies.py`. Values are mean discounted
returns with the report's reward as its expectation given all percepts. Episode i of every policy
meets the same object and the same luck, as long as it does the same; `gain_over_olfc` is the mean
paired difference. Times are CPU times of the process, solving and deciding after a warm-up.
`--jobs` changes no result: work is cut into pieces of fixed size, each with a random stream of its
own (but searches that have so many milliseconds depend on the machine). Peers are run when they are
there: pomdp-py (`pip install meal-bayes[bench]`), pymdp (`pip install inferactively-pymdp`),
POMDPPlanners (`pip install POMDPPlanners`, in an
environment of its own, as it asks for an old numba), SARSOP (`pomdpsol`).
"""

import argparse
import itertools
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from measuring import SPAWN, options_of, show
from numpy.typing import NDArray
from planner_bound import restrict, upper_bound
from planner_models import LARGE, MODELS, attributes_of, momdp_of, names_of
from planner_policies import PEERS, PLANNERS, TABLED, Planner, planners_for, solver_of
from rollout import Rollouts, simulate

from meal_bayes.momdp import MOMDP, initial_belief
from meal_bayes.planners import History, OpenLoop, Policy, warm_up
from meal_bayes.planners.table.policy import Factored
from meal_bayes.seeds import stream

PIECE = 100  # episodes
SLOW_EPISODES = 100  # of a peer that takes a tenth of a second a decision
SEED = 20_260
BOUND_POINTS = 400_000  # of the bound where policies use 50,000: a minute for five attributes
SURE = ("olfc", "pomcp:1ms")  # on random problems
QUICK = ("olfc", "factored", "pomcp:1ms", "greedy", "predefined_plus", "random_legal")


class Piece(NamedTuple):
    """Episodes of one planner on one model, computed in one go."""

    model: str
    planner: Planner
    seed: int
    number: int  # of the stream
    episodes: int


def play(piece: Piece) -> tuple[Rollouts, float]:
    """Simulate the episodes of a piece; with the CPU seconds of solving."""
    momdp = momdp_of(piece.model)
    policy, seconds = solved(piece.model, piece.planner, piece.seed)
    rng = stream(piece.seed, "planner benchmark", piece.model, piece.number)
    return simulate(momdp, policy, piece.episodes, rng), seconds


@lru_cache(maxsize=1)
def solved(model: str, planner: Planner, seed: int) -> tuple[Policy, float]:
    """Solve after a warm-up, and warm the policy up; CPU seconds of solving."""
    momdp = momdp_of(model)
    solver = solver_of(planner, model)
    rng = stream(seed, "solve", model, planner.name)
    for limit in (3.0, math.inf):  # kernels of ours; a search with a table has its own
        warm_up(solver, limit)
    if planner.policy != "sarsop":
        small = restrict(momdp, [0])
        solver.solve(small, rng).decide(History(initial_belief(small)), rng)
    before = time.process_time()
    policy = solver.solve(momdp, rng)
    seconds = time.process_time() - before
    policy.decide(History(initial_belief(momdp)), rng)
    return policy, seconds


def bound_of(momdp: MOMDP) -> float:
    """Bound the optimum; blocks of one attribute where there are many."""
    n = len(momdp.query)
    whole = np.inf
    if n < min(LARGE) and np.isinf(momdp.precision).all():
        whole = Factored(BOUND_POINTS).solve(momdp, np.random.default_rng(0)).upper_bound
    if n <= TABLED and whole < np.inf:
        return whole
    return min(whole, upper_bound(momdp, size=1 if n >= min(LARGE) else TABLED))


def lower_bound(momdp: MOMDP) -> float:
    """Bound the optimum by the best open-loop plan, or by ending at once."""
    rng = np.random.default_rng(0)
    decision = OpenLoop().solve(momdp, rng).decide(History(initial_belief(momdp)), rng)
    return float(np.nanmax(decision.values))


def pieces_of(model: str, planner: Planner, options: argparse.Namespace) -> list[Piece]:
    """Cut a planner's episodes into pieces that depend on nothing but their number."""
    slow = planner.policy in PEERS
    episodes = min(options.episodes, SLOW_EPISODES) if slow else options.episodes
    return [
        Piece(model, planner, options.seed, number, max(2, min(PIECE, episodes - first)))
        for number, first in enumerate(range(0, episodes, PIECE))
    ]


def row_of(
    model: str,
    planner: Planner,
    parts: Sequence[Rollouts],
    *,
    lower: float,
    bound: float,
    olfc: NDArray[np.float64] | None,
) -> dict[str, Any]:
    """Sum a planner's episodes up, beside those of open-loop feedback control."""

    def every(name: str) -> NDArray[np.float64]:
        return np.concatenate([getattr(part, name) for part in parts]).astype(float)

    simulations, decisions = (
        sum(getattr(part, name) for part in parts) for name in ("simulations", "decisions")
    )
    returns = every("returns")
    cpu_s = sum(part.cpu_s for part in parts)
    value = float(returns.mean())
    gain = None
    if olfc is not None:  # paired: episode i of both has the same object and the same luck
        n = min(len(returns), len(olfc))
        gain = returns[:n] - olfc[:n]
    return {
        "model": model,
        "policy": planner.policy,
        "budget": planner.budget,
        "value": value,
        "value_se": standard_error(returns),
        "lower_bound": lower,
        "upper_bound": bound,
        "gap": bound - value,
        "gain_over_olfc": None if gain is None else float(gain.mean()),
        "gain_over_olfc_se": None if gain is None else standard_error(gain),
        "accuracy": float(every("success").mean()),
        "cost_s": float(every("cost").mean()),
        "abstained": float(every("abstained").mean()),
        "ms_per_decision": 1e3 * cpu_s / decisions,
        "simulations_per_s": simulations / cpu_s if simulations else None,
        "episodes": float(len(returns)),
    }


def standard_error(values: NDArray[np.float64]) -> float:
    """Return the standard error of a mean."""
    return float(values.std(ddof=1) / math.sqrt(len(values)))


def measure(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Run everything; rows come as they are ready."""
    wanted = set(options.policies or ())
    with ProcessPoolExecutor(options.jobs, mp_context=SPAWN) as pool:
        for model in options.models:
            planners = [
                planner
                for planner in planners_for(model)
                if not wanted or wanted & {planner.policy, planner.name}
            ]
            cut = [pieces_of(model, planner, options) for planner in planners]
            pieces = list(itertools.chain(*cut))
            results = pool.map(play, pieces) if options.jobs > 1 else map(play, pieces)
            momdp = momdp_of(model)
            olfc = None
            lower = lower_bound(momdp)
            bound = bound_of(momdp)
            for planner, mine in zip(planners, cut, strict=True):
                parts, seconds = zip(*itertools.islice(results, len(mine)), strict=True)
                row = row_of(model, planner, parts, lower=lower, bound=bound, olfc=olfc)
                yield row | {"solve_s": seconds[0]}
                if planner.policy == "olfc":
                    olfc = np.concatenate([part.returns for part in parts])


def parse() -> argparse.Namespace:
    """Read the options."""
    names = [planner.name for planner in PLANNERS]
    parser = options_of(__doc__)
    parser.add_argument("--quick", action="store_true", help="A1, A2, 200 episodes, cheap policies")
    parser.add_argument(
        "--models", type=names_among(MODELS, attributes_of), metavar="A1,A2,...,random7-3,..."
    )
    parser.add_argument("--random", metavar="1,2,...", help="seeds of random problems, N = 1 .. 5")
    parser.add_argument("--noisy", action="store_true", help="whose percepts say little")
    parser.add_argument(
        "--policies",
        type=names_among([*names, *(planner.policy for planner in PLANNERS)]),
        metavar="P,Q,...",
        help=", ".join(names),
    )
    parser.add_argument("--episodes", type=int, help="of each row; 2000 by default")
    parser.add_argument("--jobs", type=int, default=2, help="processes; 2 by default")
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args()
    if options.random:
        seeds = map(int, options.random.split(","))
        random = [name for seed in seeds for name in names_of(seed, noisy=options.noisy)]
        options.models = options.models or random
        options.policies = options.policies or SURE
    options.models = options.models or (("A1", "A2") if options.quick else MODELS)
    options.policies = options.policies or (QUICK if options.quick else None)
    options.episodes = options.episodes or (200 if options.quick else 2000)
    if options.episodes < 2 or options.jobs < 1:
        parser.error("give 2 episodes or more, and 1 job or more")
    return options


def names_among(
    known: Sequence[str], other: Callable[[str], object] = lambda name: None
) -> Callable[[str], list[str]]:
    """Return a type of option: names with commas between them, or others that mean something."""

    def names(text: str) -> list[str]:
        for name in text.split(","):
            if name not in known and other(name) is None:
                raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(known)}")
        return text.split(",")

    return names


def main() -> None:
    """Measure, and print a table or JSON."""
    options = parse()
    rows = []
    for row in measure(options):
        rows.append(row)
        print(f"{row['model']} {row['policy']}: {row['value']:.1f}", file=sys.stderr, flush=True)
    show(rows, {"rows": rows} if options.json else None)


if __name__ == "__main__":
    main()
