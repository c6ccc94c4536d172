"""The MOMDP of one query: fully observed x, hidden y, reports as actions (paper, Sect. 5)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.domain import Query
from meal_bayes.errors import SettingsError


@dataclass(frozen=True, slots=True)
class MOMDP:
    """A decision problem in factored form; actions are the E behaviors, then the 2^N reports.

    Arrays run over behaviors only: a report always leads to `term`, and 2^N of them need no table.
    With infinite precision percepts follow the paper's Eq. 8; with finite precision the object's
    rows are Dirichlet(precision * confusion), which is the Bayes-adaptive problem. With
    misperception, rows are those of the value that the object seems to have: a latent class that
    all its percepts share, so that no number of them makes the robot surer than it may be.
    """

    query: Query
    x_names: tuple[str, ...]  # (X,) the last is "term"
    behavior_names: tuple[str, ...]  # (E,)
    start: int
    transition: NDArray[np.float64]  # (E,X,X) Pr(x' | x, behavior)
    informative: NDArray[np.float64]  # (E,X,X) Pr(a percept comes | behavior, x, x')
    legal: NDArray[np.bool_]  # (X,E)
    confusion: NDArray[np.float64]  # (N,E,2,K) rows = truth, columns = percept level
    precision: NDArray[np.float64]  # (N,E,2) Dirichlet weight of a row, inf = known exactly
    prior: NDArray[np.float64]  # (N,) Pr(attribute is true) before the trial
    cost: NDArray[np.float64]  # (E,) s
    correct: float  # r+
    incorrect: float  # r-
    bonus: NDArray[np.float64]  # (N,E,2) shaping per attribute and its value (ITRS, Eq. 11)
    limit: NDArray[np.float64]  # (E,) percepts a trial, inf where they never run out
    misperception: NDArray[np.float64]  # (N,) Pr(the object seems to have the other value, to
    # every percept alike); 0 is the paper's: given the truth, behaviors err independently
    direct: NDArray[np.bool_]  # (E,) does its percept tell of the truth itself (a person's answer)?
    discount: float = 0.99
    abstain: bool = False  # may a planner end a trial by an illegal behavior?

    def __post_init__(self) -> None:
        for name in ("transition", "informative", "confusion", "precision", "prior", "cost"):
            set_frozen(self, **{name: freeze(getattr(self, name))})
        set_frozen(self, bonus=freeze(self.bonus), limit=freeze(self.limit))
        set_frozen(self, misperception=freeze(self.misperception))
        set_frozen(self, legal=freeze(self.legal, np.bool_))
        set_frozen(self, direct=freeze(self.direct, np.bool_))
        self._check()

    def _check(self) -> None:
        n, e, x = len(self.query), len(self.behavior_names), len(self.x_names)
        if self.confusion.ndim < 1 or self.levels % 2:
            raise SettingsError(
                f"MOMDP.confusion has shape {self.confusion.shape}; its last axis are the percept "
                "levels, an even number, the upper half of which speaks for true."
            )
        expected = {
            "transition": (e, x, x),
            "informative": (e, x, x),
            "legal": (x, e),
            "confusion": (n, e, 2, self.levels),
            "precision": (n, e, 2),
            "prior": (n,),
            "cost": (e,),
            "bonus": (n, e, 2),
            "limit": (e,),
            "misperception": (n,),
            "direct": (e,),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if found != shape:
                raise SettingsError(f"MOMDP.{name} has shape {found}; expected {shape}.")
        for name in ("transition", "confusion"):
            rows = getattr(self, name)
            if (rows < 0).any() or not np.allclose(rows.sum(axis=-1), 1.0, atol=1e-6):
                raise SettingsError(f"Rows of MOMDP.{name} must be >= 0 and sum to 1.")
        if not ((self.prior >= 0) & (self.prior <= 1)).all():
            raise SettingsError(f"MOMDP.prior must lie in [0, 1], found {self.prior}.")
        if not (self.precision > 0).all():
            raise SettingsError("MOMDP.precision must be above 0 (inf = rows known exactly).")
        if not ((self.misperception >= 0) & (self.misperception < 0.5)).all():  # noqa: PLR2004
            raise SettingsError(
                f"MOMDP.misperception must lie in [0, 0.5), found {self.misperception}."
            )
        if not 0 < self.discount <= 1 or not self.correct >= self.incorrect:
            raise SettingsError(
                f"Need 0 < discount <= 1 and correct >= incorrect; found discount "
                f"{self.discount}, correct {self.correct}, incorrect {self.incorrect}."
            )

    @property
    def levels(self) -> int:
        """K, the levels of a percept; the upper half speaks for "true"."""
        return int(self.confusion.shape[-1])

    @property
    def n_behaviors(self) -> int:
        """E."""
        return len(self.behavior_names)

    @property
    def terminal(self) -> int:
        """Index of `term` among the x."""
        return len(self.x_names) - 1

    @property
    def n_states(self) -> int:
        """|S| = (|X| - 1) 2^N + 1: `term` is one state."""
        return int(self.terminal * 2 ** len(self.query) + 1)

    @property
    def n_actions(self) -> int:
        """|A| = E + 2^N."""
        return int(self.n_behaviors + 2 ** len(self.query))

    def action_name(self, action: int) -> str:
        """Behavior name, or the words of a report."""
        if action < self.n_behaviors:
            return self.behavior_names[action]
        values = self.query.values_of(action - self.n_behaviors)
        return f"report {self.query.report_name(values)}"
