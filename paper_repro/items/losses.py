"""Where the reward is lost: what more data, better plans and better sensors would bring."""

from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes import OfflineConfig, read_trials, run_offline
from meal_bayes.datasets import Dataset, PerceptTable, load_dataset, load_percepts, save_percepts
from meal_bayes.evaluation import Estimate, clustered, difference, estimate_mean
from meal_bayes.perception import build_percept_table
from meal_bayes.planners import Factored
from meal_bayes.seeds import stream
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.offline import AGAINST, run_agent
from paper_repro.statements import RECORDED

PANELS = tuple(
    (dataset, n, "values") for dataset in ("cy101", "roc36", "ispy32") for n in (1, 2, 3)
) + tuple((dataset, 2, "yes or no") for dataset in ("cy101", "roc36", "ispy32"))
OWN = "bayes"
TRIALS = 200
BOUNDED = 50  # of these trials the best plan is bounded
BARS = {
    "MORC": "the paper's agent",
    "half the objects": "our agent, taught by half of the objects",
    "ours": "our agent, taught by all but the one at hand",
    "and more data": "by as many objects as anybody likes, extrapolated",
    "and the best plan": "and the most that planning could add, in a model of Eq. 8",
    "perfect percepts": "of the cheapest behavior that senses",
}
NOTE = """The same tasks for every bar, recorded percepts. *Half the objects*: the objects are dealt
out into two halves; classifiers are taught anew by each half alone, and an object's percepts, and
all that is learned of them, come from its own. *More data*: what a result lacks is taken to fall as
1 / objects, so that as much is to be gained from all of the objects to objects without end as was
gained from half of them to all; the gain is paired, and no more than is left below perfect
percepts. *The best plan*: percepts are drawn from MORC's own tables, where an upper bound of the
optimum is certified (factored value iteration, undiscounted); bound less reward is the most that
any planner adds there, and is added to the bar before. A gap below 0 is luck, and counts as none:
{bounded} trials without one wrong report earn more than the bound, which expects some, and their
standard error knows of none. *Perfect percepts* are by construction: a first look that is never
wrong. What is left between the last two bars is for better sensors. Questions ask for the values of
one to three attributes, or whether two are both true; yes and no are guessed more easily, and of
them the best plan is not bounded. The sentence's ranges are those of the estimates, whose standard
errors stand in the table."""


class Gains(NamedTuple):
    """What would be gained in the reward of one kind of question.

    Attributes
    ----------
    data, plans, sensors : by objects without end, the best plan, and sensors that never err.
    """

    data: Estimate
    plans: Estimate
    sensors: Estimate


def run(setting: Setting) -> Result:
    """Run both agents, ours taught by half of the objects too, and bound the best plan."""
    trials = setting.trials_of(TRIALS, 6)
    reward = paper_values("offline_reward")
    rows: list[tuple[Cell, ...]] = []
    told: dict[str, list[float]] = {"more data": [], "better plans": [], "better sensors": []}
    panels = () if setting.as_published else setting.choose(PANELS, PANELS[3:4])
    tables = {name: table_by_halves(setting, name) for name in {dataset for dataset, *_ in panels}}
    for dataset, n, answer in panels:
        morc, half, ours = (
            run_agent(setting, RECORDED, place, n=n, agent=agent, trials=trials, answer=answer)
            for place, agent in ((dataset, AGAINST), (tables[dataset], OWN), (dataset, OWN))
        )
        ideal = reward - cheapest_percept(load_percepts(dataset))
        by_all = estimate_mean(ours, "reward")
        gap = Estimate(0, 0, 1)  # of yes or no the best plan is not bounded
        if answer == "values":
            gap = planning_gap(setting, dataset, n, trials)
        gains = split(by_all, difference(ours, half), gap, ideal)
        # Paired, as all three met the same tasks: more objects' gain is a difference of trials.
        measured = [estimate_mean(run, "reward") for run in (morc, half, ours)]
        rows.append((dataset, n, answer, *measured, difference(ours, half), *gains))
        for name, effect in zip(told, gains, strict=True):
            told[name].append(effect.estimate)
    ranges = [f"{name} ({min(v):.0f} to {max(v):.0f})" for name, v in told.items() if v]
    columns = (
        "data set",
        "attributes",
        "asks for",
        *list(BARS)[:3],
        "all less half, paired",
        "more data adds",
        "the best plan adds, at most",
        "left for sensors",
    )
    return Result(
        title="Where the reward is lost, on three data sets",
        sentence=f"What is short of the reward of {reward:g}: {', '.join(ranges)}."
        if rows
        else "It is not run here.",
        tables=(Table("reward", columns, tuple(rows)),) if rows else (),
        evidence={},
        size=f"{trials} trials a row.",
        notes=(NOTE.format(bounded=BOUNDED),),
        shows="; ".join(f"*{name}*: {text}" for name, text in BARS.items()) + ".",
    )


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


def planning_gap(setting: Setting, dataset: str, n: int, trials: int) -> Estimate:
    """Bound what planning could add to MORC's reward where its tables are the truth."""
    config = OfflineConfig(
        dataset,
        attributes=n,
        trials=min(trials, BOUNDED),
        agents=(AGAINST,),
        seed=setting.seed,
        percepts="model",
        reward=paper_values("offline_reward"),
    )
    done = run_offline(config, logs=setting.logs, jobs=setting.jobs)
    setting.spend(done.paths)
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


def table_by_halves(setting: Setting, name: str) -> str:
    """Write the percept table of a data set by halves, and return its path."""
    dataset = load_dataset(name)
    whole = load_percepts(name)
    order = stream(setting.seed, "halves", name).permutation(len(dataset.objects))
    middle = len(order) // 2
    parts = [np.sort(part) for part in (order[:middle], order[middle:])]
    tables = [build_percept_table(_part(dataset, part)) for part in parts]
    path = setting.logs / "tables" / f"{name}_halves_{setting.seed}.npz"
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
        features={context: values[part] for context, values in dataset.features.items()},
        partial=True,
    )
