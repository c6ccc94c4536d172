"""Find one of several objects: ask about one after another, the most probable first."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import Any

from meal_bayes.domain import Domain, Payoffs, Query, read_question
from meal_bayes.domain.event import wrong_reward
from meal_bayes.domain.words import doubled, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.learner.question import NO_CLASSIFIERS, NO_TABLE, checked_robot
from meal_bayes.learner.settings import LearnerSettings, check_object_names
from meal_bayes.look import AMOUNT, facts_repr, listed, percent
from meal_bayes.momdp import initial_belief
from meal_bayes.momdp.model import MOMDP
from meal_bayes.robots import Robot
from meal_bayes.trials import Trial


@dataclass(frozen=True, slots=True)
class Found:
    """Result of `Learner.find`: the object that was found, if any, and the trials.

    Attributes
    ----------
    object_name : str | None
        Name of the object for which the answer was yes; None if there was no such answer.
    trials : Mapping[str, Trial]
        Trial of each object about which the agent asked, in the order of the trials.
    """

    object_name: str | None
    trials: Mapping[str, Trial]

    __repr__ = facts_repr

    def _facts(self) -> tuple[str, dict[str, str]]:
        return f"Found {self.object_name or 'none of them'}", {
            "probability": percent(self.probability),
            "asked about": listed(list(self.trials)),
            "cost": f"{self.cost:{AMOUNT}} s",
        }

    @property
    def probability(self) -> float:
        """Probability that the object fits, or that none of the objects of the trials fits."""
        yes = {name: trial.probability or 0.0 for name, trial in self.trials.items()}
        if self.object_name is not None:
            return yes[self.object_name]
        return prod(1.0 - p for p in yes.values())

    @property
    def cost(self) -> float:
        """Cost of all trials, s."""
        return sum(trial.cost for trial in self.trials.values())

    @property
    def success(self) -> bool | None:
        """Whether the result is right; None if the truth is unknown."""
        trials = [self.trials[self.object_name]] if self.object_name else [*self.trials.values()]
        right = [trial.success for trial in trials]
        if self.object_name is None and False in right:
            return False
        return None if None in right else all(right)


def read_claim(
    question: str | Sequence[str] | Query,
    domain: Domain,
    payoffs: Sequence[float] | None,
    settings: LearnerSettings,
) -> Query:
    """Read a yes-or-no question, in which by default the answer no has a reward of 0.

    A right and a wrong yes have the rewards of other questions. After the answer no, the search
    only continues with the next object.
    """
    query = (
        question if isinstance(question, Query) else read_question(question, domain, "yes or no")
    )
    if payoffs is None and query.payoffs is None:
        usual = settings.payoffs or domain.payoffs
        reward = settings.reward_in(domain)
        yes = usual[:2] if usual else (reward, wrong_reward(reward))
        payoffs = (*yes, 0.0, 0.0)
    return query if payoffs is None else replace(query, payoffs=Payoffs.of(payoffs))


def checked_objects(
    objects: Any, known: Iterable[str], *, replayed: bool
) -> dict[str, Robot | None]:
    """Return the robot of each object by the object's name; None if the object is replayed.

    Raises
    ------
    SettingsError
        If these are no objects, an object is given twice, or a robot is missing or is none.
    QueryError
        If a name is not valid, or looks like another of them or a `known` one.
    """
    if isinstance(objects, str) or not isinstance(objects, Mapping | Sequence) or not objects:
        raise SettingsError(
            f"objects is {objects!r:.60}; give names of recorded objects, or {{name: robot}}."
        )
    check_object_names(objects, known)
    if fault := doubled("object", list(objects)):
        raise SettingsError(fault)
    robots = dict(objects) if isinstance(objects, Mapping) else dict.fromkeys(objects)
    for robot in robots.values():
        if (checked_robot(robot) is None) != replayed:
            raise SettingsError(NO_TABLE if robot is None else NO_CLASSIFIERS)
    return robots


def truth_of(truth: Any, robots: Mapping[str, Any], domain: Domain) -> dict[str, Any]:
    """Return the known truth of each object, after checking all names before a robot moves."""
    if truth is None:
        return {}
    if not isinstance(truth, Mapping):
        raise SettingsError(
            f"truth is {truth!r:.60}; give {{object: {{attribute: True or False}}}}."
        )
    for name, values in truth.items():
        if name not in robots:
            raise SettingsError(unknown("object", name, [*robots]))
        if isinstance(values, Mapping):
            domain.labels(values)
    return dict(truth)


def prior_of_yes(momdp: MOMDP) -> float:
    """Compute Pr(yes) before the first behavior."""
    belief = initial_belief(momdp)
    reports = momdp.reports
    one = reports.event is None  # one attribute, of which yes and no earn the same
    return float(belief.positive[0] if one else reports.probability(belief))
