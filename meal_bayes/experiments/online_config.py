"""What an online run is: its settings, checked."""

import dataclasses
from dataclasses import dataclass
from typing import Any

from meal_bayes.agents import as_agent, distinct
from meal_bayes.display import short_repr
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.learner import Feedback
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.untrusted import LARGEST

_LOGS = ("compact", "full")
_NORMALIZERS = ("paper", "all")


@dataclass(frozen=True, slots=True)
class OnlineConfig:
    """Settings of an online run.

    Attributes
    ----------
    dataset : a shipped domain, or the path of one's own (TOML).
    attributes : N, asked at a time.
    root : folder of the recordings; of public ones, found or downloaded.
    agents : names or values (see `as_agent`), made `Agent`s.
    batches, trials : of training, and trials in a batch.
    repeats, first : repeats are first .. first + repeats - 1.
    seed : of all random streams.
    split : shares of objects for pretraining, training, tests; or their names, in three tuples.
    reward : r+ = -r-; by default 300 on public data (Sect. 7.3), else the domain's.
    alpha, beta : of morc_itrs; the agent's own by default.
    answers, error : of `Feedback`.
    success : true success probabilities, as pairs (behavior, probability).
    learn_success : whether agents learn success probabilities.
    learning : other settings of the learner, as pairs (field of `LearnerSettings`, value).
    percepts : "recorded", or "model": drawn from the learned tables, without end.
    normalizer : of Eq. 10: "paper", experience in training; "all", in pretraining too.
    horizon : queries to come, for which exploring is valued.
    log : "compact", logs of test trials hold outcomes only; or "full".

    Raises
    ------
    SettingsError : what is unknown, named twice, or out of range.
    """

    dataset: str
    attributes: int = 1
    root: str | None = None
    agents: tuple[Any, ...] = ("iterative_morc", "morc_itrs", "bayes", "bayes_memory")
    batches: int = 10
    trials: int = 40
    repeats: int = 1
    seed: int = 0
    first: int = 0
    split: tuple[int, int, int] | tuple[tuple[str, ...], ...] = (33, 33, 34)
    reward: float | None = None
    alpha: float | None = None
    beta: float | None = None
    answers: str = "verdict"
    error: float = 0.0
    success: tuple[tuple[str, float], ...] = ()
    learn_success: bool = False
    learning: tuple[tuple[str, Any], ...] = ()
    percepts: str = "recorded"
    normalizer: str = "paper"
    horizon: int = 1000
    log: str = "compact"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        found = distinct(as_agent(value) for value in self.agents)
        object.__setattr__(self, "agents", found)
        for name in ("attributes", "batches", "trials", "repeats", "horizon"):
            if getattr(self, name) < 1:
                raise SettingsError(f"{name} is {getattr(self, name)}; give at least 1.")
        if self.seed < 0 or self.first < 0:
            raise SettingsError("seed and first are whole numbers, 0 or more.")
        if self.reward is not None and not 0 < self.reward <= LARGEST:
            raise SettingsError(
                f"reward is {self.reward}; give a finite number above 0, at most {LARGEST:g}."
            )
        sizes = [part if isinstance(part, int) else len(part) for part in self.split]
        if len(sizes) != 3 or min(sizes) < 1:
            raise SettingsError(f"split is {self.split}; give three shares, such as 33/33/34.")
        if self.log not in _LOGS:
            raise SettingsError(unknown("log", self.log, _LOGS))
        if self.normalizer not in _NORMALIZERS:
            raise SettingsError(unknown("normalizer", self.normalizer, _NORMALIZERS))
        for name in ("alpha", "beta"):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= LARGEST:
                raise SettingsError(f"{name} is {value}; give a number from 0 to {LARGEST:g}.")
        Feedback(self.answers, self.error)
        settings = [field.name for field in dataclasses.fields(LearnerSettings)]
        for name, _ in self.learning:
            if name not in settings:
                raise SettingsError(unknown("setting of learners", name, settings))
        LearnerSettings(percepts=self.percepts)

    def as_dict(self) -> dict[str, object]:
        """Return plain values, for headers and JSON."""
        fields = {one.name: getattr(self, one.name) for one in dataclasses.fields(self)}
        plain = {
            "split": list(self.split),
            "learning": [list(pair) for pair in self.learning],
            "agents": [agent.name for agent in self.agents],
            "success": [list(pair) for pair in self.success],
        }
        return {**fields, **plain}
