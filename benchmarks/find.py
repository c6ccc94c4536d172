"""Find one of several recorded objects: the index policy against asking about each.

    python benchmarks/find.py roc36 cy101 ispy32 --objects 4,8 --trials 100

Every trial draws objects and a question of two attributes ("red and not empty"), such that one
object, or a quarter at most, answers it with yes in half of the trials, and none in the others.
Three ways meet the same objects with the same luck of the robot:

- find: `Learner.find`;
- turn: each in turn is asked by yes or no, where a wrong yes costs r and a no nothing, until one is
  yes;
- all: each is asked so, and the one of the largest Pr(yes) is claimed, if that is worth more than
  nothing.

All claim for the same payoffs, r and -r, and nothing for none, and all put an object down before
they turn to the next, at the cost that the diagram says. None has learned a label of any of the
objects: where each was held out alone, the others' labels would say of the one that answers with
yes, and of it alone, that few objects do. Differences are paired by trial; the
intervals are 95 %, by a bootstrap over trials.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from measuring import options_of, show

from meal_bayes.datasets import PerceptTable, load_percepts
from meal_bayes.domain import Payoffs, Query, read_event
from meal_bayes.errors import QueryError
from meal_bayes.learner import Learner
from meal_bayes.planners import paths_back
from meal_bayes.seeds import stream

DRAWS = 2_000
ATTEMPTS = 10_000
Result = tuple[float, float, bool]  # reward, s, whether the claim was right


def drawn(
    table: PerceptTable, size: int, number: int, seed: int
) -> tuple[Query, list[str], np.ndarray]:
    """Draw a question, objects, and whether each answers it with yes."""
    rng = stream(seed, "find", table.domain.data, size, number)
    wanted = number % 2 == 0
    names = table.domain.attributes
    for _ in range(ATTEMPTS):
        pair = rng.choice(len(names), 2, replace=False)
        words = [names[p] if rng.random() < 0.5 else f"not {names[p]}" for p in pair]
        try:
            query = read_event(" and ".join(words), table.domain)
        except QueryError:  # of two values of one group the answer is known
            continue
        if query.event is None or len(query) != 2:
            continue
        objects = rng.choice(len(table.objects), size, replace=False)
        columns = table.domain.columns(query.attributes)
        labels = table.labels[objects][:, columns]
        truth = np.array([query.event.holds(row, query.variables) for row in labels])
        # Most objects do not answer it with yes: a search that any object ends is none.
        if (truth >= 0).all() and truth.sum() <= size // 4 and truth.any() == wanted:
            return query, [table.objects[o] for o in objects], truth == 1
    raise SystemExit("no such question was drawn")


def asked(
    learner: Learner, query: Query, objects: list[str], truth: np.ndarray, *, until_yes: bool
) -> Result:
    """Ask about each object; stop at the first yes, or claim the likeliest in the end."""
    reward = learner.settings.reward
    question = replace(query, payoffs=Payoffs(reward, -reward, 0.0, 0.0))
    cost = 0.0
    held = 0.0
    best = 0.5
    claim = -1
    for place, name in enumerate(objects):
        task = learner.task(question, name)
        trial = learner.ask(task)
        cost += trial.cost + held
        x = trial.steps[-1].x  # an object in the hand is put down before the next
        leave = np.isin(trial.momdp.x_names, learner.domain.leave)
        held = float(paths_back(trial.momdp, leave).cost[x])
        probability = float(trial.probability or 0.0)
        if until_yes and trial.report is not None and trial.report[0]:
            claim = place
            break
        if not until_yes and probability > best:
            best = probability
            claim = place
    return _result(reward, cost, claim, truth)


def _result(reward: float, cost: float, claim: int, truth: np.ndarray) -> Result:
    earned = 0.0 if claim < 0 else reward if truth[claim] else -reward
    right = bool(truth[claim]) if claim >= 0 else not truth.any()
    return earned - cost, cost, right


def learned_without(
    table: PerceptTable, objects: list[str], options: argparse.Namespace
) -> Learner:
    """Return a learner that knows no label of any of these objects."""
    labels = table.labels.copy()
    labels[[table.objects.index(name) for name in objects]] = -1
    learner = Learner(table.domain, agent=options.agent, seed=options.seed, logs=None)
    return learner.fit(replace(table, labels=labels))


def rows(data: str, size: int, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Run all trials of one data set and number of objects; yield a row a way."""
    table = load_percepts(data)
    results: dict[str, list[Result]] = {"find": [], "turn": [], "all": []}
    searching = 0.0
    for number in range(options.trials):
        query, objects, truth = drawn(table, size, number, options.seed)
        learner = learned_without(table, objects, options)
        before = time.process_time()
        search = learner.find(query, objects)
        searching += time.process_time() - before
        claim = -1 if search.claim is None else objects.index(search.claim)
        results["find"].append(_result(learner.settings.reward, search.cost, claim, truth))
        for way in ("turn", "all"):
            found = asked(learner, query, objects, truth, until_yes=way == "turn")
            results[way].append(found)
    rng = np.random.default_rng(0)
    index = rng.integers(options.trials, size=(DRAWS, options.trials))
    ours = np.array(results["find"], float)
    for way, values in results.items():
        mine = np.array(values, float)
        gain = ours[:, 0] - mine[:, 0]
        low, high = np.quantile(gain[index].mean(axis=1), [0.025, 0.975])
        error = mine[:, 0].std(ddof=1) / np.sqrt(options.trials)
        yield {
            "data": data,
            "objects": size,
            "way": way,
            "reward": mine[:, 0].mean(),
            "se": error,
            "seconds": mine[:, 1].mean(),
            "right": mine[:, 2].mean(),
            "ahead": gain.mean(),
            "low": low,
            "high": high,
            "cpu_s": searching / options.trials if way == "find" else None,
        }


def main() -> None:
    """Print a row a way as soon as it is known, or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("data", nargs="+")
    parser.add_argument("--objects", default="4,8", help="comma list")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--agent", default="bayes")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    all_rows = []
    if not options.json:
        print("data    objects  way     reward          s   right   find is ahead by")
    for data, size in product(options.data, map(int, options.objects.split(","))):
        for row in rows(data, size, options):
            all_rows.append(row)
            if not options.json:
                print(line(row), flush=True)
    if options.json:
        show(all_rows, all_rows)


def line(row: dict[str, Any]) -> str:
    """Write a row of the table."""
    ahead = f"{row['ahead']:6.1f} ({row['low']:.1f}, {row['high']:.1f})"
    return (
        f"{row['data']:<8}{row['objects']:>7}  {row['way']:<5}{row['reward']:8.1f} "
        f"±{row['se']:5.1f}{row['seconds']:8.1f}{row['right']:8.2f}   "
        + (ahead if row["way"] != "find" else f"({row['cpu_s']:.2f} s of CPU)")
    )


if __name__ == "__main__":
    main()
