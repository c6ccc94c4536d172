"""Records of a trial: its task, its steps, what came of it."""

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce
from html import escape
from operator import add
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import FrozenArrays, label_values
from meal_bayes.display import (
    bar_html,
    best_options,
    facts_repr,
    listed,
    percent,
    short_repr,
    table_html,
)
from meal_bayes.domain import Query
from meal_bayes.domain.labels import one_value
from meal_bayes.errors import DataError, QueryError
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.planners import Decision
from meal_bayes.trials.percepts import percept_labels
from meal_bayes.untrusted import name_fault

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Task:
    """A query about an object.

    Attributes
    ----------
    name : str
        Of the task.
    query : Query
        What is asked.
    object_index : int
        In the data set; -1: an object of which nothing is recorded.
    object_name : str
        The object's name.
    key : tuple[str | int, ...]
        Names every random stream of the trial.
    learn : bool
        Whether it may become experience; else it is a test.
    """

    name: str
    query: Query
    object_index: int
    object_name: str
    key: tuple[str | int, ...]
    learn: bool = field(default=True, repr=False)

    def __post_init__(self) -> None:
        if fault := name_fault(self.object_name):
            raise QueryError(f"The object's name {self.object_name!a:.60} {fault}; rename it.")

    @property
    def question(self) -> str:
        """The question as it was asked, else the names of what is asked."""
        return self.name if self.name.endswith("?") else self.query.text


@dataclass(frozen=True, slots=True)
class Step:
    """One executed action.

    Attributes
    ----------
    x, next_x : int
        States before and after.
    decision : Decision
        The action and its values.
    observation : NDArray[np.int8] | None
        (N,) percept levels, None = "none".
    cost, reward : float
        Of this step, s; the true (unshaped) reward, nan where the truth is not known.
    belief : Belief
        After the step.
    warning : str
        Why sensor data of the robot were not used as a percept, or which limit brought the answer;
        empty: neither.
    """

    x: int
    decision: Decision
    next_x: int
    observation: NDArray[np.int8] | None
    cost: float
    reward: float
    belief: Belief
    warning: str = ""

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class Trial(FrozenArrays):
    """The paper's xi, with its beliefs and decisions.

    Attributes
    ----------
    task : Task
        What is asked, of which object.
    agent : str
        Name of the agent.
    momdp : MOMDP
        The decision problem.
    first_belief : Belief
        Before the first step.
    steps : tuple[Step, ...]
        In order.
    truth : NDArray[np.int8]
        (N,) 1 true, 0 false, -1 not known.
    report : NDArray[np.bool_] | None
        (N,), or of yes or no (1,) whether it is yes; None: the agent abstained.
    ended : str
        Why the trial was broken off, such as "robot error: ..."; empty: it was not.
    counts : NDArray[np.float64] | None
        (N,E,2,K) labeled percepts behind the rows of the MOMDP, where they are known.
    """

    task: Task
    agent: str
    momdp: MOMDP
    first_belief: Belief
    steps: tuple[Step, ...]
    truth: NDArray[np.int8]
    report: NDArray[np.bool_] | None
    ended: str = ""
    counts: NDArray[np.float64] | None = None

    __repr__ = facts_repr

    def _facts(self) -> tuple[str, dict[str, str]]:
        query = self.task.query
        report = "none"
        if self.report is not None:
            known = {True: "right", False: "wrong", None: "truth not known"}[self.success]
            report = f"{query.report_name(self.report)} ({known})"
        beliefs = [*zip(query.value_names, self.last_belief.positive, strict=True)]
        if self.probability is not None:
            beliefs.insert(0, ("yes", np.float64(self.probability)))
        actions = [self.momdp.action_name(step.decision.action) for step in self.steps]
        title = f"Trial of {self.agent or 'an agent'} with {self.task.object_name}: {query.text}"
        return title, {
            "report": report,
            "belief": ", ".join(f"{name} {percent(value)}" for name, value in beliefs),
            "steps": listed(actions, 12) or "none",
            "cost": f"{self.cost:.1f} s, reward "
            + ("unknown" if np.isnan(self.reward) else f"{self.reward:.1f}"),
            **({"warnings": listed(self.warnings, 3)} if self.warnings else {}),
        }

    def plot(self, *, dark: bool = False, narrow: bool = False) -> "Axes":
        """Draw the trial in one picture; see `meal_bayes.trials.strip.trial_strip`."""
        from meal_bayes.trials.strip import trial_strip  # noqa: PLC0415  matplotlib takes a second

        return trial_strip(self, dark=dark, narrow=narrow)

    def _repr_html_(self) -> str:
        """Return the picture, on light and on dark pages, and a table: a row a step."""
        names = self.task.query.value_names
        header = ("", "action", "s", "percept", *(f"Pr({name})" for name in names))
        rows = [("", "", "", "before", *map(bar_html, self.first_belief.positive))]
        for number, step in enumerate(self.steps, start=1):
            action = step.decision.action
            percept = ""
            if step.observation is not None:
                percept = ", ".join(percept_labels(self.momdp, action, step.observation))
            name = self.momdp.action_name(action)
            cells = (str(number), escape(name), f"{step.cost:.1f}", escape(percept))
            rows.append((*cells, *map(bar_html, step.belief.positive)))
        title, facts = self._facts()
        text = "; ".join(f"{escape(k)}: {escape(v)}" for k, v in facts.items() if k != "steps")
        picture = f"{self._picture_html(title)}<br>" if self.steps else ""
        return f"{picture}{table_html(title, header, rows)}<p>{text}</p>"

    def _picture_html(self, title: str) -> str:
        """Return the picture as HTML, which holds it; dark where the page's reader prefers that."""
        from meal_bayes.canvas import render  # noqa: PLC0415  as above

        light, dark = (
            "data:image/svg+xml;base64," + b64encode(render(self.plot(dark=dark), "svg")).decode()
            for dark in (False, True)
        )
        return (
            f'<picture><source media="(prefers-color-scheme: dark)" srcset="{dark}">'
            f'<img src="{light}" alt="{escape(title)}" style="width:100%;max-width:900px">'
            "</picture>"
        )

    def to_frame(self) -> Any:
        """Return a pandas data frame, a row a step; percepts are missing where none came.

        `value` is what the trial was expected to bring by the chosen action, `bonus` what exploring
        is paid on its way, `next_value` and `next_bonus` the same of the next best action; missing
        where nothing was compared. `gap` is missing where no upper bound is known.
        """
        import pandas as pd  # noqa: PLC0415  takes half a second

        rows = []
        names = self.task.query.attributes
        percepts = [f"percept_{name}" for name in names]
        for number, step in enumerate(self.steps, start=1):
            levels = [None] * len(names) if step.observation is None else step.observation.tolist()
            rows.append({
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
                "warning": step.warning,
            })  # fmt: skip
        return pd.DataFrame(rows).astype(dict.fromkeys(percepts, "Int8") if rows else {})

    @property
    def answer(self) -> dict[str, bool | str] | None:
        """The report by what was asked: of a group its value, of others True or False.

        None where the agent abstained, or the trial was broken off: `if trial.answer` would not
        tell "no" from nothing, as its values do.
        """
        if self.report is None:
            return None
        names = self.task.query.attributes
        values = dict[str, bool | str]()
        for name, places in self.task.query.questions:
            true = [names[place] for place in places if self.report[place]]
            if len(places) > 1:
                values[name] = true[0]
            else:
                values[name] = bool(true)
        return values

    @property
    def warnings(self) -> list[str]:
        """Warnings of the steps, each once."""
        return list(dict.fromkeys(step.warning for step in self.steps if step.warning))

    @property
    def judged(self) -> bool:
        """Whether success is known: the trial came to its end, and the right report is known."""
        return not self.ended and bool((self.task.query.report_truth(self.truth) >= 0).all())

    @property
    def success(self) -> bool | None:
        """Rst of Eq. 5: a report right in all attributes; None where that is not known."""
        if not self.judged:
            return None
        right = self.task.query.report_truth(self.truth)
        return self.report is not None and bool((self.report == right).all())

    @property
    def probability(self) -> float | None:
        """Pr(yes is right) when the trial ended, of a question of yes or no; None of values."""
        return self.momdp.reports.probability_now(self.last_belief.positive)

    @property
    def cost(self) -> float:
        """Cst of Eq. 6, s: the summed cost of the executed behaviors."""
        # In order: `sum` rounds otherwise from Python 3.12 on, and logs hold every bit.
        return reduce(add, (step.cost for step in self.steps), 0.0)

    @property
    def reward(self) -> float:
        """Undiscounted, unshaped return; nan where the truth of a report is not known."""
        return reduce(add, (step.reward for step in self.steps), 0.0)

    @property
    def last_belief(self) -> Belief:
        """The belief when the trial ended."""
        return self.steps[-1].belief if self.steps else self.first_belief


