"""Settings of a learner, and checks of its inputs."""

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
from meal_bayes.domain.words import look
from meal_bayes.errors import DataError, QueryError, SettingsError
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.untrusted import LARGEST, name_fault

REFIT_EVERY = 0.2  # default growth of the labeled instances after which the learner refits
_PERCEPTS = ("recorded", "model")


@dataclass(frozen=True, slots=True)
class LearnerSettings(ByValue):
    """Settings of a learner. Those that `Learner` takes by name are described there.

    Attributes
    ----------
    payoffs : Payoffs | None
        Payoffs of yes and no in questions without payoffs of their own. By default they are the
        domain's payoffs.
    by_object : bool
        Whether cross-validation leaves out objects; see `PerceptionSettings`.
    unit : float | None
        Number of labeled instances in one unit of experience (Eq. 10). By default, it is the number
        of objects times the largest number of recordings of an object by one behavior.
    count_given : bool
        Whether recordings that were given to `fit` count as experience, like those of trials.
    shaped_answers : bool
        Whether the bonus of ITRS is also used in tests.
    drawn : NDArray[np.int8] | None
        (O,P) label of each object and attribute, or None. If labels are given, each percept is
        drawn at random from the row of its label in the learned confusion matrix.
    """

    seed: int = 0
    reward: float | None = None
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
        check_amount("reward", self.reward, LARGEST, or_none=True)
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

    def reward_in(self, domain: Domain) -> float:
        """Return the reward of a right report: the domain's if none is set."""
        return domain.report_reward if self.reward is None else self.reward


def checked_payoffs(values: Sequence[float] | None) -> Payoffs | None:
    """Return four numbers as payoffs of yes and no, or None if there are none."""
    try:
        return None if values is None else Payoffs.of(values)
    except QueryError as fault:
        raise SettingsError(str(fault)) from None


def settings_of(
    settings: LearnerSettings | None, by_name: Mapping[str, Any], domain: Domain, agent: Agent
) -> LearnerSettings:
    """Return the settings of a learner, given as one value or by name.

    Raises
    ------
    SettingsError
        If both are given, or the value has another type.
    """
    if settings is None:
        settings = LearnerSettings(**by_name)
    else:
        check_kind("settings", settings, LearnerSettings)
        defaults = {field.name: field.default for field in fields(LearnerSettings)}
        changed = [name for name, value in by_name.items() if not _same(value, defaults[name])]
        if changed:
            raise SettingsError(
                f"Learner() has settings, and {' and '.join(changed)} by name; give all in one "
                f"value: dataclasses.replace(settings, {changed[0]}=...)."
            )
    posterior = own_posterior(settings.posterior, domain, agent)
    return replace(settings, reward=settings.reward_in(domain), posterior=posterior)


def _same(value: object, default: object) -> bool:
    return value is default or (default is not None and value == default)


def own_posterior(posterior: object, domain: Domain, agent: Agent) -> ConfusionPosterior | None:
    """Return a user's posterior in the order of a domain, or None if there is none."""
    if posterior is None:
        return None
    if not isinstance(posterior, ConfusionPosterior):
        from meal_bayes.posterior.idata import posterior_from  # noqa: PLC0415  loads xarray

        posterior = posterior_from(posterior, domain)
    shape = posterior.counts.shape
    expected = (len(domain.attributes), len(domain.behaviors), 2, agent.levels)
    if shape != expected:
        raise SettingsError(
            f"The posterior has shape {shape}; expected {expected}, for the attributes and "
            f"behaviors of the domain, two truths, and the {agent.levels} levels of the agent "
            f"{agent.name!r}."
        )
    return posterior


def check_object_name(name: object, objects: Iterable[str]) -> None:
    """Check the name of an object against the names of known objects.

    Raises
    ------
    SettingsError
        If the name is not text.
    QueryError
        If the name is not valid, or differs from a known name only in invisible ways, so that a
        person could not tell the two objects apart.
    """
    check_object_names([name], objects)


def check_object_names(names: Iterable[object], objects: Iterable[str]) -> None:
    """Check names of objects, as `check_object_name` does, also against each other."""
    known = {*objects}
    seen = dict[str, str]()  # a name by its look; filled when there is a new name
    for name in names:
        if not isinstance(name, str):
            raise SettingsError(f"The name of an object must be text; found {name!r:.60}.")
        if fault := name_fault(name):
            raise QueryError(f"The object's name {name!a:.60} {fault}; rename it.")
        if name in known:
            continue
        seen = seen or {look(other): other for other in known}
        if (other := seen.setdefault(look(name), name)) != name:
            raise QueryError(unknown("object", name, [other]))


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
    """Return labels by attribute as an array (P,); -1 if there is no label."""
    try:
        return domain.labels(values)
    except DataError as fault:
        raise SettingsError(str(fault)) from None
