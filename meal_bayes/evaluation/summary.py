"""Trials to rows of measures, one row for each agent."""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Ints
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.calibration import (
    brier,
    calibrated_error,
    calibration_error,
    negative_log_likelihood,
)
from meal_bayes.evaluation.statistics import (
    ROUNDING,
    Estimate,
    Interval,
    Measures,
    clustered,
    paired_fractions,
)
from meal_bayes.look import AMOUNT, FRACTION, card, estimate_text, ordered_agents, reference_agent
from meal_bayes.trials import TrialOutcomes, Trials
from meal_bayes.trials.text import UNKNOWN

if TYPE_CHECKING:
    import pandas as pd

PRIOR = "prior"  # the agent that answers by base rates at once, for 0 s
_FRACTIONS = ("success", "abstained")  # measures of which trials have 0 or 1


class AnswerRates(NamedTuple):
    """Hit rate and false-alarm rate of an agent in yes-or-no questions.

    Attributes
    ----------
    hit_rate, false_alarm_rate : float
        Fraction of trials with the answer yes: among the trials in which yes is right, and among
        the trials in which yes is wrong. Abstaining does not count as yes. NaN if there are no such
        trials.
    yes : float
        Fraction of the trials with a known truth in which yes is right.
    """

    hit_rate: float
    false_alarm_rate: float
    yes: float


def answer_rates(trials: Trials) -> AnswerRates:
    """Compute the hit rate and false-alarm rate of trials with yes-or-no questions.

    Raises
    ------
    SettingsError
        Trials ask for the values of several attributes.
    """
    outcomes = TrialOutcomes.of(trials)
    if outcomes.attribute.shape[1] != 1:
        raise SettingsError(
            "Hit and false-alarm rates exist only for yes-or-no questions, but "
            "these questions ask for several values."
        )
    truth = outcomes.truth[outcomes.judged, 0]
    said_yes = outcomes.report[outcomes.judged, 0] == 1
    hit, alarm = (
        float(said_yes[truth == value].mean()) if (truth == value).any() else math.nan
        for value in (1, 0)
    )
    return AnswerRates(hit, alarm, float((truth == 1).mean()) if len(truth) else math.nan)


@dataclasses.dataclass(frozen=True, slots=True)
class SummaryRow(Measures):
    """Measures of one agent; NaN if undefined. Standard errors treat objects as clusters.

    NLL, Brier score and ECE are those of the final belief, over all queried attributes with a known
    truth. Trials with an unknown truth, and interrupted trials, count neither as right nor as
    wrong.
    """

    agent: str
    trials: int
    judged: int  # of these, how many ended with a truth that is known
    accuracy: float  # fraction of the judged whose report was right in every attribute (Eq. 5)
    accuracy_se: float
    accuracy_low: float  # 95 % interval, inside [0, 1]
    accuracy_high: float
    cost_s: float  # mean of Eq. 6, of trials that came to their end; so are all measures below
    cost_sd: float  # standard deviation over trials
    reward: float  # mean, unshaped, undiscounted
    reward_se: float
    nll: float  # nats
    brier: float
    ece: float
    ece_calibrated: float  # what a calibrated belief of the same values would show
    abstained: float  # fraction of trials that ended without a report; they count as not right
    answered_accuracy: float  # accuracy among the judged ones with a report
    seconds: float  # of computing


def accuracy_text(row: SummaryRow) -> str:
    """Return an agent's accuracy with its interval, or that no truth is known."""
    ends = (row.accuracy_low, row.accuracy_high)
    accuracy = Interval(row.accuracy, row.accuracy_se, *ends)
    return UNKNOWN if math.isnan(row.accuracy) else accuracy.text(FRACTION)


def reward_text(row: SummaryRow) -> str:
    """Return an agent's mean reward with its error, or that no truth is known."""
    return UNKNOWN if math.isnan(row.reward) else estimate_text(row.reward, row.reward_se)


