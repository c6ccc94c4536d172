"""Offline trials of an item, in the published code's protocol or on recorded percepts."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np
from frame import Cell, Estimate, Setting, Table

from meal_bayes import OfflineConfig, Trial, run_offline
from meal_bayes.evaluation import clustered_se, compare

AGAINST = "morc"  # the paper's agent, which others are compared with


@dataclass(frozen=True, slots=True)
class Trials:
    """Trials of several agents under one protocol, and the seconds of computing behind them."""

    trials: tuple[Trial, ...]
    seconds: float

    def __add__(self, other: "Trials") -> "Trials":
        """Join the trials of other agents."""
        return Trials(self.trials + other.trials, self.seconds + other.seconds)

    def of(self, agent: str) -> list[Trial]:
        """Give the trials of one agent."""
        return [trial for trial in self.trials if trial.agent == agent]

    def mean(self, agent: str, measure: str) -> Estimate:
        """Estimate "success", "cost" or "reward"; objects are clusters."""
        own = self.of(agent)
        values = [float(getattr(trial, measure)) for trial in own]
        clusters = [trial.task.object_index for trial in own]
        return Estimate(float(np.mean(values)), clustered_se(values, clusters))

    def sd_of_cost(self, agent: str) -> float:
        """Give the standard deviation of the cost over trials, s."""
        costs = [trial.cost for trial in self.of(agent)]
        return float(np.std(costs, ddof=1)) if len(costs) > 1 else nan

    def against(self, agent: str, other: str = AGAINST, measure: str = "reward") -> Estimate:
        """Estimate the paired difference of two agents, on the tasks that both have."""
        found = compare(self.trials, agent, other, measure=measure)
        return Estimate(found.estimate, found.se)


def run_agents(
    setting: Setting,
    protocol: str,
    dataset: str,
    n: int,
    agents: Sequence[str],
    trials: int,
    *,
    domain: str = "",
    perception: str = "",
) -> Trials:
    """Run what the logs do not hold yet.

    Parameters
    ----------
    setting : seed, processes, logs.
    protocol : "published" or "recorded".
    dataset : roc36, ispy32 or cy101.
    n : attributes a query.
    agents, trials : who, and how many each.
    domain : a domain table of one's own, in place of the protocol's.
    perception : "default" or "paper", in place of the protocol's.
    """
    published = protocol == "published"
    classifiers = "default"
    if published and not setting.quick:
        classifiers = setting.of("published", dataset)
    config = OfflineConfig(
        domain or (f"{dataset}_published" if published else dataset),
        attributes=n,
        trials=trials,
        agents=tuple(agents),
        seed=setting.seed,
        percepts="model" if published else "recorded",
        perception=perception or classifiers,
        reward=setting.of("reward", "offline"),
    )
    done = run_offline(
        config, logs=setting.logs, jobs=setting.jobs, on_progress=setting.on_progress
    )
    return Trials(tuple(done.trials()), sum(done.seconds.values()))


def paired_table(columns: dict[str, Trials], agents: Sequence[str]) -> Table:
    """Compare agents with MORC on the same tasks, a column a run."""
    rows: list[tuple[Cell, ...]] = []
    for agent in agents:
        cells = [run.against(agent) if run.of(agent) else None for run in columns.values()]
        rows.append((agent, *cells))
    return Table(f"reward less that of {AGAINST}, paired", ("agent", *columns), tuple(rows))
