"""What a run is: its settings, checked."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meal_bayes.agents import Agent, ITRSBonus, as_agent
from meal_bayes.arrays import check_whole, check_yes_no, is_whole, plain_fields
from meal_bayes.datasets import Dataset, PerceptTable
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.files import path_text
from meal_bayes.learner import LearnerSettings
from meal_bayes.learner.settings import checked_payoffs
from meal_bayes.look import short, short_repr
from meal_bayes.untrusted import LARGEST

DEFAULT_AGENTS = (
    "prior", "random", "random_legal", "predefined", "predefined_plus", "greedy", "morc", "bayes",
)  # fmt: skip
_CHOICES = {
    "log": ("compact", "full"), "normalizer": ("paper", "all"), "answers": ("verdict", "joint"),
}  # fmt: skip


MOST_TRIALS = 1_000_000  # of all agents of a run; more are several runs
_SECONDS = 0.01  # of computing, about, of a trial of the quicker agents
_BYTES = 5_000  # about, of a trial's whole log
ANSWERS = ("values", "yes or no", "balanced")


def check_answer(answer: object) -> None:
    """Raise an error if the kind of answer is unknown."""
    if not isinstance(answer, str) or answer not in ANSWERS:
        raise SettingsError(f"answer is {answer!r:.40}; expected one of {ANSWERS}.")


def _as_dict(config: "OfflineConfig | OnlineConfig") -> dict[str, object]:
    """Return the settings as plain values, for headers of logs and JSON."""
    values = {field.name: getattr(config, field.name) for field in dataclasses.fields(config)}
    values["agents"] = [agent.name for agent in config.agents]
    if not isinstance(config.dataset, str):
        values["dataset"] = short(config.dataset)
    return values


@dataclass(frozen=True, slots=True)
class OfflineConfig:
    """Settings of an offline run.

    Attributes
    ----------
    dataset : str | Path | PerceptTable | Dataset
        Name of a shipped data set, a percept table or its path, or recordings (see
        `TableSource.of`). A table without a path is saved in the cache, and the results name the
        path there.
    attributes, trials : int
        Number N of attributes in each question, and number of trials of each agent.
    agents : tuple[Any, ...]
        Agents, given by name or value (see `as_agent`).
    seed : int
        Seed of all random streams.
    percepts, perception : str
        `percepts` is "recorded", or "model" to draw percepts from the learned confusion matrices.
        `perception` is "default" or "paper" and selects the classifiers.
    reward : float | None
        Reward of a right report; a wrong report gets minus this reward. By default it is the
        domain's reward.
    answer : str
        Kind of question. "values" asks for the values of the attributes. "yes or no" asks whether
        all attributes are true. "balanced" asks yes-or-no questions about attributes and negated
        attributes ("red and not empty"), where yes is right in half of the trials.
    payoffs : Sequence[float] | None
        Rewards of a right yes, a wrong yes, a right no and a wrong no. By default they are the
        domain's payoffs, or r+ and r- if it has none.
    key : str
        Name for the present version of your own agents' code. A later run with the same key and
        settings reuses trials of these agents, so change the key when you change the code. With "",
        the trials of your own agents are not reused.

    Raises
    ------
    SettingsError
        An agent is unknown or listed twice, the seed is negative, the reward is not positive and
        finite, the kind of answer is unknown, or payoffs are invalid or do not fit the kind of
        answer.

    Examples
    --------
    >>> import meal_bayes
    >>> meal_bayes.OfflineConfig(dataset="roc36", attributes=2).dataset
    'roc36'
    """

    dataset: str | Path | PerceptTable | Dataset
    attributes: int = 2
    trials: int = 400
    agents: tuple[Any, ...] = DEFAULT_AGENTS
    seed: int = 0
    percepts: str = "recorded"
    perception: str = "default"
    reward: float | None = None
    answer: str = "values"
    payoffs: Sequence[float] | None = None
    key: str = ""

    __repr__ = short_repr
    as_dict = _as_dict

    def __post_init__(self) -> None:
        plain_fields(self)
        object.__setattr__(self, "agents", _checked(self.agents, self.seed, self.reward))
        check_answer(self.answer)
        object.__setattr__(self, "payoffs", checked_payoffs(self.payoffs))
        if self.payoffs is not None and self.answer == "values":
            raise SettingsError(
                "Payoffs apply only to yes-or-no questions, but the questions ask for values; ask "
                "yes-or-no questions (answer='yes or no', --yes-no), or give a reward (--reward)."
            )
        _check_size(self, ("trials",), ("attributes",))
        object.__setattr__(self, "dataset", path_text(self.dataset))
        if not isinstance(self.dataset, str | Dataset | PerceptTable):
            raise SettingsError(
                f"dataset is {self.dataset!r:.40}; give the name of a data set, a percept table, "
                "its path, or recordings (`load_dataset`, `Dataset.from_frames`)."
            )


@dataclass(frozen=True, slots=True)
class OnlineConfig:
    """Settings of an online run.

    Attributes
    ----------
    dataset : str
        Name of a shipped domain, or the path of your own domain file (TOML).
    attributes : int
        Number N of attributes in each question.
    root : str | None
        Folder of the recordings. By default public recordings are read from the cache, or
        downloaded.
    agents : tuple[Any, ...]
        Agents, given by name or value (see `as_agent`).
    batches, trials : int
        Number of training batches, and number of trials in a batch.
    repeats : int
        Number of runs; each run splits the objects differently.
    seed : int
        Seed of all random streams.
    split : tuple[int, int, int] | tuple[tuple[str, ...], ...]
        Shares of the objects for pretraining, training and tests, or three tuples with the names of
        the objects.
    reward : float | None
        Reward of a right report; a wrong report gets minus this reward. The default is 300 on
        public data (Sect. 7.3 of the paper), and the domain's reward otherwise.
    alpha, beta : float | None
        Weights of Eq. 11 for the agent `morc_itrs`. By default they are the agent's own weights.
    answers : str
        What people say after a training trial. With "verdict", people say whether the report was
        right. With "joint", this verdict about the whole report becomes the label of each
        attribute, as in the authors' code.
    second_rater : bool
        Whether behaviors that ask a person return the answers of a second rater, for objects and
        attributes of which the data set has one. All other answers are drawn by the accuracy in the
        domain; so are all answers if `second_rater` is False.
    learning : tuple[tuple[str, Any], ...]
        Other settings of the learner. Each is a pair: the name of a field of `LearnerSettings`, and
        its value.
    percepts : str
        Source of the percepts: "recorded", or "model" to draw any number of them from the learned
        confusion matrices.
    normalizer : str
        Experience that Eq. 10 counts: "paper" counts training only, "all" counts pretraining too.
    horizon : int
        Expected number of future questions, which determines how much exploration is worth.
    log : str
        Size of the logs. "full" logs hold all steps. "compact" logs of tests hold the outcomes of
        all tests, but the steps of only some: the worst test of each batch, and ten random tests.
        The random tests are the same for all agents.
    key : str
        Name for the version of your own agents' code, as for `OfflineConfig`.

    Raises
    ------
    SettingsError
        A setting is unknown or out of range, or an agent is listed twice.

    Examples
    --------
    >>> import meal_bayes
    >>> meal_bayes.OnlineConfig(dataset="roc36").dataset
    'roc36'
    """

    dataset: str
    attributes: int = 1
    root: str | None = None
    agents: tuple[Any, ...] = ("iterative_morc", "morc_itrs", "bayes", "bayes_memory")
    batches: int = 10
    trials: int = 40
    repeats: int = 1
    seed: int = 0
    split: tuple[int, int, int] | tuple[tuple[str, ...], ...] = (33, 33, 34)
    reward: float | None = None
    alpha: float | None = None
    beta: float | None = None
    answers: str = "verdict"
    second_rater: bool = True
    learning: tuple[tuple[str, Any], ...] = ()
    percepts: str = "recorded"
    normalizer: str = "paper"
    horizon: int = 1000
    log: str = "compact"
    key: str = ""

    __repr__ = short_repr
    as_dict = _as_dict

    def __post_init__(self) -> None:
        plain_fields(self)
        for name in ("dataset", "root"):
            object.__setattr__(self, name, path_text(getattr(self, name)))
        set_weights = {"alpha": self.alpha, "beta": self.beta}
        weights = {name: value for name, value in set_weights.items() if value is not None}
        agents = []
        for agent in _checked(self.agents, self.seed, self.reward):
            bonus = agent.exploration
            if isinstance(bonus, ITRSBonus):
                weighted = dataclasses.replace(bonus, **weights)
                agents.append(dataclasses.replace(agent, exploration=weighted))
            else:
                agents.append(agent)
        object.__setattr__(self, "agents", tuple(agents))
        _check_size(self, ("repeats", "batches", "trials"), ("attributes", "horizon"))
        check_yes_no("second_rater", self.second_rater)
        parts = self.split if hasattr(self.split, "__len__") else ()
        sizes = [len(part) if hasattr(part, "__len__") else part for part in parts]
        if len(sizes) != 3 or not all(is_whole(size) and size >= 1 for size in sizes):
            raise SettingsError(
                f"split is {self.split!r:.60}; give three shares as whole numbers, such as "
                "33/33/34, or the objects of each part."
            )
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                raise SettingsError(unknown(name, getattr(self, name), choices))
        for name, value in weights.items():
            if not 0 <= value <= LARGEST:
                raise SettingsError(f"{name} is {value}; give a number from 0 to {LARGEST:g}.")
        settings = [field.name for field in dataclasses.fields(LearnerSettings)]
        for name, _ in self.learning:
            if name not in settings:
                raise SettingsError(unknown("setting of learners", name, settings))
        LearnerSettings(percepts=self.percepts)


def _check_size(config: Any, factors: tuple[str, ...], others: tuple[str, ...]) -> None:
    """Raise an error if a count is not valid, or if the run is too large."""
    for name in (*factors, *others):
        count = getattr(config, name)
        if not is_whole(count) or not 1 <= count <= MOST_TRIALS:
            raise SettingsError(
                f"{name} is {count!r:.60}; give a whole number from 1 to {MOST_TRIALS:,}."
            )
    trials = len(config.agents) * math.prod(int(getattr(config, name)) for name in factors)
    if trials > MOST_TRIALS:
        days = trials * _SECONDS / 86_400
        terms = " x ".join(f"{getattr(config, name):,} {name}" for name in factors)
        raise SettingsError(
            f"{len(config.agents)} agents x {terms} are {trials:,} trials: with {_SECONDS:g} s and "
            f"{_BYTES:,} bytes for a trial, they need {days:,.0f} days of a core and "
            f"{trials * _BYTES / 1e9:,.0f} GB of logs. Run at most {MOST_TRIALS:,} trials, or "
            "several runs with different seeds."
        )


def _checked(agents: Any, seed: int, reward: float | None) -> tuple[Agent, ...]:
    """Return the agents of values, or of one; raise where they, seed or reward are none."""
    check_whole("seed", seed)
    if reward is not None:
        LearnerSettings(reward=reward)
    alone = isinstance(agents, str) or not isinstance(agents, Iterable)
    agents_of_values = tuple(as_agent(value) for value in ((agents,) if alone else agents))
    names = [agent.name for agent in agents_of_values]
    for name in names:
        if names.count(name) > 1:
            raise SettingsError(
                f"Agent {name!r} is listed twice; list each agent once. Two planners of the same "
                "class need different attributes `name`."
            )
    if not agents_of_values:
        raise SettingsError("There are no agents; give at least one.")
    return agents_of_values