class Summary(list[SummaryRow]):
    """A list with a row of measures for each agent, which is displayed as a table.

    The attribute `outcomes` contains the outcomes that are summarized.
    """

    def __init__(self, rows: Iterable[SummaryRow], outcomes: TrialOutcomes) -> None:
        super().__init__(rows)
        self.outcomes = outcomes

    def compare(self, first: str, second: str, *, measure: str = "reward") -> Interval:
        """Compare two agents of the summary; see `meal_bayes.compare`."""
        return compare(self.outcomes, first, second, measure=measure)

    def to_frame(self) -> "pd.DataFrame":
        """Return a pandas data frame with a row for each agent."""
        import pandas as pd  # noqa: PLC0415  takes half a second

        return pd.DataFrame(list(self), columns=[f.name for f in dataclasses.fields(SummaryRow)])

    def __repr__(self) -> str:
        """Return a line for each agent."""
        facts = {
            row.agent: f"accuracy {accuracy_text(row)}, cost {row.cost_s:{AMOUNT}} s, "
            f"reward {reward_text(row)}"
            for row in self
        }
        return card(f"Summary of {sum(row.trials for row in self)} trials", facts)


def summarize(trials: Trials, *, seconds: Mapping[str, float] | None = None) -> Summary:
    """Summarize trials in one row for each agent, in the order of the agents' first trials.

    Parameters
    ----------
    trials : Trials
        Trials of one data set. Standard errors treat all trials of one object, known by its name,
        as a cluster.
    seconds : Mapping[str, float] | None
        Computing time of each agent in seconds. Trials do not contain it, but the result of an
        experiment does.

    Examples
    --------
    >>> import meal_bayes
    >>> trial = meal_bayes.ask(
    ... "heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", logs=None
    ... )
    >>> (row,) = meal_bayes.summarize([trial])
    >>> row.agent
    'greedy'
    """
    outcomes = TrialOutcomes.of(trials)
    times = seconds or getattr(trials, "seconds", {})
    names = outcomes.agents
    rows = (_row(name, outcomes.of_agent(name), times.get(name, math.nan)) for name in names)
    return Summary(rows, outcomes)


def estimate_mean(outcomes: TrialOutcomes, measure: str) -> Estimate:
    """Estimate the mean of a measure, with objects as clusters; NaN if no trial has the measure.

    The measure is "reward", "cost", "success" or "abstained". The intervals of the last two stay in
    [0, 1].
    """
    values = measured(outcomes, measure)
    fraction = measure in _FRACTIONS
    mask = ~np.isnan(values)
    if not mask.any():
        return Estimate(math.nan, math.nan, 0)
    return clustered(values[mask], outcomes.object_name[mask], fraction=fraction)


def compare(trials: Trials, first: str, second: str, *, measure: str = "reward") -> Interval:
    """Return the mean paired difference between two agents on the tasks that both worked on.

    Parameters
    ----------
    trials : Trials
        Trials that include both agents; trials of other agents are ignored.
    first, second : str
        Names of the two agents.
    measure : str
        Quantity to compare: "reward", "cost", "success" or "abstained".

    Returns
    -------
    Interval
        Mean measure of `first` minus mean measure of `second`, with the confidence interval. The
        unit is seconds for reward and cost, and a fraction of trials otherwise.

    Examples
    --------
    >>> import meal_bayes
    >>> trials = [
    ...     meal_bayes.ask("heavy", dataset="roc36", object=name, agent=agent, logs=None)
    ...     for name in meal_bayes.load_percepts("roc36").objects[:3]
    ...     for agent in ("greedy", "predefined_plus")
    ... ]
    >>> interval = meal_bayes.compare(trials, "greedy", "predefined_plus")
    >>> round(interval.estimate, 1)
    -3.2
    """
    outcomes = TrialOutcomes.of(trials)
    outcomes_of_first = outcomes.of_agent(first)
    outcomes_of_second = outcomes.of_agent(second)
    return difference(outcomes_of_first, outcomes_of_second, measure=measure).interval()


