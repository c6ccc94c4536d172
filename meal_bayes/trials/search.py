"""Which of several objects is it? A search turns from one to another, and claims one, or none.

Each object's steps are a trial of their own, so that all that shows trials shows them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, runtime_checkable

from meal_bayes.display import AMOUNT, facts_html, facts_repr, listed, percent
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.robots import Outcome
from meal_bayes.trials.text import LEFT, UNFINISHED, verdict_word
from meal_bayes.trials.trial import Trial


class SearchRules(NamedTuple):
    """What holds for a whole search.

    Attributes
    ----------
    start : str
        State of an object that is claimed before the robot turned to it.
    turn_cost : float
        s, of turning to an object.
    max_steps, max_cost : int, float | None
        Behaviors and s, after which the best answer is given.
    """

    start: str
    turn_cost: float = 0.0
    max_steps: int = MAX_STEPS
    max_cost: float | None = None


@runtime_checkable
class SearchingRobot(Protocol):
    """A robot with several objects around it."""

    def turn_to(self, name: str) -> str:
        """Turn to an object, and return the name of the observed state x.

        Where a search goes on after a restart, that may be the object in front: nothing moves then.
        """
        ...

    def execute(self, behavior: str) -> Outcome:
        """Execute the behavior of that name on the object in front."""
        ...


@dataclass(frozen=True, slots=True)
class Search:
    """A search: which objects it turned to, in order, what it claimed, and its cost.

    Attributes
    ----------
    question : str
        What an object was searched for.
    trials : Mapping[str, Trial]
        By object; without steps where it was not explored. The claimed one reports yes, others do
        not report.
    turns : tuple[str, ...]
        Objects in the order in which the robot turned to them.
    claim : str | None
        The object; None: none of them.
    none : float
        Reward of "none of them".
    turn_cost : float
        s, of turning to an object.
    ended : str
        Why the search was broken off, or that it is under way; empty: it gave its answer.
    states : tuple[str, ...]
        In which the robot found the object, of each turn.
    """

    question: str
    trials: Mapping[str, Trial]
    turns: tuple[str, ...]
    claim: str | None
    none: float = 0.0
    turn_cost: float = 0.0
    ended: str = ""
    states: tuple[str, ...] = ()

    __repr__ = facts_repr
    _repr_html_ = facts_html

    def _facts(self) -> tuple[str, dict[str, str]]:
        verdict = "" if self.success is None else f" ({verdict_word(self.success)})"
        steps = sum(len(trial.steps) for trial in self.trials.values())
        return f"Search for {self.question}", {
            "answer": self.answer + verdict,
            "objects": listed(list(self.trials)),
            "turns": listed(list(self.turns)) or "none",
            "cost": f"{self.cost:{AMOUNT}} s in {steps} steps",
        }

    @property
    def answered(self) -> bool:
        """Whether its log has an answer, or why there is none; else it may go on."""
        return self.ended != UNFINISHED

    @property
    def answer(self) -> str:
        """The object that is claimed, "none of them", or why there is no answer."""
        return f"none; {self.ended}" if self.ended else self.claim or "none of them"

    @property
    def cost(self) -> float:
        """Seconds of all behaviors, and of turning, which `SearchSession` plans with."""
        behaviors = sum(trial.cost for trial in self.trials.values())
        return behaviors + self.turn_cost * len(self.turns)

    @property
    def success(self) -> bool | None:
        """Whether the claim is right, or rightly none was; None where that is not known."""
        if self.ended:
            return None
        right_claims = {  # 1: yes, this object; 0: no; -1: not known
            name: int(trial.task.query.report_truth(trial.truth)[0])
            for name, trial in self.trials.items()
        }
        if self.claim is not None:
            return None if right_claims[self.claim] < 0 else right_claims[self.claim] == 1
        if 1 in right_claims.values():
            return False
        return None if -1 in right_claims.values() else True

    @property
    def reward(self) -> float:
        """Reward of the claim, or of none, less the cost; nan where the truth is not known."""
        earned = 0.0 if self.ended else self.none
        if self.claim is not None:
            earned = sum(step.reward for step in self.trials[self.claim].steps[-1:])
        return earned - self.cost


def search_facts(search: Search) -> dict[str, str]:
    """Return the question of a search, its answer, whether that is right, its turns and cost."""
    return {
        "question": search.question,
        "answer": search.answer,
        "verdict": "none" if search.ended else verdict_word(search.success),
        "turns": ", ".join(search.turns) or "none",
        "cost": f"{search.cost:{AMOUNT}} s",
    }


def as_left(trial: Trial) -> Trial:
    """Return an explored object's trial as people are shown it.

    One that ended without a report was left by the search; its agent did not abstain from anything.
    """
    if trial.report is not None or trial.ended or not trial.steps:
        return trial
    return replace(trial, ended=LEFT)


class Explored(NamedTuple):
    """An object of a search as text: its name, what was done with it, the seconds, Pr(yes)."""

    name: str
    behaviors: str
    seconds: str
    probability: str


EXPLORED = Explored("object", "explored by", "s", "Pr(yes)")  # heads of `explored_rows`


def explored_rows(search: Search) -> list[Explored]:
    """Return the objects of a search, as its tables show them."""
    rows = []
    for name, trial in search.trials.items():
        probability = float(trial.momdp.reports.probability(trial.last_belief))
        behaviors = [
            trial.momdp.action_name(step.decision.action)
            for step in trial.steps
            if step.decision.action < trial.momdp.n_behaviors
        ]
        executed = ", ".join(behaviors) or "nothing"
        rows.append(Explored(name, executed, f"{trial.cost:{AMOUNT}}", percent(probability)))
    return rows
