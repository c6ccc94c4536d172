"""Planners on query problems: value, accuracy, cost, CPU time, the gap to an upper bound, peers.

Models are in `planner_models.py`, policies in `planner_policies.py`, and what planning costs
(`--costs`) in `planner_costs.py`.

Values are mean discounted returns with the report's reward as its expectation given all percepts.
Episode i of every policy meets the same object and the same luck, as long as it does the same;
`gain_over_..` is the mean paired difference. Times are CPU times of the process, solving and
deciding after a warm-up. `--jobs` changes no result: work is cut into pieces of fixed size, each
with a random stream of its own (but searches that have so many milliseconds depend on the machine).
Peers are run when they are there: pomdp-py (`pip install meal-bayes[bench]`), SARSOP (`pomdpsol`).
"""

import argparse
import itertools
import json
import math
import multiprocessing
import resource
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from planner_bound import restrict, upper_bound
from planner_costs import measure_costs, table_of
from planner_models import LARGE, MODELS, momdp_of
from planner_policies import PLANNERS, TABLED, Planner, believed_in, planners_for, solver_of
from planner_random import attributes_of, names_of

from meal_bayes.momdp import MOMDP, initial_belief
from meal_bayes.planners import History, OpenLoop, Policy
from meal_bayes.planners.factored.policy import Factored
from meal_bayes.planners.rollout import Rollouts, simulate
from meal_bayes.seeds import stream

PIECE = 100  # episodes
SLOW_EPISODES = 100  # of a peer that takes a tenth of a second a decision
SEED = 20_260

SURE = ("olfc", "pomcp:1ms")  # on random problems
QUICK = ("olfc", "factored", "pomcp:1ms", "greedy", "predefined_plus", "random_legal")


@dataclass(frozen=True, slots=True)
class Piece:
    """Episodes of one planner on one model, computed in one go."""

    model: str
    planner: Planner
    reference: str | None
    seed: int
    parts: tuple[tuple[int, int], ...]  # number of the stream, episodes


class Played(NamedTuple):
    """What a piece came to."""

    rollouts: tuple[Rollouts, ...]
    solve_s: float


def play(piece: Piece) -> Played:
    """Simulate the episodes of a piece."""
    momdp = momdp_of(piece.model, piece.reference)
    believed = believed_in(piece.planner, momdp)
    policy, solve_s = _solved(piece.model, piece.planner, piece.reference, piece.seed)
    rollouts = []
    for number, episodes in piece.parts:
        rng = stream(piece.seed, "planner benchmark", piece.model, number)
        rollouts.append(simulate(momdp, policy, episodes, rng, believed=believed))
    return Played(tuple(rollouts), solve_s)


@lru_cache(maxsize=1)
def _solved(model: str, planner: Planner, reference: str | None, seed: int) -> tuple[Policy, float]:
    believed = believed_in(planner, momdp_of(model, reference))
    return solve(believed, planner, model, seed)


def solve(momdp: MOMDP, planner: Planner, model: str, seed: int) -> tuple[Policy, float]:
    """Solve after a warm-up, and warm the policy up; CPU seconds of solving."""
    solver, rng = solver_of(planner, model), stream(seed, "solve", model, planner.name)
    if planner.policy != "sarsop":
        small = restrict(momdp, [0])
        solver.solve(small, rng).decide(History(initial_belief(small)), rng)
    before = time.process_time()
    policy = solver.solve(momdp, rng)
    solve_s = time.process_time() - before
    policy.decide(History(initial_belief(momdp)), rng)
    return policy, solve_s


def peak_megabytes(momdp: MOMDP, planner: Planner, model: str, seed: int) -> float:
    """Solve and play two episodes; the most memory that this process ever had, in MB."""
    momdp = replace(momdp)  # arrays are sent writable; freeze them
    policy, _ = solve(momdp, planner, model, seed)
    simulate(momdp, policy, 2, stream(seed, "memory"))
    status = Path("/proc/self/status")
    if status.is_file():  # where it is, `getrusage` counts the parent in
        lines = dict(line.split(":", 1) for line in status.read_text("ascii").splitlines())
        return int(lines["VmHWM"].split()[0]) / 1024
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / (2**20 if sys.platform == "darwin" else 2**10)


def bound_of(momdp: MOMDP) -> float:
    """Bound the optimum; blocks of one attribute where there are many."""
    n = len(momdp.query)
    whole = np.inf
    if n < min(LARGE) and np.isinf(momdp.precision).all():
        whole = Factored().solve(momdp, np.random.default_rng(0)).upper_bound
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
    slow = planner.policy.startswith("pomdp-py")
    episodes = min(options.episodes, SLOW_EPISODES) if slow else options.episodes
    parts = [
        (number, max(2, min(PIECE, episodes - first)))
        for number, first in enumerate(range(0, episodes, PIECE))
    ]
    # What a program found in so many seconds is found once, not in each process.
    together = [tuple(parts)] if planner.policy == "sarsop" else [(part,) for part in parts]
    return [Piece(model, planner, options.reference, options.seed, part) for part in together]