@dataclasses.dataclass(frozen=True, slots=True)
class Comparison(Measures):
    """Comparison of an agent with the reference agent, on the tasks of both.

    Attributes
    ----------
    agent, reference : str
        Names of the agent and of the reference agent.
    measure : str
        Quantity to compare: "reward", "cost", "success" or "abstained".
    tasks : int
        Number of tasks for which both agents have the measure.
    difference, low, high : float
        Mean of agent - reference in units of the measure, and the ends of its 95 % interval; NaN if
        the two agents share no task.
    verdict : str
        "ahead" or "behind" if the interval excludes 0, otherwise "cannot be said". Ahead means a
        lower cost, fewer abstentions, a higher reward or a higher accuracy.
    """

    agent: str
    reference: str
    measure: str
    tasks: int
    difference: float
    low: float
    high: float
    verdict: str

    def __str__(self) -> str:
        """Return the comparison as one sentence."""
        names = f"{self.agent} and {self.reference}"
        if not self.tasks:
            return f"{names} share no task, so that they cannot be compared."
        form = AMOUNT if self.measure in ("reward", "cost") else FRACTION
        span = Interval(self.difference, math.nan, self.low, self.high).text(form, signed=True)
        unit = " s" if self.measure == "cost" else ""
        if self.verdict == "cannot be said":
            return f"It cannot be said which of {names} is ahead: the difference is {span}{unit}."
        side = "ahead of" if self.verdict == "ahead" else "behind"
        return f"{self.agent} is {side} {self.reference}: the difference is {span}{unit}."


def comparisons(
    trials: Trials, *, measure: str = "reward", reference: str | None = None
) -> list[Comparison]:
    """Compare every agent with a reference agent by paired differences on the tasks of both.

    Parameters
    ----------
    trials : Trials
        Trials of two agents or more.
    measure : str
        Quantity to compare: "reward", "cost", "success" or "abstained".
    reference : str | None
        Agent with which the others are compared. By default it is the paper's agent; if that is
        absent, it is the first agent.

    Returns
    -------
    list[Comparison]
        A comparison for each other agent, in the order in which tables list agents.

    Raises
    ------
    SettingsError
        There are fewer than two agents, the reference or the measure is unknown, or an agent has a
        task twice.
    """
    outcomes = TrialOutcomes.of(trials)
    names = outcomes.agents
    reference = reference_agent(names) if reference is None and names else reference
    if len(names) < 2 or reference not in names:
        raise SettingsError(
            f"Found the agents {', '.join(names) or 'none'}; expected two or more, and the "
            f"reference {reference!r} among them; give the logs of each."
        )
    rows = []
    base = outcomes.of_agent(reference)
    for name in ordered_agents(names):
        if name == reference:
            continue
        other = outcomes.of_agent(name)
        first, second = paired_rows(other, base)
        gain = measured(other, measure)[first] - measured(base, measure)[second]
        tasks = int((~np.isnan(gain)).sum())
        if not tasks:
            nothing = (math.nan, math.nan, math.nan)
            rows.append(Comparison(name, reference, measure, 0, *nothing, "cannot be said"))
            continue
        estimate, _, low, high = difference(other, base, measure=measure).interval()
        more_is_worse = measure in ("cost", "abstained")
        verdict = "cannot be said"
        if low > ROUNDING or high < -ROUNDING:
            verdict = "ahead" if (low > 0) != more_is_worse else "behind"
        rows.append(Comparison(name, reference, measure, tasks, estimate, low, high, verdict))
    return rows


def difference(first: TrialOutcomes, second: TrialOutcomes, *, measure: str = "reward") -> Estimate:
    """Estimate the mean of first - second over the tasks of both agents; objects are clusters.

    Trials are paired by the keys of their tasks and sorted by these keys, so `difference(b, a)` is
    exactly -`difference(a, b)`. The measures are those of `estimate_mean`.

    Raises
    ------
    SettingsError
        There is no common task, one side has a task twice (as in tests after several batches), or
        the two sides give a task different objects or questions.
    """
    first_rows, second_rows = paired_rows(first, second)
    gain = measured(first, measure)[first_rows] - measured(second, measure)[second_rows]
    mask = ~np.isnan(gain)
    if not mask.any():
        raise SettingsError(
            f"{_named(first, second)} share no task with a {measure}; run both under the same seed."
        )
    objects = first.object_name[first_rows][mask]
    if measure in _FRACTIONS:
        return paired_fractions(gain[mask], partial(clustered, clusters=objects))
    return clustered(gain[mask], objects)


def no_better_than_prior(outcomes: TrialOutcomes) -> str:
    """Say which agents do not earn more than `prior`, which touches nothing; "" where all do.

    An agent earns more where the 95 % interval of its difference in reward, on the same tasks,
    lies above 0.
    """
    if PRIOR not in outcomes.agents:
        return ""
    level = []
    for agent in outcomes.agents:
        if agent == PRIOR:
            continue
        try:
            gain = compare(outcomes, agent, PRIOR)
        except SettingsError:  # no task in common, or none whose truth is known
            continue
        if not gain.low > 0:
            level.append(f"{agent} ({gain.text(signed=True)})")
    if not level:
        return ""
    return (
        f"The data do not show that these agents have a higher mean reward than {PRIOR}, which "
        f"answers without touching the object: {', '.join(level)}."
    )


