"""The entities of a whole run: accuracy and cost so far, the learning curve, the worst trials."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import rerun as rr

from meal_bayes.agents.trial import Trial
from meal_bayes.momdp import MOMDP
from meal_bayes.trial_log.formatting import UNKNOWN, truth_text
from meal_bayes.viewer.labels import plain_text, question, report_text
from meal_bayes.viewer.palette import series_color
from meal_bayes.viewer.recorder import Recorder, Time, part

FACTS, TABLE = "/run/facts", "/run/table"
ACCURACY, COST, CURVE, EVIDENCE = "/run/accuracy", "/run/cost", "/run/learning", "/run/evidence"
_WINDOW = 50  # trials of the learning curve's moving mean
_WORST = 10  # trials that are listed
_LONG = 300  # characters of a fact
_EVERY = 25  # trials between two versions of the table


@dataclass
class _Tally:
    """Sums over the trials of one agent so far.

    Attributes
    ----------
    judged : number of trials whose truth is known.
    cost, squares : sums of the costs, s, and of their squares.
    recent : success of the last judged trials.
    """

    trials: int = 0
    judged: int = 0
    right: int = 0
    answered: int = 0
    cost: float = 0.0
    squares: float = 0.0
    reward: float = 0.0
    recent: list[bool] = field(default_factory=list)

    def add(self, trial: Trial) -> None:
        self.trials += 1
        self.answered += trial.report is not None
        self.cost += trial.cost
        self.squares += trial.cost**2
        if trial.success is not None:
            self.judged += 1
            self.right += trial.success
            self.reward += trial.reward
            self.recent = [*self.recent[1 - _WINDOW :], trial.success]

    @property
    def accuracy(self) -> tuple[float, float]:
        """Fraction of right answers, and its variance in the posterior under Beta(1, 1)."""
        a, n = self.right + 1, self.judged + 2
        return self.right / self.judged, a * (n - a) / (n**2 * (n + 1))

    @property
    def mean_cost(self) -> tuple[float, float]:
        """Mean cost, s, and the variance of the mean; 0 for a single trial."""
        n, mean = self.trials, self.cost / self.trials
        variance = max(self.squares / n - mean**2, 0.0) / max(n - 1, 1)
        return round(mean, 9), round(variance, 9)  # a plot would show the noise of equal costs


class RunView:
    """The measures of a run, one row a trial."""

    def __init__(self, recorder: Recorder, header: Mapping[str, object]) -> None:
        self._to = recorder
        self._tallies: dict[str, _Tally] = {}
        self._worst: list[tuple[float, str]] = []
        self._evidence: set[str] = set()
        self._momdp: MOMDP | None = None
        for entity in (FACTS, TABLE):
            recorder.add_static(entity, rr.TextDocument.from_fields(media_type="text/markdown"))
        self._header(header)

    @property
    def shows_evidence(self) -> bool:
        """Whether the log counts the percepts behind the confusion matrices."""
        return bool(self._evidence)

    def add(self, number: int, trial: Trial, time: Time) -> None:
        """Add a trial that ended at this time."""
        name = trial.agent or "agent"
        if name not in self._tallies:
            self._begin_agent(name)
        tally = self._tallies[name]
        tally.add(trial)
        measures = [(COST, tally.mean_cost)]
        if tally.judged:
            measures.append((ACCURACY, tally.accuracy))
            recent = sum(tally.recent) / len(tally.recent)
            self._to.add(f"{CURVE}/{part(name)}", rr.Scalars, time, scalars=[recent])
        for entity, (mean, variance) in measures:
            to = f"{entity}/{part(name)}"
            self._to.add(to, rr.Measurements, time, values=[mean], variances=[variance])
        self._count_evidence(trial, time)
        if trial.judged:
            self._note_worst(number, trial)
        if number % _EVERY == 0 or tally.trials <= _EVERY:
            self.write_table(time)

    def write_table(self, time: Time) -> None:
        """Write the table of the trials so far."""
        self._to.add(TABLE, rr.TextDocument, time, text=[self._table()])

    def close(self) -> None:
        """Write the table of the whole run, for all times."""
        self._to.add_static(TABLE, rr.TextDocument.from_fields(text=self._table()))

    def _begin_agent(self, name: str) -> None:
        color = series_color(len(self._tallies))
        self._tallies[name] = _Tally()
        for entity in (ACCURACY, COST):
            style = rr.Measurements.from_fields(names=plain_text(name), colors=color, widths=2)
            self._to.add_static(f"{entity}/{part(name)}", style)
        self._to.add_line(f"{CURVE}/{part(name)}", plain_text(name), color)

    def _header(self, header: Mapping[str, object]) -> None:
        rows = ["|run||", "|---|---|"]
        for name, value in _flat(header).items():
            text = plain_text(value)[:_LONG]
            rows.append(f"|{plain_text(name)}|{text}|")
            self._to.stream.send_property(name, rr.AnyValues(value=value[:_LONG]))
        self._to.add_static(FACTS, rr.TextDocument.from_fields(text="\n".join(rows)))

    def _count_evidence(self, trial: Trial, time: Time) -> None:
        """Add the percepts behind each behavior's matrices, mean over the queried attributes."""
        counts, momdp = trial.counts, trial.momdp
        if momdp is self._momdp or counts is None:
            return
        self._momdp = momdp
        for name, total in zip(momdp.behavior_names, counts.sum(axis=(2, 3)).mean(0), strict=True):
            entity = f"{EVIDENCE}/{part(name)}"
            if name not in self._evidence:
                color = series_color(len(self._evidence))
                self._evidence.add(name)
                self._to.add_line(entity, plain_text(name), color)
            self._to.add(entity, rr.Scalars, time, scalars=[float(total)])

    def _note_worst(self, number: int, trial: Trial) -> None:
        """Keep the trials with the lowest reward, of equal ones the most certain first."""
        truth = plain_text(truth_text(trial.task.query.attributes, trial.truth))
        row = (
            f"|{number}|{plain_text(trial.agent)}|{question(trial)}|{plain_text(trial.task.object_name)}"
            f"|{report_text(trial, trial.report)}|{truth}|{trial.cost:.1f}|{trial.reward:.1f}|"
        )
        self._worst.append((trial.reward - trial.last_belief.certainty, row))
        self._worst = sorted(self._worst)[:_WORST]

    def _table(self) -> str:
        rows = [
            "|agent|trials|accuracy|abstained|cost, s|reward|",
            "|---|---|---|---|---|---|",
        ]
        for name, tally in self._tallies.items():
            cost, cost_variance = tally.mean_cost
            accuracy = reward = UNKNOWN
            if tally.judged:
                mean, variance = tally.accuracy
                accuracy = f"{mean:.3f} ± {math.sqrt(variance):.3f}"
                reward = f"{tally.reward / tally.judged:.1f}"
            rows.append(
                f"|{plain_text(name)}|{tally.trials}|{accuracy}"
                f"|{tally.trials - tally.answered}|{cost:.1f} ± {math.sqrt(cost_variance):.1f}"
                f"|{reward}|"
            )
        rows += ["", "**the trials with the lowest reward**", ""]
        rows.append("|trial|agent|question|object|answer|truth|cost, s|reward|")
        rows.append("|---|---|---|---|---|---|---|---|")
        return "\n".join([*rows, *(row for _, row in self._worst)])


def _flat(header: Mapping[str, object], before: str = "") -> dict[str, str]:
    """Return the header's entries by dotted names, as text."""
    flat = dict[str, str]()
    for name, value in header.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f"{before}{name}."))
        else:
            flat[f"{before}{name}"] = value if isinstance(value, str) else json.dumps(value)
    return flat
