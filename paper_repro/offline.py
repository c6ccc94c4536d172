"""Offline trials of an item: by the paper's own settings, or on recorded percepts."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from meal_bayes import OfflineConfig, read_trials, run_offline
from meal_bayes.agents import Agent
from meal_bayes.evaluation import difference
from meal_bayes.trials import TrialOutcomes
from meal_bayes.trials.outcomes import task_key
from paper_repro import agents
from paper_repro.frame import Cell, Setting, Table, paper_values
from paper_repro.statements import THEIRS

AGAINST = "morc"  # the paper's agent, which others are compared with
MEASURES = ("success", "cost", "reward")

Runs = Mapping[str, TrialOutcomes]  # by agent


def run_agent(
    setting: Setting,
    protocol: str,
    dataset: str,
    *,
    n: int,
    agent: str | Agent,
    trials: int,
    perception: str = "default",
    reward: float | None = None,
    answer: str = "values",
) -> TrialOutcomes:
    """Run an agent's trials, or read those that the logs hold.

    Parameters
    ----------
    setting : seed, processes, logs.
    protocol : "theirs" draws percepts from the matrices, others have recorded ones.
    dataset : a domain, or the path of a percept table.
    n : attributes a query.
    agent, trials : who, by name or an agent of one's own, and how many in all.
    perception : "default" or "paper".
    reward : of a right report, in place of the paper's.
    answer : what queries ask for, see `OfflineConfig`.
    """
    theirs = protocol == THEIRS
    # Names may be agents of ours: MORC that ends a trial otherwise, and where percepts are drawn
    # the published baselines, of which Random draws from illegal actions, too.
    named = agents.WAYS | (agents.AGENTS if theirs else {})
    chosen = named.get(agent, agent) if isinstance(agent, str) else agent
    config = OfflineConfig(
        dataset,
        attributes=n,
        trials=trials,
        agents=(chosen,),
        seed=setting.seed,
        percepts="model" if theirs else "recorded",
        perception=perception,
        reward=paper_values("offline_reward") if reward is None else reward,
        answer=answer,
        key=agents.key(),
    )
    done = run_offline(
        config, logs=setting.logs, jobs=setting.jobs, on_progress=setting.progress_in("trials")
    )
    setting.spend(done.paths)
    outcomes = done.outcomes()
    if agent == agents.DECLINES:
        return pay_for_declining(outcomes, done.paths)
    return outcomes


def pay_for_declining(outcomes: TrialOutcomes, paths: Iterable[Path]) -> TrialOutcomes:
    """Charge trials without a report for the cheapest illegal behavior, where they ended."""
    # In the log such a trial ends for nothing; the paper's MORC executes an illegal behavior.
    fees = {
        task_key(trial.task.key): float(agents.decline_costs(trial.momdp)[trial.steps[-1].x])
        for path in paths
        for trial in read_trials(path)
        if trial.report is None
    }
    fee = np.array([fees.get(key, 0.0) for key in outcomes.key.tolist()])
    return replace(outcomes, cost=outcomes.cost + fee, reward=outcomes.reward - fee)


def paired_table(
    runs: Mapping[str, Runs], agents: Sequence[str], *, against: str = AGAINST
) -> Table:
    """Compare agents with one of MORC's rows on the same tasks, a column a run."""
    rows: list[tuple[Cell, ...]] = []
    for agent in agents:
        pairs = [run for run in runs.values() if agent in run]
        rows.append((agent, *(difference(run[agent], run[against]) for run in pairs)))
    return Table(f"reward less that of {against}, paired", ("agent", *runs), tuple(rows))