def paired_rows(first: TrialOutcomes, second: TrialOutcomes) -> tuple[Ints, Ints]:
    """Return the rows of both, (M,) each, of the tasks that they share, by keys in order.

    Raises
    ------
    SettingsError
        Tasks that do not pair; see `difference`.
    """
    row_of_first = _row_of_task(first)
    row_of_second = _row_of_task(second)
    # In the order of keys, sums of (first - second) and of (second - first) differ in sign alone.
    shared = sorted(row_of_first.keys() & row_of_second.keys())
    first_rows = np.array([row_of_first[key] for key in shared], int)
    second_rows = np.array([row_of_second[key] for key in shared], int)
    for key, row, other in zip(shared, first_rows.tolist(), second_rows.tolist(), strict=True):
        tasks = [
            (outcomes.object_name[n], *filter(None, outcomes.attribute[n]))
            for outcomes, n in ((first, row), (second, other))
        ]
        if tasks[0] != tasks[1]:
            raise SettingsError(
                f"The task {key} is about {', '.join(tasks[0])} in one and about "
                f"{', '.join(tasks[1])} in the other of {_named(first, second)}; give trials of "
                "one run."
            )
    return first_rows, second_rows


def _row_of_task(outcomes: TrialOutcomes) -> dict[str, int]:
    """Return the row of every task by its key; each stands once."""
    rows = dict[str, int]()
    for row, key in enumerate(outcomes.key.tolist()):
        if rows.setdefault(key, row) != row:
            raise SettingsError(
                f"{_named(outcomes)} has the task {key} twice; give trials of one run, and of an "
                "online run the tests after one batch."
            )
    return rows


def _named(*parts: TrialOutcomes) -> str:
    names = dict.fromkeys(name for part in parts for name in part.agents)
    return " and ".join(map(repr, names)) or "They"


def _row(agent: str, outcomes: TrialOutcomes, seconds: float) -> SummaryRow:
    answered = outcomes.judged & outcomes.answered
    cost = outcomes.cost[outcomes.ended == ""]
    reward = estimate_mean(outcomes, "reward")
    accuracy = estimate_mean(outcomes, "success").interval()
    positive, truth = outcomes.beliefs()
    nll = math.nan
    squared = math.nan
    ece = math.nan
    calibrated = math.nan
    if len(truth):
        nll = float(negative_log_likelihood(positive, truth).mean())
        squared = float(brier(positive, truth).mean())
        ece = calibration_error(positive, truth)
        calibrated = calibrated_error(positive)
    return SummaryRow(
        agent=agent,
        trials=len(outcomes),
        judged=int(outcomes.judged.sum()),
        accuracy=accuracy.estimate,
        accuracy_se=accuracy.se,
        accuracy_low=accuracy.low,
        accuracy_high=accuracy.high,
        cost_s=float(cost.mean()) if len(cost) else math.nan,
        cost_sd=float(cost.std(ddof=1)) if len(cost) > 1 else math.nan,
        reward=reward.estimate,
        reward_se=reward.se,
        nll=nll,
        brier=squared,
        ece=ece,
        ece_calibrated=calibrated,
        abstained=estimate_mean(outcomes, "abstained").estimate,
        answered_accuracy=float(outcomes.success[answered].mean()) if answered.any() else math.nan,
        seconds=seconds,
    )


def measured(outcomes: TrialOutcomes, measure: str) -> NDArray[np.float64]:
    """Return a measure of each trial, (n,); NaN where it has none."""
    measures: dict[str, NDArray[Any]] = {
        "reward": outcomes.reward,
        "cost": outcomes.cost,
        "success": outcomes.success,
        "abstained": ~outcomes.answered,
    }
    if measure not in measures:
        raise SettingsError(f"Unknown measure {measure!r}; expected {', '.join(measures)}.")
    mask = outcomes.judged if measure == "success" else outcomes.ended == ""
    return np.where(mask, measures[measure].astype(float), np.nan)