def truth_of(query: Query, truth: Mapping[str, bool] | ArrayLike | None) -> NDArray[np.int8]:
    """Return the truth of the queried attributes, (N,): 1 true, 0 false, -1 not known.

    Parameters
    ----------
    query : Query
        What is asked.
    truth : Mapping[str, bool] | ArrayLike | None
        By attribute, or (N,) in the query's order; None where nothing is known.

    Raises
    ------
    QueryError
        Another number of values, or one that is no label.
    """
    if truth is None:
        return np.full(len(query), -1, np.int8)
    asked = truth  # what is not asked plays no part
    if isinstance(truth, Mapping):
        asked = [truth.get(name) for name in query.attributes]  # type: ignore[assignment]  # None
    try:
        values = label_values(asked)
    except DataError as fault:
        raise QueryError(f"truth of {list(query.attributes)}: {fault}") from None
    if values.shape != (len(query),):
        raise QueryError(
            f"truth is {truth}; expected 1, 0 or -1 for each of {list(query.attributes)}, or "
            "{attribute: True or False}."
        )
    values = values.copy()
    for name, places in zip(query.group_names, map(list, query.groups), strict=True):
        members = [query.attributes[place] for place in places]
        values[places] = one_value(values[places], name, members)
    return values


def _value_columns(decision: Decision) -> dict[str, float | None]:
    """Return the values of the chosen and of the next best action of a decision."""
    chosen = min(decision.action, len(decision.values) - 1)
    others = best_options(decision.total, chosen, len(decision.values))
    others = [option for option in others if option != chosen]
    columns: dict[str, float | None] = {}
    for name, option in (("", chosen), ("next_", others[0] if others else None)):
        columns[f"{name}value"] = columns[f"{name}bonus"] = None
        if option is None or np.isnan(decision.values[option]):
            continue
        columns[f"{name}value"] = float(decision.values[option])
        if decision.bonus is not None:
            columns[f"{name}bonus"] = float(decision.bonus[option])
    return columns
