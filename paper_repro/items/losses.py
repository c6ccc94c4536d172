"""Where the reward is lost: what better sensors, more data and better plans would bring."""

from dataclasses import replace
from itertools import islice

import numpy as np

from meal_bayes import OfflineConfig, read_trials, run_offline
from meal_bayes.datasets import PerceptTable, load_percepts, save_percepts
from meal_bayes.evaluation import Effect, Interval, clustered, difference, mean_effect
from meal_bayes.planners import Factored
from paper_repro.figures import bars
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.offline import AGAINST, OWN, run_agent
from paper_repro.statements import RECORDED

PANELS = tuple((dataset, n) for dataset in ("cy101", "roc36", "ispy32") for n in (1, 2, 3))
TRIALS, BOUNDED = 200, 50  # of these trials the best plan is bounded
BARS = {
    "MORC": "the paper's agent",
    "ours": "our agent",
    "ours, true Θ": "and with the counts of the object at hand among its data",
    "and the best plan": "and the most that planning could add, in a model of Eq. 8",
    "perfect percepts": "of the cheapest behavior that senses",
}
NOTE = """The same tasks for every bar, recorded percepts. *True Θ*: our agent learns from the
other objects and from the object at hand as well (its percepts are counted in place of those of
another object with the same label): more data would bring no more than that, were objects alike.
*The best plan*: percepts are drawn from MORC's own tables, where an upper bound of the optimum is
certified (factored value iteration, undiscounted); bound less reward is the most that any planner
adds there, and is added to the bar before. A gap below 0 is luck, and counts as none: {bounded}
trials without one wrong report earn more than the bound, which expects some, and their standard
error knows of none. *Perfect percepts* are by construction: a first look that is never wrong. What
is left between the last two bars is for better sensors. The sentence's ranges are those of the
estimates, whose standard errors stand in the table."""


def run(setting: Setting) -> Result:
    """Run both agents, ours with the true Θ, and bound the best plan."""
    trials = setting.trials_of(TRIALS, 6)
    reward = paper_values("offline_reward")
    rows: list[tuple[Cell, ...]] = []
    groups: dict[str, list[Interval]] = {name: [] for name in BARS}
    told: dict[str, list[float]] = {"more data": [], "better plans": [], "better sensors": []}
    panels = () if setting.as_published else setting.choose(PANELS, PANELS[3:4])
    for dataset, n in panels:
        table = load_percepts(dataset)
        runs = {agent: run_agent(setting, RECORDED, dataset, n, agent, trials)
                for agent in (AGAINST, OWN)}  # fmt: skip
        informed = run_agent(setting, RECORDED, informed_table(setting, table), n, OWN, trials)
        gap, cheapest = planning_gap(setting, dataset, n, trials), cheapest_percept(table)
        ideal = reward - cheapest
        best = mean_effect(informed, "reward")
        planned = replace(best, estimate=best.estimate + max(gap.estimate, 0.0),
                          se=float(np.hypot(best.se, gap.se)))  # fmt: skip
        heights = (mean_effect(runs[AGAINST], "reward"), mean_effect(runs[OWN], "reward"), best,
                   planned, Effect(ideal, 0.0, 1))  # fmt: skip
        for name, height in zip(BARS, heights, strict=True):
            groups[name].append(height.interval())
        data = difference(informed, runs[OWN])
        sensors = replace(planned, estimate=ideal - planned.estimate)
        rows.append((dataset, n, *heights[:3], data, gap, sensors))
        for name, effect in zip(told, (data, gap, sensors), strict=True):
            told[name].append(max(effect.estimate, 0.0))
    figures = {}
    if rows:
        names = [f"{dataset.upper()}, {n}" for dataset, n in panels]
        figures[""] = bars(groups, names, y_label="reward")
    ranges = [f"{name} ({min(v):.0f} to {max(v):.0f})" for name, v in told.items() if v]
    columns = ("data set", "attributes", *list(BARS)[:3], "true Θ adds, paired",
               "the best plan adds, at most", "left for sensors")  # fmt: skip
    return Result(
        title="Where the reward is lost, on three data sets with 1, 2 and 3 attributes",
        sentence=f"What is short of the reward of {reward:g}: {', '.join(ranges)}."
        if rows else "It is not run here.",
        tables=(Table("reward", columns, tuple(rows)),) if rows else (),
        evidence={},
        size=f"{trials} trials a row.",
        notes=(NOTE.format(bounded=BOUNDED),),
        figures=figures,
        shows="; ".join(f"*{name}*: {text}" for name, text in BARS.items()) + ".",
    )  # fmt: skip


def informed_table(setting: Setting, table: PerceptTable) -> str:
    """Write a table in which an object's own percepts are among what is learned without it."""
    bins, labels = table.training_bins.copy(), table.labels
    fine = table.levels_of(table.log_odds, bins.shape[-1])  # (O,R,E,P)
    known = ~np.isnan(table.log_odds)
    counts = np.stack([((fine == b) & known).sum(axis=1) for b in range(bins.shape[-1])], axis=-1)
    for o, p in np.ndindex(labels.shape):
        group = table.groups[o]
        alike = np.flatnonzero((labels[:, p] == labels[o, p]) & (table.groups != group))
        if len(alike) and labels[o, p] >= 0:
            bins[group, alike[o % len(alike)], p] = counts[o, :, p]
    path = setting.logs / "tables" / f"{table.domain.name}_informed.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    save_percepts(replace(table, training_bins=bins), path)
    return str(path)


def planning_gap(setting: Setting, dataset: str, n: int, trials: int) -> Effect:
    """Bound what planning could add to MORC's reward where its tables are the truth."""
    config = OfflineConfig(
        dataset, attributes=n, trials=min(trials, BOUNDED), agents=(AGAINST,), seed=setting.seed,
        percepts="model", reward=paper_values("offline_reward"),
    )  # fmt: skip
    done = run_offline(config, logs=setting.logs, jobs=setting.jobs, cluster=setting.cluster)
    setting.spend(done.paths)
    bounds: dict[tuple[object, ...], float] = {}
    rewards, tops, objects = [], [], []
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
