"""Where the reward of `bayes` is lost: what more data, better plans and better sensors would bring.

    python benchmarks/losses.py [--trials 200] [--dataset NAME ...] [--json]

The same tasks for every number, recorded percepts. More data: the objects are dealt out into two
halves; classifiers are taught anew by each half alone, and an object's percepts, and all that is
learned of them, come from its own. What a result lacks is taken to fall as 1 / objects, so that as
much is to be gained from all of the objects to objects without end as was gained from half of them
to all; the gain is paired, and no more than is left below perfect percepts. Better plans: percepts
are drawn from the tables of `morc`, where an upper bound of the optimum is certified (factored
value iteration, undiscounted); bound less reward is the most that any planner adds there. A gap
below 0 is luck, and counts as none: trials without one wrong report earn more than the bound, which
expects some, and their standard error knows of none. Better sensors: what is then left to a first
look that is never wrong. Questions ask for the values of one to three attributes, or whether two
are both true; yes and no are guessed more easily, and of them the best plan is not bounded.
"""

import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from measuring import options_of, show
from numpy.typing import NDArray

from meal_bayes import OfflineConfig, read_trials, run_offline
from meal_bayes.datasets import Dataset, PerceptTable, load_dataset, load_percepts, save_percepts
from meal_bayes.evaluation import Estimate, clustered, difference, estimate_mean
from meal_bayes.perception import build_percept_table
from meal_bayes.planners import Factored
from meal_bayes.seeds import stream
from meal_bayes.trials import TrialOutcomes

DATASETS = ("cy101", "roc36", "ispy32")
QUESTIONS = ((1, "values"), (2, "values"), (3, "values"), (2, "yes or no"))
REWARD = 500.0  # of a right answer, s
BOUNDED = 50  # trials of which the best plan is bounded
LOGS = Path("logs")
SEED = 0


class Gains(NamedTuple):
    """What would be gained in the reward of one kind of question.

    Attributes
    ----------
    data, plans, sensors : by objects without end, the best plan, and sensors that never err.
    """

    data: Estimate
    plans: Estimate
    sensors: Estimate


