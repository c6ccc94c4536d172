"""A trial with its text, picture, HTML and data frame."""

from base64 import b64encode
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from meal_bayes.look import (
    AMOUNT,
    bar_html,
    best_options,
    facts_repr,
    listed,
    percent,
    table_html,
)
from meal_bayes.planners import Decision
from meal_bayes.trials.record import TrialRecord
from meal_bayes.trials.text import (
    believed,
    cost_text,
    percept_labels,
    together_text,
    verdict_text,
    verdict_word,
)

if TYPE_CHECKING:
    import pandas as pd

    from meal_bayes.canvas import Axes


@dataclass(frozen=True, slots=True, repr=False)
class Trial(TrialRecord):
    """A finished or interrupted trial: its question, steps, answer, cost and reward.

    `print` shows a trial as text, `plot` draws it, and a notebook shows it as HTML. The attributes
    that are read most often are `answer` (a dictionary, or None without an answer), `success`
    (whether the answer is right, or None if this is unknown), `certainty` or `probability`, `cost`
    (s), `reward` and `steps`; see `TrialRecord` for all of them.

    Examples
    --------
    >>> import meal_bayes
    >>> trial = meal_bayes.ask(
    ... "heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", logs=None
    ... )
    >>> trial.agent, trial.success
    ('greedy', True)
    >>> print(trial)
    heavy? heavy_green_beans, asked by greedy
      answer  heavy, >99.9 % sure, right
      cost    22.3 s, reward 477.7
    <BLANKLINE>
                 s     percept  Pr(heavy)
      before                    50.0 %
      look       0.5   no       46.8 %
      tap        4.2   yes      89.9 %
      reinit     10.0           89.9 %
      look       0.5   yes      91.0 %
      grasp      4.5   yes      96.1 %
      lift_slow  2.6   yes      >99.9 %
    """

    __repr__ = facts_repr

    def __str__(self) -> str:
        """Return the question, the answer, its probability, the cost, and a line for each step."""
        answer = verdict_text(self)
        if self.report is not None:
            answer = (
                f"{self.task.query.report_name(self.report)}, {percent(self.certainty)} sure, "
                f"{verdict_word(self.success)}"
            )
        beliefs = believed(self, self.first_belief)
        rows = [("", "s", "percept", *(f"Pr({name})" for name, _ in beliefs))]
        rows.append(("before", "", "", *(percent(value) for _, value in beliefs)))
        for step in self.steps:
            action = step.decision.action
            if action >= self.momdp.n_behaviors:
                continue
            percept = ""
            if step.observation is not None:
                percept = ", ".join(percept_labels(self.momdp, action, step.observation))
            values = [percent(value) for _, value in believed(self, step.belief)]
            rows.append((self.momdp.action_name(action), f"{step.cost:{AMOUNT}}", percept, *values))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        table = ["  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        head = [
            f"{self.task.question} {self.task.object_name}, asked by {self.agent or 'an agent'}",
            f"  answer  {answer}",
            f"  cost    {cost_text(self.cost, self.reward)}",
        ]
        return "\n".join([*head, "", *table])

    def _facts(self) -> tuple[str, dict[str, str]]:
        query = self.task.query
        report = "none"
        if self.report is not None:
            report = f"{query.report_name(self.report)} ({verdict_word(self.success)})"
        beliefs = believed(self, self.last_belief)
        together = together_text(self.momdp)
        actions = [self.momdp.action_name(step.decision.action) for step in self.steps]
        title = f"Trial of {self.agent or 'an agent'} with {self.task.object_name}: {query.text}"
        return title, {
            "report": report,
            "belief": ", ".join(f"{name} {percent(value)}" for name, value in beliefs),
            **({"together": together} if together else {}),
            "steps": listed(actions, 12) or "none",
            "cost": cost_text(self.cost, self.reward),
            **({"warnings": listed(self.warnings, 3)} if self.warnings else {}),
        }

    def plot(self, *, dark: bool = False, narrow: bool = False) -> "Axes":
        """Draw the whole trial as one picture; see `meal_bayes.trials.picture.trial_picture`."""
        from meal_bayes.trials.picture import trial_picture  # noqa: PLC0415  matplotlib takes a second

        return trial_picture(self, dark=dark, narrow=narrow)

    def _repr_html_(self) -> str:
        """Return the picture, on light and on dark pages, and a table: a row for each step."""
        before = believed(self, self.first_belief)
        header = ("", "action", "s", "percept", *(f"Pr({name})" for name, _ in before))
        rows = [("", "", "", "before", *(bar_html(p) for _, p in before))]
        for number, step in enumerate(self.steps, start=1):
            action = step.decision.action
            percept = ""
            if step.observation is not None:
                percept = ", ".join(percept_labels(self.momdp, action, step.observation))
            name = self.momdp.action_name(action)
            cells = (str(number), escape(name), f"{step.cost:{AMOUNT}}", escape(percept))
            rows.append((*cells, *(bar_html(p) for _, p in believed(self, step.belief))))
        title, facts = self._facts()
        text = "; ".join(f"{escape(k)}: {escape(v)}" for k, v in facts.items() if k != "steps")
        picture = f"{self._picture_html(title)}<br>" if self.steps else ""
        return f"{picture}{table_html(title, header, rows)}<p>{text}</p>"

    def _picture_html(self, title: str) -> str:
        """Return the picture as HTML, which holds it; dark where the page's reader prefers that."""
        from meal_bayes.look import render  # noqa: PLC0415  as above

        light, dark = (
            "data:image/svg+xml;base64," + b64encode(render(self.plot(dark=dark), "svg")).decode()
            for dark in (False, True)
        )
        return (
            f'<picture><source media="(prefers-color-scheme: dark)" srcset="{dark}">'
            f'<img src="{light}" alt="{escape(title)}" style="width:100%;max-width:900px">'
            "</picture>"
        )

    def to_frame(self) -> "pd.DataFrame":
        """Return a pandas data frame with a row for each step; entries without a percept are empty.

        `value` is the expected reward of the chosen action and `bonus` its exploration bonus;
        `next_value` and `next_bonus` are those of the next best action. These columns are empty if
        the agent did not compare actions, and `gap` (see `Decision`) is empty if no bound is known.
        For yes-or-no questions about several attributes, the column `probability` is Pr(yes) after
        the step.
        """
        import pandas as pd  # noqa: PLC0415  takes half a second

        rows = []
        names = self.task.query.attributes
        percepts = [f"percept_{name}" for name in names]
        for number, step in enumerate(self.steps, start=1):
            seen = [-1] * len(names) if step.observation is None else step.observation.tolist()
            levels = [None if level < 0 else level for level in seen]
            answer = self.momdp.reports.probability_now(step.belief)
            rows.append(
                {
                    "step": number,
                    "state": self.momdp.x_names[step.x],
                    "action": self.momdp.action_name(step.decision.action),
                    "next_state": self.momdp.x_names[step.next_x],
                    "cost_s": step.cost,
                    "reward": step.reward,
                    **_value_columns(step.decision),
                    "gap": step.decision.gap,
                    **dict(zip(percepts, levels, strict=True)),
                    **{f"belief_{n}": p for n, p in zip(names, step.belief.positive, strict=True)},
                    **({} if answer is None else {"probability": answer}),
                    "warning": step.warning,
                }
            )
        return pd.DataFrame(rows).astype(dict.fromkeys(percepts, "Int8") if rows else {})


def _value_columns(decision: Decision) -> dict[str, float | None]:
    """Return the values of the chosen and of the next best action of a decision."""
    chosen = min(decision.action, len(decision.values) - 1)
    alternatives = best_options(decision.total, chosen, len(decision.values))
    alternatives = [option for option in alternatives if option != chosen]
    columns: dict[str, float | None] = {}
    for name, option in (("", chosen), ("next_", alternatives[0] if alternatives else None)):
        columns[f"{name}value"] = columns[f"{name}bonus"] = None
        if option is None or np.isnan(decision.values[option]):
            continue
        columns[f"{name}value"] = float(decision.values[option])
        if decision.bonus is not None:
            columns[f"{name}bonus"] = float(decision.bonus[option])
    return columns
