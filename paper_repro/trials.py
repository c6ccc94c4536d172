"""Offline trials of an item as columns, as in the published code or on recorded percepts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes import OfflineConfig, run_offline
from meal_bayes.evaluation import Interval, clustered_se, paired_difference
from paper_repro import published
from paper_repro.frame import HERE, Cell, Estimate, Setting, Table, paper_values

AGAINST = "morc"  # the paper's agent, which others are compared with
MEASURES = ("success", "cost", "reward")
_CLASSIFIERS = {"roc36": "paper"}  # whose percept tables the published protocol draws from


def domain_path(name: str) -> str:
    """Return the path of a domain table of this folder."""
    return str(HERE / "domains" / f"{name}.toml")


@dataclass(frozen=True, slots=True)
class Columns:
    """Trials of one agent, one row a trial, in the order of the tasks.

    Attributes
    ----------
    success : (T,) Eq. 5.
    cost : (T,) Eq. 6, s.
    reward : (T,) undiscounted and unshaped.
    objects : (T,) positions in the data set.
    correct : (T,N) which of the queried attributes the report has right.
    abstained : (T,) whether the trial ended without a report.
    seconds : of computing, in all.
    """

    success: NDArray[np.float64]
    cost: NDArray[np.float64]
    reward: NDArray[np.float64]
    objects: NDArray[np.int64]
    correct: NDArray[np.bool_]
    abstained: NDArray[np.bool_]
    seconds: float = 0.0

    def __len__(self) -> int:
        return len(self.cost)

    def measure(self, name: str) -> NDArray[np.float64]:
        """Return the column of "success", "cost" or "reward"."""
        return {"success": self.success, "cost": self.cost, "reward": self.reward}[name]

    def mean(self, name: str) -> Estimate:
        """Estimate the mean of a measure; objects are clusters."""
        values = self.measure(name)
        return Estimate(float(values.mean()), clustered_se(values, self.objects))

    @property
    def cost_sd(self) -> float:
        """Standard deviation of the cost over trials, s."""
        return float(self.cost.std(ddof=1)) if len(self) > 1 else float("nan")


Runs = Mapping[str, Columns]  # by agent


def run_agent(
    setting: Setting,
    protocol: str,
    dataset: str,
    n: int,
    agent: str,
    trials: int,
    *,
    domain: str = "",
    perception: str = "",
    reward: float | None = None,
) -> Columns:
    """Run an agent's trials, or read those that the logs hold.

    Parameters
    ----------
    setting : seed, processes, logs.
    protocol : "published" or "recorded".
    dataset : roc36, ispy32 or cy101.
    n : attributes a query.
    agent, trials : who, and how many in all.
    domain : a domain or the path of its table, in place of the protocol's.
    perception : "default" or "paper", in place of the protocol's.
    reward : of a right report, in place of the paper's.
    """
    code = protocol == "published"
    theirs = code and not setting.quick
    if code and (dataset, agent) == ("roc36", "random"):
        domain = domain_path("roc36_every_action")  # where illegal actions cost their time
    config = OfflineConfig(
        domain or (f"{dataset}_published" if code else dataset),
        attributes=n,
        trials=trials,
        agents=(published.AGENTS.get(agent, agent) if code else agent,),
        seed=setting.seed,
        percepts="model" if code else "recorded",
        perception=perception or (_CLASSIFIERS.get(dataset, "default") if theirs else "default"),
        reward=paper_values("offline_reward") if reward is None else reward,
    )
    done = run_offline(
        config, logs=setting.logs, jobs=setting.jobs, cluster=setting.cluster,
        on_progress=setting.on_progress,
    )  # fmt: skip
    own = done.outcomes()
    return Columns(
        success=own.success.astype(float),
        cost=own.cost,
        reward=own.reward,
        objects=own.object_index,
        correct=own.report == own.truth,
        abstained=np.asarray((own.report < 0).all(axis=1)),
        seconds=sum(done.seconds.values()),
    )


def against(first: Columns, second: Columns, measure: str = "reward") -> Interval:
    """Estimate first - second on the tasks that both have; objects are clusters."""
    number = min(len(first), len(second))
    return paired_difference(
        first.measure(measure)[:number], second.measure(measure)[:number], first.objects[:number]
    )


def paired_table(columns: Mapping[str, Runs], agents: Sequence[str]) -> Table:
    """Compare agents with MORC on the same tasks, a column a run."""
    rows: list[tuple[Cell, ...]] = []
    for agent in agents:
        found = [against(runs[agent], runs[AGAINST]) for runs in columns.values()]
        rows.append((agent, *(Estimate(one.estimate, one.se) for one in found)))
    return Table(f"reward less that of {AGAINST}, paired", ("agent", *columns), tuple(rows))


def seconds_of(runs: Mapping[str, Runs]) -> float:
    """Sum the seconds of computing of some runs."""
    return sum(columns.seconds for run in runs.values() for columns in run.values())