def row_of(
    model: str,
    planner: Planner,
    played: Sequence[Played],
    lower: float,
    bound: float,
    returns: Mapping[str, NDArray[np.float64]],
) -> dict[str, Any]:
    """Sum a planner's episodes up."""
    parts = [rollouts for piece in played for rollouts in piece.rollouts]
    own = np.concatenate([part.returns for part in parts])
    decisions, simulations = (
        sum(getattr(part, name) for part in parts) for name in ("decisions", "simulations")
    )
    cpu_s, value = sum(part.cpu_s for part in parts), float(own.mean())
    row = {
        "model": model,
        "policy": planner.policy,
        "budget": planner.budget,
        "value": value,
        "value_se": _standard_error(own),
        "accuracy": _mean(part.success for part in parts),
        "cost_s": _mean(part.cost for part in parts),
        "abstained": _mean(part.abstained for part in parts),
        "ms_per_decision": 1e3 * cpu_s / decisions,
        "solve_s": played[0].solve_s,
        "simulations_per_s": simulations / cpu_s if simulations else None,
        "lower_bound": lower,
        "upper_bound": bound,
        "gap": bound - value,
    }
    for other in ("olfc", "eq8"):
        gain, error = paired(own, returns.get(other)) if planner.policy != other else (None, None)
        row |= {f"gain_over_{other}": gain, f"gain_over_{other}_se": error}
    return row | {"memory_mb": None, "episodes": float(len(own))}


def paired(
    one: NDArray[np.float64], other: NDArray[np.float64] | None
) -> tuple[float | None, float | None]:
    """Mean difference of returns episode by episode, and its standard error."""
    if other is None:
        return None, None
    n = min(len(one), len(other))
    difference = one[:n] - other[:n]
    return float(difference.mean()), _standard_error(difference)


def _mean(parts: Iterable[NDArray[Any]]) -> float:
    return float(np.concatenate(list(parts)).mean())


def _standard_error(values: NDArray[np.float64]) -> float:
    return float(values.std(ddof=1) / math.sqrt(len(values)))


