"""The entities of a whole run: accuracy and cost so far, the worst trials, the settings."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.evaluation.logged import worst_first
from meal_bayes.evaluation.statistics import MASS_TEXT, clustered, running_means
from meal_bayes.evaluation.summary import estimate_mean
from meal_bayes.look import (
    AMOUNT,
    BLACK,
    FRACTION,
    MID_GRAY,
    agent_style,
    estimate_text,
    rgba,
)
from meal_bayes.trials import TrialOutcomes
from meal_bayes.trials.text import UNKNOWN, outcome_facts
from meal_bayes.viewer.labels import plain_text
from meal_bayes.viewer.recorder import Recorder, Time

FACTS = "/run/facts"
TABLE = "/run/table"
ACCURACY = "/run/accuracy"
COST = "/run/cost"
_WORST = 10  # trials that are listed
_LONG = 300  # characters of a fact


class RunView:
    """The measures of a run, one row for each trial."""

    def __init__(self, recorder: Recorder, header: Mapping[str, object]) -> None:
        self._to = recorder
        self._outcomes: list[TrialOutcomes] = []
        self._times: list[Time] = []  # of each trial
        self._sent = 0  # trials whose measures were sent
        self._agents = set[str]()
        rows = ["|run||", "|---|---|"]
        for name, value in _flat(header).items():
            rows.append(f"|{plain_text(name)}|{plain_text(value)[:_LONG]}|")
        self._add_text(FACTS, rows)

    def add(self, outcomes: TrialOutcomes, times: Sequence[Time]) -> None:
        """Add trials that ended at these times."""
        self._outcomes.append(outcomes)
        self._times += times

    def flush(self) -> None:
        """Add the measures of the trials that are new, and the tables of all so far."""
        outcomes = TrialOutcomes.join(self._outcomes)
        self._outcomes = [outcomes]
        table = [
            f"|agent|trials|accuracy, {MASS_TEXT}|abstained|cost, s|reward|",
            "|---|---|---|---|---|---|",
        ]
        table += [self._add_agent(name, outcomes) for name in outcomes.agents]
        self._sent = len(outcomes)
        table += ["", "**the trials with the lowest reward**", ""]
        names = ("agent", "question", "object", "answer", "truth", "cost")
        table += [f"|trial|{'|'.join(names)}|", "|---" * 7 + "|"]
        for row in worst_first(outcomes)[:_WORST].tolist():
            facts = outcome_facts(outcomes, row)
            table.append(f"|{row}|{'|'.join(plain_text(facts[name]) for name in names)}|")
        self._add_text(TABLE, table)

    def _add_agent(self, name: str, outcomes: TrialOutcomes) -> str:
        """Add the measures of an agent's new trials, and return its row of the table."""
        rows = np.flatnonzero(outcomes.agent == name)
        outcomes = outcomes.rows(rows)
        label = plain_text(name or "agent")
        entity = rr.escape_entity_path_part(name or "agent")
        if name not in self._agents:
            self._agents.add(name)
            # The color that the agent has in every figure; black would not be seen on dark.
            color = agent_style(name).color
            seen = rgba(MID_GRAY if color == BLACK else color)
            style = rr.Measurements.from_fields(names=label, colors=seen, widths=2)
            for plot in (ACCURACY, COST):
                self._to.add_static(f"{plot}/{entity}", style)
        success = (outcomes.success == 1).astype(float)
        every = np.ones(len(rows), np.bool_)
        for plot, values, counted in (
            (COST, outcomes.cost, every),
            (ACCURACY, success, outcomes.judged),
        ):
            self._add_means(f"{plot}/{entity}", rows, values, outcomes.object_name, counted)
        # The same intervals and errors as in summaries and reports.
        accuracy = UNKNOWN
        reward = UNKNOWN
        if outcomes.judged.any():
            accuracy = estimate_mean(outcomes, "success").interval().text(FRACTION)
            reward = f"{outcomes.reward[outcomes.judged].mean():{AMOUNT}}"
        cost = clustered(outcomes.cost, outcomes.object_name)
        abstained = len(rows) - int(outcomes.answered.sum())
        spent = estimate_text(cost.estimate, cost.se)
        cells = (label, len(rows), accuracy, abstained, spent, reward)
        return f"|{'|'.join(map(str, cells))}|"

    def _add_means(
        self, entity: str, rows: Ints, values: Floats, objects: NDArray[Any], counted: Bools
    ) -> None:
        """Add the mean of the first 1, 2, ... values that count, for those trials not sent yet."""
        means, errors = running_means(values[counted], objects[counted])
        # Rounded, as a plot would show the noise of equal values; one object has no error yet.
        variances = np.nan_to_num(errors**2).round(9)
        for row, mean, variance in zip(rows[counted], means.round(9), variances, strict=True):
            if row >= self._sent:
                fields = {"values": [float(mean)], "variances": [float(variance)]}
                self._to.add(entity, rr.Measurements, self._times[row], **fields)

    def _add_text(self, entity: str, lines: Sequence[str]) -> None:
        text = rr.TextDocument.from_fields(text="\n".join(lines), media_type="text/markdown")
        self._to.add_static(entity, text)


def _flat(header: Mapping[str, object], before: str = "") -> dict[str, str]:
    """Return the header's entries by dotted names, as text."""
    flat = dict[str, str]()
    for name, value in header.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f"{before}{name}."))
        else:
            flat[f"{before}{name}"] = value if isinstance(value, str) else json.dumps(value)
    return flat
