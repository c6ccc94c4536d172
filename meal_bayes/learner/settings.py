"""How a learner learns, and checks of what it is given."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent
from meal_bayes.arrays import (
    ByValue,
    check_amount,
    check_kind,
    check_whole,
    check_yes_no,
    is_number,
    plain_fields,
)
from meal_bayes.datasets import Dataset, PerceptTable
from meal_bayes.domain import Domain, Payoffs, unknown
from meal_bayes.domain.words import twin
from meal_bayes.errors import DataError, QueryError, SettingsError
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.untrusted import LARGEST, name_fault

REFIT_EVERY = 0.2  # growth of the labeled instances after which all is learned anew, by default
_PERCEPTS = ("recorded", "model")


@dataclass(frozen=True, slots=True)
class LearnerSettings(ByValue):
    """How a learner learns, whoever its agent is; what `Learner` takes by name is said there.

    Attributes
    ----------
    payoffs : Payoffs | None
        What yes and no earn in questions that do not say it; the domain's by default.
    by_object : bool
        Cross-validate over objects, see `PerceptionSettings`.
    unit : float | None
        Labeled instances that make one unit of experience (Eq. 10); None: as many as every object
        met would have with as many recordings of a behavior as the one with the most.
    count_given : bool
        Recordings that were given are experience, beside those of trials.
    shaped_answers : bool
        An ITRS shapes the rewards of trials that explore nothing, too.
    drawn : NDArray[np.int8] | None
        (O,P) labels, by which percepts are drawn from the learned tables.
    """

    seed: int = 0
    reward: float = 100.0
    payoffs: Payoffs | None = None
    horizon: float | None = None
    refit_every: float | None = REFIT_EVERY
    learn_success: bool = True
    label_accuracy: float | None = None
    percepts: str = "recorded"
    classifier: object = None
    posterior: ConfusionPosterior | None = None
    by_object: bool = True
    unit: float | None = None
    count_given: bool = True
    shaped_answers: bool = False
    drawn: NDArray[np.int8] | None = None

    def __post_init__(self) -> None:
        plain_fields(self)
        check_whole("seed", self.seed)
        if self.percepts not in _PERCEPTS:
            raise SettingsError(unknown("percepts", str(self.percepts), _PERCEPTS))
        check_amount("reward", self.reward, LARGEST)
        horizon = self.horizon
        if horizon is not None and not (is_number(horizon) and 0 <= horizon < np.inf):
            raise SettingsError(
                f"horizon is {horizon!r:.60}; give a number of future questions, 0 or more, or "
                "None."
            )
        check_amount("refit_every", self.refit_every, np.inf, or_none=True)
        check_yes_no("learn_success", self.learn_success)
        accuracy = self.label_accuracy
        if accuracy is not None and not (is_number(accuracy) and 0.5 < accuracy <= 1.0):
            raise SettingsError(
                f"label_accuracy is {accuracy!r:.60}; give the probability that a label is right, "
                "above 0.5 and at most 1, or None."
            )
        object.__setattr__(self, "payoffs", checked_payoffs(self.payoffs))


def checked_payoffs(values: Sequence[float] | None) -> Payoffs | None:
    """Return four numbers as what yes and no earn; None where they are not given."""
    try:
        return None if values is None else Payoffs.of(values)
    except QueryError as fault:
        raise SettingsError(str(fault)) from None


def settings_of(
    settings: LearnerSettings | None, by_name: Mapping[str, Any], domain: Domain, agent: Agent
) -> LearnerSettings:
    """Return how a learner learns: as one value says, or as settings by name do; not as both.

    Raises
    ------
    SettingsError
        There are both, or the value is of another kind.
    """
    if settings is None:
        reward = domain.report_reward if by_name["reward"] is None else by_name["reward"]
        settings = LearnerSettings(**{**by_name, "reward": reward})
    else:
        check_kind("settings", settings, LearnerSettings)
        defaults = {field.name: field.default for field in fields(LearnerSettings)}
        defaults["reward"] = None  # by name: the domain's
        changed = [name for name, value in by_name.items() if not _same(value, defaults[name])]
        if changed:
            raise SettingsError(
                f"Learner() has settings, and {' and '.join(changed)} by name; give all in one "
                f"value: dataclasses.replace(settings, {changed[0]}=...)."
            )
    return replace(settings, posterior=own_posterior(settings.posterior, domain, agent))


def _same(value: object, default: object) -> bool:
    return value is default or (default is not None and value == default)


def own_posterior(posterior: object, domain: Domain, agent: Agent) -> ConfusionPosterior | None:
    """Return a posterior of one's own, laid out for a domain; None where none is given."""
    if posterior is None:
        return None
    if not isinstance(posterior, ConfusionPosterior):
        from meal_bayes.posterior.idata import posterior_from  # noqa: PLC0415  loads xarray

        posterior = posterior_from(posterior, domain)
    shape = posterior.counts.shape
    expected = (len(domain.attributes), len(domain.behaviors), 2, agent.levels)
    if shape != expected:
        raise SettingsError(
            f"The posterior has shape {shape}, expected {expected}: attributes and behaviors of "
            f"the domain, truths, and the {agent.levels} levels of the agent {agent.name!r}."
        )
    return posterior


def check_object_name(name: object, objects: Iterable[str]) -> None:
    """Check what names an object, beside those that are known.

    Raises
    ------
    SettingsError
        What is no text.
    QueryError
        No name, or one that looks the same as another: what is told of one would not be of both.
    """
    if not isinstance(name, str):
        raise SettingsError(f"An object's name is a text; found {name!r:.60}.")
    if fault := name_fault(name):
        raise QueryError(f"The object's name {name!a:.60} {fault}; rename it.")
    names = [*objects]
    if name not in names and twin(name, names):
        raise QueryError(unknown("object", name, names))


def check_data(data: object, domain: Domain) -> None:
    """Check that data are recordings or a percept table of a domain's attributes and behaviors."""
    if not isinstance(data, Dataset | PerceptTable):
        raise SettingsError(
            f"fit() takes a Dataset or a PerceptTable; found {type(data).__name__}."
        )
    source = data.domain
    if (source.attributes, source.behaviors) != (domain.attributes, domain.behaviors):
        raise SettingsError(
            f"Attributes or behaviors of the data's domain {source.name!r} differ from those of "
            f"{domain.name!r}; load the data for this domain."
        )


def checked_labels(values: Mapping[str, bool | None], domain: Domain) -> NDArray[np.int8]:
    """Return labels by attribute as an array (P,); -1 where there is none."""
    try:
        return domain.labels(values)
    except DataError as fault:
        raise SettingsError(str(fault)) from None