def main() -> None:
    """Measure all kinds of questions, and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--dataset", nargs="+", default=DATASETS)
    options = parser.parse_args()
    rows = []
    for dataset in options.dataset:
        halves = table_by_halves(dataset)
        for n, answer in QUESTIONS:
            rows.append(measure(dataset, halves, n, answer, options.trials))
            print(rows[-1], file=sys.stderr, flush=True)
    show(rows, {"rows": rows} if options.json else None)


def measure(dataset: str, halves: str, n: int, answer: str, trials: int) -> dict[str, Any]:
    """Measure one kind of question; each number with its standard error."""
    half, ours = (run(place, n, answer, trials) for place in (halves, dataset))
    gap = Estimate(0, 0, 1)  # of yes or no the best plan is not bounded
    if answer == "values":
        gap = planning_gap(dataset, n, trials)
    ideal = REWARD - cheapest_percept(load_percepts(dataset))
    gains = split(estimate_mean(ours, "reward"), difference(ours, half), gap, ideal)
    row: dict[str, Any] = {"dataset": dataset, "attributes": n, "answer": answer, "trials": trials}
    measured = {"half": estimate_mean(half, "reward"), "all": estimate_mean(ours, "reward")}
    for name, effect in (measured | gains._asdict()).items():
        row |= {name: effect.estimate, f"{name}_se": effect.se}
    return row


def run(place: str, n: int, answer: str, trials: int) -> TrialOutcomes:
    """Run our agent, or read its trials from the logs."""
    config = OfflineConfig(
        place,
        attributes=n,
        trials=trials,
        agents=("bayes",),
        seed=SEED,
        reward=REWARD,
        answer=answer,
    )
    return run_offline(config, logs=LOGS).outcomes()


def split(by_all: Estimate, doubled: Estimate, gap: Estimate, ideal: float) -> Gains:
    """Divide what a reward lacks into data, plans and sensors; the three sum up to it.

    Parameters
    ----------
    by_all : reward by all of the objects.
    doubled : gain from half of the objects to all, which more will bring once more (1 / objects).
    gap : the most that planning adds.
    ideal : reward of percepts that never err.
    """
    # In this order: what data do not bring is left to plans, and what neither does to sensors.
    lacks = max(ideal - by_all.estimate, 0.0)
    data = min(max(doubled.estimate, 0.0), lacks)
    plans = min(max(gap.estimate, 0.0), lacks - data)
    sensors = lacks - data - plans
    return Gains(
        replace(doubled, estimate=data),
        replace(gap, estimate=plans),
        replace(
            by_all, estimate=sensors, se=float(np.linalg.norm([by_all.se, doubled.se, gap.se]))
        ),
    )


def planning_gap(dataset: str, n: int, trials: int) -> Estimate:
    """Bound what planning could add to the reward of `morc` where its tables are the truth."""
    config = OfflineConfig(
        dataset,
        attributes=n,
        trials=min(trials, BOUNDED),
        agents=("morc",),
        seed=SEED,
        percepts="model",
        reward=REWARD,
    )
    done = run_offline(config, logs=LOGS)
    bounds: dict[tuple[object, ...], float] = {}
    rewards = []
    tops = []
    objects = []
    for trial in islice(
        (trial for path in done.paths for trial in read_trials(path)), config.trials
    ):
        key = (trial.task.object_index, trial.task.query.attributes)
        if key not in bounds:
            undiscounted = replace(trial.momdp, discount=1.0)
            policy = Factored().solve(undiscounted, np.random.default_rng(0))
            bounds[key] = policy.upper_bound
        rewards.append(trial.reward)
        tops.append(bounds[key])
        objects.append(trial.task.object_index)
    return clustered(np.array(tops) - np.array(rewards), objects)


def cheapest_percept(table: PerceptTable) -> float:
    """Return the least cost of a behavior that senses and is legal at the start, s."""
    domain = table.domain
    legal = domain.diagram.successes(domain.diagram.start)
    return min(b.cost for b in domain.behaviors if b.modalities and b.name in legal)


def table_by_halves(name: str) -> str:
    """Write the percept table of a data set by halves, and return its path."""
    dataset = load_dataset(name)
    whole = load_percepts(name)
    order = stream(SEED, "halves", name).permutation(len(dataset.objects))
    middle = len(order) // 2
    parts = [np.sort(part) for part in (order[:middle], order[middle:])]
    tables = [build_percept_table(_part(dataset, part)) for part in parts]
    path = LOGS / "tables" / f"{name}_halves_{SEED}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    save_percepts(joined(whole, parts, tables), path)
    return str(path)


def joined(
    whole: PerceptTable, parts: list[NDArray[np.int64]], tables: list[PerceptTable]
) -> PerceptTable:
    """Join the tables of parts of the objects into one of all, for the tasks of all.

    Objects of another part are no experience: their training counts are zero.
    """
    log_odds = np.full(whole.log_odds.shape, np.nan, np.float16)
    objects = len(whole.objects)
    bins = np.zeros((objects, *whole.training_bins.shape[1:]), np.uint8)
    for part, table in zip(parts, tables, strict=True):
        log_odds[part] = table.log_odds
        bins[np.ix_(part, part)] = table.training_bins[table.groups]
    return replace(whole, log_odds=log_odds, training_bins=bins, groups=np.arange(objects))


def _part(dataset: Dataset, part: NDArray[np.int64]) -> Dataset:
    return replace(
        dataset,
        objects=tuple(dataset.objects[o] for o in part),
        labels=dataset.labels[part],
        answers=None if dataset.answers is None else dataset.answers[part],
        features={context: values[part] for context, values in dataset.features.items()},
        partial=True,
    )


if __name__ == "__main__":
    main()