def measure(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Run everything; rows come as they are ready."""
    wanted = set(options.policies or ())
    spawn = multiprocessing.get_context("spawn")  # workers that hold nothing but what they need
    with ProcessPoolExecutor(options.jobs, mp_context=spawn) as pool:
        for model in options.models:
            planners = [
                planner
                for planner in planners_for(model)
                if not wanted or wanted & {planner.policy, planner.name}
            ]
            if not planners:
                continue
            cut = [pieces_of(model, planner, options) for planner in planners]
            every = [piece for pieces in cut for piece in pieces]
            results = pool.map(play, every) if options.jobs > 1 else map(play, every)
            momdp = momdp_of(model, options.reference)
            lower, bound = lower_bound(momdp), bound_of(momdp)
            returns = dict[str, NDArray[np.float64]]()
            for planner, pieces in zip(planners, cut, strict=True):
                played = [
                    _next(results, model, planner, i, len(pieces)) for i in range(len(pieces))
                ]
                row = row_of(model, planner, played, lower, bound, returns)
                parts = [part for piece in played for part in piece.rollouts]
                returns[planner.policy] = np.concatenate([part.returns for part in parts])
                if model.startswith("ispy32") and planner.policy in ("olfc", "pomcp"):
                    with ProcessPoolExecutor(1, mp_context=spawn) as alone:
                        asked = (momdp, planner, model, options.seed)
                        row["memory_mb"] = alone.submit(peak_megabytes, *asked).result()
                yield row


def _next(results: Iterator[Played], model: str, planner: Planner, i: int, n: int) -> Played:
    if sys.stderr.isatty():
        print(f"\r{model} {planner.name}: piece {i + 1} of {n} ", end="", file=sys.stderr)
    return next(results)


COLUMNS = (  # of the table: title, width, key, format
    ("value", 8, "value", "{:.1f}"),
    ("se", 5, "value_se", "{:.1f}"),
    ("plan", 7, "lower_bound", "{:.1f}"),
    ("bound", 7, "upper_bound", "{:.1f}"),
    ("gap", 6, "gap", "{:.1f}"),
    ("accuracy", 9, "accuracy", "{:.3f}"),
    ("cost s", 7, "cost_s", "{:.1f}"),
    ("abst.", 6, "abstained", "{:.2f}"),
    ("ms/dec.", 8, "ms_per_decision", "{:.3f}"),
    ("solve s", 8, "solve_s", "{:.2f}"),
    ("sims/s", 10, "simulations_per_s", "{:,.0f}"),
    ("- olfc", 7, "gain_over_olfc", "{:+.1f}"),
    ("se", 5, "gain_over_olfc_se", "{:.1f}"),
    ("- eq8", 7, "gain_over_eq8", "{:+.1f}"),
    ("se", 5, "gain_over_eq8_se", "{:.1f}"),
    ("MB", 5, "memory_mb", "{:.0f}"),
)


def head() -> str:
    """Titles of the table."""
    titles = "".join(f"{title:>{width}s}" for title, width, _, _ in COLUMNS)
    return f"{'model':14s} {'policy':23s}{titles}"


def line(row: Mapping[str, Any]) -> str:
    """Write one row of the table."""
    planner = Planner(row["policy"], row["budget"])
    cells = "".join(
        f"{'' if row[key] is None else form.format(row[key]):>{width}s}"
        for _, width, key, form in COLUMNS
    )
    return f"{row['model']:14s} {planner.name:23s}{cells}"


def parse() -> argparse.Namespace:
    """Read the options."""
    names = [planner.name for planner in PLANNERS]
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print JSON in place of the table")
    parser.add_argument("--costs", action="store_true", help="measure costs in place of values")
    parser.add_argument("--quick", action="store_true", help="A1, A2, 200 episodes, cheap policies")
    parser.add_argument("--models", type=_list(MODELS), metavar="A1,A2,...")
    parser.add_argument(
        "--random", type=_seeds, metavar="1,2,...", help="seeds of random problems, N = 1 .. 5"
    )
    parser.add_argument("--noisy", action="store_true", help="whose percepts say little")
    parser.add_argument(
        "--policies", type=_list([*names, *(planner.policy for planner in PLANNERS)]),
        metavar="P,Q,...", help=", ".join(names),
    )  # fmt: skip
    parser.add_argument("--episodes", type=int, help="of each row; 2000 by default")
    parser.add_argument("--jobs", type=int, default=2, help="processes; 2 by default")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--reference", metavar="DIR", help="or MEAL_BAYES_REFERENCE")
    options = parser.parse_args()
    if options.random:
        names = [names_of(seed, noisy=options.noisy) for seed in options.random]
        options.models = options.models or tuple(itertools.chain(*names))
        options.policies = options.policies or SURE
    options.models = options.models or (("A1", "A2") if options.quick else MODELS)
    options.policies = options.policies or (QUICK if options.quick else None)
    options.episodes = options.episodes or (200 if options.quick else 2000)
    if options.episodes < 2 or options.jobs < 1:
        parser.error("give 2 episodes or more, and 1 job or more")
    return options


def _seeds(text: str) -> tuple[int, ...]:
    return tuple(int(seed) for seed in text.split(","))


def mean_gaps(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Average the gaps to the bound on random problems, by policy and attributes; a fraction."""
    gaps: dict[str, dict[str, list[float]]] = {}
    for row in rows:
        n = attributes_of(row["model"])
        if n is not None:
            by_size = gaps.setdefault(Planner(row["policy"], row["budget"]).name, {})
            by_size.setdefault(str(n), []).append(row["gap"] / row["upper_bound"])
    return {
        policy: {n: float(np.mean(each)) for n, each in by_size.items()}
        for policy, by_size in gaps.items()
    }


def _list(known: Sequence[str]) -> Callable[[str], tuple[str, ...]]:
    def names(text: str) -> tuple[str, ...]:
        found = tuple(text.split(","))
        unknown = [name for name in found if name not in known]
        if unknown:
            raise argparse.ArgumentTypeError(f"{unknown[0]!r} is none of {', '.join(known)}")
        return found

    return names


def main() -> None:
    """Measure, print the rows as they are ready, and JSON in the end."""
    options, rows = parse(), []
    if options.costs:
        found = measure_costs()
        print(json.dumps(found, indent=2) if options.json else table_of(found))
        return
    shown = sys.stderr if options.json else sys.stdout
    print(head(), file=shown, flush=True)
    for row in measure(options):
        rows.append(row)
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)
        print(line(row), file=shown, flush=True)
    gaps = mean_gaps(rows)
    for policy, by_size in gaps.items():
        text = ", ".join(f"N = {n}: {gap:.1%}" for n, gap in by_size.items())
        print(f"mean gap of {policy}: {text}", file=shown)
    if options.json:
        print(json.dumps({"rows": rows, "mean_gaps": gaps}, indent=2, allow_nan=False))


if __name__ == "__main__":
    main()
