"""The entities of a whole run: accuracy and cost so far, the worst trials, the settings."""

import json
from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from meal_bayes.trials import TrialOutcomes
from meal_bayes.trials.text import UNKNOWN, outcome_facts
from meal_bayes.viewer.labels import plain_text
from meal_bayes.viewer.palette import series_color
from meal_bayes.viewer.recorder import Recorder, Time

FACTS, TABLE = "/run/facts", "/run/table"
ACCURACY, COST = "/run/accuracy", "/run/cost"
_WORST = 10  # trials that are listed
_LONG = 300  # characters of a fact


class RunView:
    """The measures of a run, one row a trial."""

    def __init__(self, recorder: Recorder, header: Mapping[str, object]) -> None:
        self._to = recorder
        self._outcomes: list[TrialOutcomes] = []
        self._times: list[Time] = []  # of each trial
        self._sent = 0  # trials whose measures were sent
        self._agents: dict[str, int] = {}
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
        table = ["|agent|trials|accuracy|abstained|cost, s|reward|", "|---|---|---|---|---|---|"]
        table += [self._add_agent(name, outcomes) for name in outcomes.agents]
        self._sent = len(outcomes)
        table += ["", "**the trials with the lowest reward**", ""]
        names = ("agent", "question", "object", "answer", "truth", "cost")
        table += [f"|trial|{'|'.join(names)}|", "|---" * 7 + "|"]
        # Of equal rewards the surest first, then the earliest.
        order = np.argsort(outcomes.reward - outcomes.certainty, kind="stable")
        for row in order[outcomes.judged[order]][:_WORST]:
            facts = outcome_facts(outcomes, row)
            table.append(f"|{row}|{'|'.join(plain_text(facts[name]) for name in names)}|")
        self._add_text(TABLE, table)

    def _add_agent(self, name: str, outcomes: TrialOutcomes) -> str:
        """Add the measures of an agent's new trials, and return its row of the table."""
        rows = np.flatnonzero(outcomes.agent == name)
        outcomes = outcomes.rows(rows)
        shown = plain_text(name or "agent")
        entity = rr.escape_entity_path_part(name or "agent")
        if name not in self._agents:
            color = series_color(self._agents.setdefault(name, len(self._agents)))
            style = rr.Measurements.from_fields(names=shown, colors=color, widths=2)
            for plot in (ACCURACY, COST):
                self._to.add_static(f"{plot}/{entity}", style)
        trials, judged = np.arange(1, len(rows) + 1), np.cumsum(outcomes.judged)
        right = np.cumsum(outcomes.success == 1)
        # Variances: of the posterior under Beta(1, 1), and of the mean of the costs.
        a, n = right + 1, judged + 2
        accuracy, accuracy_variance = right / np.maximum(judged, 1), a * (n - a) / (n**2 * (n + 1))
        cost = np.cumsum(outcomes.cost) / trials
        spread = np.maximum(np.cumsum(outcomes.cost**2) / trials - cost**2, 0.0)
        cost_variance = spread / np.maximum(trials - 1, 1)
        # Costs are rounded, as a plot would show the noise of equal ones.
        for plot, counted, means, variances in (
            (COST, trials, cost.round(9), cost_variance.round(9)),
            (ACCURACY, judged, accuracy, accuracy_variance),
        ):
            for i in np.flatnonzero((rows >= self._sent) & (counted > 0)):
                fields = {"values": [float(means[i])], "variances": [float(variances[i])]}
                self._to.add(f"{plot}/{entity}", rr.Measurements, self._times[rows[i]], **fields)
        known = (
            f"{accuracy[-1]:.3f} ± {np.sqrt(accuracy_variance[-1]):.3f}" if judged[-1] else UNKNOWN
        )
        reward = f"{outcomes.reward[outcomes.judged].mean():.1f}" if judged[-1] else UNKNOWN
        abstained = len(rows) - int(outcomes.answered.sum())
        return (
            f"|{shown}|{len(rows)}|{known}|{abstained}"
            f"|{cost[-1]:.1f} ± {np.sqrt(cost_variance[-1]):.1f}|{reward}|"
        )

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
