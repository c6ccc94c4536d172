"""Trials to rows of measures, one row an agent."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from html import escape
from typing import Any

import numpy as np

from meal_bayes.agents.trial import Trial
from meal_bayes.display import card, table_html
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.calibration import (
    brier,
    calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
)
from meal_bayes.evaluation.statistics import Interval, clustered_se, paired_difference, plain
from meal_bayes.seeds import stream


@dataclasses.dataclass(frozen=True, slots=True)
class SummaryRow:
    """Measures of one agent; nan where undefined. Standard errors are clustered by object.

    NLL, Brier and ECE are of the final belief, over trials x queried attributes whose truth is
    known. What is not known, or was broken off, counts neither as right nor as wrong.
    """

    agent: str
    trials: int
    judged: int  # of these, how many ended with a truth that is known
    accuracy: float  # share of the judged whose report was right in every attribute (Eq. 5)
    accuracy_se: float
    cost_s: float  # mean of Eq. 6
    cost_sd: float  # standard deviation over trials
    reward: float  # mean, unshaped, undiscounted
    reward_se: float
    nll: float  # nats
    brier: float
    ece: float
    ece_calibrated: float  # what a calibrated belief of the same values would show
    abstained: float  # share of trials that ended without a report; they count as not right
    answered_accuracy: float  # accuracy among the judged ones with a report
    seconds: float  # of computing

    def as_dict(self) -> dict[str, str | int | float | None]:
        """Give the measures by name, None for nan, as JSON wants it."""
        return plain(dataclasses.asdict(self))


class Summary(list[SummaryRow]):
    """Rows of measures, one an agent; a list that shows itself as a table."""

    def to_frame(self) -> Any:
        """Return a pandas data frame, a row an agent."""
        import pandas as pd  # noqa: PLC0415  takes half a second

        names = [field.name for field in dataclasses.fields(SummaryRow)]
        return pd.DataFrame([dataclasses.asdict(row) for row in self], columns=names)

    def __repr__(self) -> str:
        """Return a line an agent."""
        facts = {
            row.agent: f"accuracy {row.accuracy:.3f} ± {row.accuracy_se:.3f}, "
            f"cost {row.cost_s:.1f} s, reward {row.reward:.1f} ± {row.reward_se:.1f}"
            for row in self
        }
        return card(f"Summary of {sum(row.trials for row in self)} trials", facts)

    def _repr_html_(self) -> str:
        header = ("agent", "trials", "accuracy", "cost, s", "reward", "NLL", "ECE")
        rows = [
            (
                escape(row.agent), str(row.trials), f"{row.accuracy:.3f} ± {row.accuracy_se:.3f}",
                f"{row.cost_s:.1f}", f"{row.reward:.1f} ± {row.reward_se:.1f}", f"{row.nll:.3f}",
                f"{row.ece:.3f}",
            )
            for row in self
        ]  # fmt: skip
        return table_html("Summary", header, rows)


def summarize(trials: Iterable[Trial], *, seconds: Mapping[str, float] | None = None) -> Summary:
    """Summarize trials, one row an agent in the order of their first trials.

    Parameters
    ----------
    trials : of one data set, as objects' names are the clusters.
    seconds : computing time by agent; trials do not hold wall-clock times.
    """
    by_agent: dict[str, list[Trial]] = {}
    for trial in trials:
        by_agent.setdefault(trial.agent, []).append(trial)
    times = seconds or {}
    return Summary(_row(agent, own, times.get(agent, math.nan)) for agent, own in by_agent.items())


def _row(agent: str, trials: list[Trial], seconds: float) -> SummaryRow:
    whole = [trial for trial in trials if not trial.ended]
    judged = [trial for trial in whole if trial.judged]
    paid = [trial for trial in whole if not math.isnan(trial.reward)]
    answered = [trial for trial in judged if trial.report is not None]
    cost = np.array([trial.cost for trial in trials])
    positive = np.concatenate([trial.last_belief.positive for trial in trials])
    truth = np.concatenate([trial.truth for trial in trials])
    positive, known = positive[truth >= 0], truth[truth >= 0] == 1
    none = not len(known)
    return SummaryRow(
        agent=agent,
        trials=len(trials),
        judged=len(judged),
        accuracy=_mean(bool(trial.success) for trial in judged),
        accuracy_se=_clustered(judged, lambda trial: float(bool(trial.success))),
        cost_s=float(cost.mean()),
        cost_sd=float(cost.std(ddof=1)) if len(trials) > 1 else math.nan,
        reward=_mean(trial.reward for trial in paid),
        reward_se=_clustered(paid, lambda trial: trial.reward),
        nll=math.nan if none else float(negative_log_likelihood(positive, known).mean()),
        brier=math.nan if none else float(brier(positive, known).mean()),
        ece=math.nan if none else calibration_error(positive, known),
        ece_calibrated=math.nan
        if none
        else expected_calibration_error(positive, stream(0, "calibrated belief")),
        abstained=_mean(trial.report is None for trial in whole),
        answered_accuracy=_mean(bool(trial.success) for trial in answered),
        seconds=seconds,
    )


def _mean(values: Iterable[float]) -> float:
    found = list(values)
    return float(np.mean(found)) if found else math.nan


def _clustered(trials: list[Trial], measure: Callable[[Trial], float]) -> float:
    if not trials:
        return math.nan
    objects = [trial.task.object_name for trial in trials]
    return clustered_se([measure(trial) for trial in trials], objects)


def compare(
    trials: Iterable[Trial], first: str, second: str, *, measure: str = "reward"
) -> Interval:
    """Compare two agents on the tasks they share: mean of first - second, clustered by object.

    Parameters
    ----------
    trials : of both agents, paired by the keys of their tasks.
    first, second : the agents' names.
    measure : "reward", "cost" or "success".
    """
    if measure not in ("reward", "cost", "success"):
        raise SettingsError(f"Unknown measure {measure!r}; expected reward, cost or success.")
    values: dict[str, dict[tuple[Any, ...], float]] = {first: {}, second: {}}
    clusters: dict[tuple[Any, ...], str] = {}
    for trial in trials:
        if trial.agent in values and (trial.judged or measure == "cost"):
            values[trial.agent][trial.task.key] = float(getattr(trial, measure))
            clusters[trial.task.key] = trial.task.object_name
    keys = [key for key in values[first] if key in values[second]]
    if not keys:
        raise SettingsError(
            f"Agents {first!r} and {second!r} share no task; run both under the same seed."
        )
    return paired_difference(
        [values[first][key] for key in keys],
        [values[second][key] for key in keys],
        [clusters[key] for key in keys],
    )
