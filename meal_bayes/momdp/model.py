"""The MOMDP of one query: fully observed x, hidden y, reports as actions (paper, Sect. 5).

It also says which axes the arrays of a MOMDP have, and what each may hold.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import ByValue, freeze, freeze_arrays, set_frozen, yes_of
from meal_bayes.domain import Payoffs, Query
from meal_bayes.errors import SettingsError
from meal_bayes.look import facts_repr, listed
from meal_bayes.momdp.reports import ABSTAINED, Reports

_TINY = np.nextafter(0.0, 1.0)
_HUGE = np.finfo(float).max

ARRAYS = {  # of a MOMDP: N attributes, E behaviors, X states, C latent classes, K levels
    "transition": "exx", "observation_probability": "exx", "legal": "xe", "confusion": "neck",
    "precision": "nec", "prior": "n", "latent_classes": "n2c", "cost": "e", "bonus": "ne2",
    "bonus_limit": "e", "limit": "e",
}  # fmt: skip

RANGES = {  # least, most, and these in words; NaN lies in none
    "prior": (0.0, 1.0, "lie in [0, 1]"),
    "observation_probability": (0.0, 1.0, "lie in [0, 1]"),
    "precision": (_TINY, np.inf, "be above 0 (inf = rows known exactly)"),
    "limit": (0.0, np.inf, "be 0 or more"),
    "bonus_limit": (0.0, np.inf, "be 0 or more"),
    "cost": (0.0, _HUGE, "be finite, and 0 or more"),
    "bonus": (-_HUGE, _HUGE, "be finite"),
    "correct": (-_HUGE, _HUGE, "be finite"),
    "incorrect": (-_HUGE, _HUGE, "be finite"),
    "discount": (_TINY, 1.0, "be above 0, and 1 at most"),
}


def check_shapes(arrays: Mapping[str, NDArray[Any]], *, n: int, e: int, x: int) -> None:
    """Check the axes of `ARRAYS`, of N attributes, E behaviors and X states."""
    levels = arrays["confusion"].shape[-1]
    # The lower half of the levels speaks for "false", the upper half for "true".
    if levels % 2:
        raise SettingsError(f"Percepts have {levels} levels; expected an even number.")
    classes = arrays["latent_classes"].size // (2 * n)
    sizes = {"n": n, "e": e, "x": x, "2": 2, "c": classes, "k": levels}
    for name, axes in ARRAYS.items():
        shape = arrays[name].shape
        expected = tuple(sizes[axis] for axis in axes)
        if shape != expected:
            raise SettingsError(f"MOMDP.{name} has shape {shape}; expected {expected}.")


def check_probabilities(arrays: Mapping[str, NDArray[Any]]) -> None:
    """Check that what can come of one thing sums to 1."""
    for name in ("transition", "confusion", "latent_classes"):
        rows = arrays[name]
        if (rows < 0).any() or not np.allclose(rows.sum(axis=-1), 1.0, atol=1e-6):
            raise SettingsError(f"Rows of MOMDP.{name} must be >= 0 and sum to 1.")


def check_prior(
    query: Query, prior: NDArray[np.float64], joint: NDArray[np.float64] | None
) -> None:
    """Check the prior (N,) of groups, and that it has the margins of a joint one, (Y,)."""
    for group in query.groups:
        if not np.isclose(prior[list(group)].sum(), 1.0):
            raise SettingsError(f"MOMDP.prior of a group must sum to 1, found {prior}.")
    if joint is None:
        return
    if joint.shape != (query.n_values,):
        expected = f"({query.n_values},)"
        raise SettingsError(f"MOMDP.joint has shape {joint.shape}; expected {expected}.")
    if not (joint >= 0.0).all() or not np.isclose(joint.sum(), 1.0):
        raise SettingsError("MOMDP.joint must be >= 0 and sum to 1.")
    if not np.allclose(joint @ query.values, prior, atol=1e-6):
        raise SettingsError("MOMDP.prior must be the margins of MOMDP.joint.")


def check_ranges(values: Mapping[str, NDArray[Any] | float]) -> None:
    """Check that all numbers lie in their `RANGES`."""
    for name, (least, most, expected) in RANGES.items():
        numbers = np.asarray(values[name])
        if not ((numbers >= least) & (numbers <= most)).all():
            raise SettingsError(f"MOMDP.{name} must {expected}; found {numbers}.")


DISCOUNT = 0.99  # a step, in planning, where nothing else is said: the paper's


def nothing_happened(x: int, next_x: int, *, perceived: bool) -> bool:
    """Return whether an execution failed as a model sees it: x stayed, and no percept came.

    `MOMDP.failure_probability` is how likely that is.
    """
    return x == next_x and not perceived


@dataclass(frozen=True, slots=True)
class MOMDP(ByValue):
    """The decision problem of one question (a MOMDP), as arrays.

    Actions are numbered: first the E behaviors, then the Y reports (2^N, or fewer if attributes are
    values of one group), then the answer "I do not know" if the agent may abstain. "I do not know"
    ends the trial with reward 0. Arrays have entries for behaviors only, because every answer leads
    to the terminal state `term`.

    A percept is the output of a classifier for one attribute; its values are the K levels from no
    to yes. With infinite precision, percepts follow the paper's Eq. 8. With finite precision, every
    object has its own confusion matrix, whose rows are drawn from Dirichlet(precision * confusion),
    so the problem is Bayes-adaptive. For each attribute, an object belongs to one of C latent
    classes. All percepts of the object depend on its class, so their errors may be correlated.
    Percepts and truth are independent given the class, and a class may contain true and false
    objects. In the paper the class is the truth itself: C = 2, and `latent_classes` is the
    identity.

    Attributes
    ----------
    query : Query
        The question, about N attributes.
    x_names, behavior_names : tuple[str, ...]
        (X,) names of the observable states, the last of which is "term", and (E,) names of the
        behaviors.
    start : int
        Index of the state in which the trial begins.
    transition, observation_probability : NDArray[np.float64]
        Two arrays (E,X,X): Pr(x' | x, behavior) of the next state x', and the probability that the
        behavior yields a percept if it leads from x to x'.
    legal : NDArray[np.bool_]
        (X,E) whether the robot can execute a behavior in a state.
    confusion : NDArray[np.float64]
        (N,E,C,K) mean of Pr(percept level | latent class).
    precision : NDArray[np.float64]
        (N,E,C) Dirichlet precision of each row of `confusion`; inf if the row is known exactly.
    prior : NDArray[np.float64]
        (N,) Pr(attribute is true) before the trial. The probabilities of a group's values sum to 1.
    latent_classes : NDArray[np.float64]
        (N,2,C) Pr(latent class | truth).
    cost : NDArray[np.float64]
        (E,) cost of each behavior, s.
    correct, incorrect : float
        Rewards of a right and of a wrong report (the paper's r+ and r-). For a yes-or-no question
        with payoffs, they are the largest and the smallest payoff.
    bonus : NDArray[np.float64]
        (N,E,2) exploration bonus of a percept in seconds, by attribute, behavior and truth (Eq.
        11).
    bonus_limit : NDArray[np.float64]
        (E,) number of percepts for which a trial gets `bonus`; inf if every percept counts.
    limit : NDArray[np.float64]
        (E,) maximum number of percepts of each behavior in a trial; inf if unlimited. After that
        many percepts, the behavior still changes the state and has its cost, but yields no percept.
    discount : float
        Discount factor of a step, used in planning only.
    abstain : bool
        Whether the agent may answer "I do not know".
    payoffs : Payoffs | None
        Payoffs of a yes-or-no question. By default they are r+ and r-.
    joint : NDArray[np.float64] | None
        (Y,) prior probability of each combination of values, in the order of `Query.values`; its
        marginals are `prior`. None if attributes and groups are independent.
    x_labels : tuple[str, ...]
        (X-1,) labels of the states that people read, or empty if there are none; see `state_label`.
    log_truth : NDArray[np.float64]
        (N,2,C) logarithm of Pr(truth | latent class) under the prior.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> domain = meal_bayes.load_domain("toy")
    >>> query = meal_bayes.Query(domain.attributes[:1])
    >>> rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    >>> momdp = meal_bayes.build_momdp(domain, query, rows)
    >>> momdp.n_behaviors == len(domain.behaviors)
    True
    """

    query: Query
    x_names: tuple[str, ...]
    behavior_names: tuple[str, ...]
    start: int
    transition: NDArray[np.float64]
    observation_probability: NDArray[np.float64]
    legal: NDArray[np.bool_]
    confusion: NDArray[np.float64]
    precision: NDArray[np.float64]
    prior: NDArray[np.float64]
    latent_classes: NDArray[np.float64]
    cost: NDArray[np.float64]
    correct: float
    incorrect: float
    bonus: NDArray[np.float64]
    bonus_limit: NDArray[np.float64]
    limit: NDArray[np.float64]
    discount: float = DISCOUNT
    abstain: bool = False
    payoffs: Payoffs | None = None
    joint: NDArray[np.float64] | None = None
    x_labels: tuple[str, ...] = ()
    log_truth: NDArray[np.float64] = field(init=False, repr=False)

    __repr__ = facts_repr

    def __post_init__(self) -> None:
        freeze_arrays(self)
        self._check()
        set_frozen(self, log_truth=freeze(self._log_truth()))

    def _check(self) -> None:
        labels = len(self.x_labels)
        if labels not in (0, self.terminal):
            raise SettingsError(f"MOMDP.x_labels has {labels}; expected {self.terminal}, or none.")
        arrays = {name: getattr(self, name) for name in ARRAYS}
        check_shapes(arrays, n=len(self.query), e=self.n_behaviors, x=len(self.x_names))
        check_probabilities(arrays)
        check_prior(self.query, self.prior, self.joint)
        check_ranges({name: getattr(self, name) for name in RANGES})
        if not self.correct >= self.incorrect:
            raise SettingsError(f"Need correct >= incorrect: {self.correct}, {self.incorrect}.")
        if self.payoffs is not None:
            Payoffs.of(self.payoffs)
            if not self.query.yes_or_no:
                raise SettingsError(
                    "Payoffs apply only to yes-or-no questions, but the question asks for values."
                )
            if (max(self.payoffs), min(self.payoffs)) != (self.correct, self.incorrect):
                raise SettingsError(f"{self.payoffs} need correct and incorrect as their extremes.")

    def _log_truth(self) -> NDArray[np.float64]:
        """Compute ln Pr(truth | class) in logarithms, so that tiny probabilities stay exact."""
        chance = np.stack([1.0 - self.prior, self.prior], axis=1)[..., None]  # (N,2,1)
        with np.errstate(divide="ignore", invalid="ignore"):
            latent_classes = np.log(self.latent_classes)
            believed = _log_normalized(latent_classes + np.log(chance))
            even = _log_normalized(latent_classes)
        # A class that the prior rules out never has probability; its truth is that at even odds.
        return np.where(np.isnan(believed), np.where(np.isnan(even), np.log(0.5), even), believed)

    def _facts(self) -> tuple[str, dict[str, str]]:
        """Return a title and what a reader should know first."""
        rates = yes_of(self.rows)  # (N,E,2)
        youden = rates[..., 1] - rates[..., 0]
        names = self.query.value_names
        best = zip(names, youden.argmax(axis=1), youden.max(axis=1), strict=True)
        largest = [f"{name} by {self.behavior_names[e]} ({j:.2f})" for name, e, j in best]
        payoffs = f"{self.correct:g} or {self.incorrect:g} for a report, discount {self.discount:g}"
        values = self.query.n_values if self.query.groups else f"2^{len(names)}"
        states = [self.state_label(x) for x in range(len(self.x_names))]
        return f"MOMDP of {self.query.text.removesuffix('?')}", {
            "states": f"{self.n_states}: {listed(states)} and {values} values",
            "actions": f"{self.n_actions}: {listed(self.behavior_names)} and the reports",
            "percepts": f"{self.levels} levels, {self.n_classes} latent classes",
            "largest TPR - FPR": listed(largest, 3),
            "rewards": f"{payoffs}, costs {np.min(self.cost):g} to {np.max(self.cost):g} s",
        }

    @property
    def reports(self) -> Reports:
        """The possible reports and their rewards."""
        symmetric = Payoffs(self.correct, self.incorrect, self.correct, self.incorrect)
        return Reports(self.query, self.payoffs or symmetric)

    @property
    def levels(self) -> int:
        """Number K of levels of a percept. The upper half of the levels mean yes."""
        return int(self.confusion.shape[-1])

    @property
    def coupled(self) -> bool:
        """Whether attributes are dependent, as values of a group or through a joint prior."""
        return bool(self.query.groups) or self.joint is not None

    @property
    def n_classes(self) -> int:
        """Number C of latent classes of an attribute."""
        return int(self.latent_classes.shape[2])

    @property
    def class_is_truth(self) -> bool:
        """Whether the latent class is the truth (Eq. 8), so that the log-odds are the belief."""
        return self.n_classes == 2 and not self.latent_classes[:, [0, 1], [1, 0]].any()

    @property
    def rows(self) -> NDArray[np.float64]:
        """Mean confusion matrices given the truth, (N,E,2,K), averaged over the latent classes."""
        return np.asarray(np.einsum("nvc,neck->nevk", self.latent_classes, self.confusion))

    @property
    def bonus_runs_out(self) -> bool:
        """Whether the number of percepts that get a bonus is limited (and part of the state)."""
        pays = self.bonus.any(axis=(0, 2))
        return bool((pays & np.isfinite(self.bonus_limit)).any())

    @property
    def n_behaviors(self) -> int:
        """Number E of behaviors."""
        return len(self.behavior_names)

    @property
    def terminal(self) -> int:
        """Index of the terminal state `term`."""
        return len(self.x_names) - 1

    @property
    def n_states(self) -> int:
        """Number of states, |S| = (|X| - 1) Y + 1, because `term` is a single state."""
        return self.terminal * self.query.n_values + 1

    @property
    def n_actions(self) -> int:
        """Number of actions: E + Y, or E + 2 for yes or no, plus 1 if the agent may abstain."""
        return self.abstention + self.abstain

    @property
    def abstention(self) -> int:
        """Index of the action "I do not know", which comes after behaviors and reports."""
        return self.n_behaviors + self.query.n_reports

    @property
    def failure_probability(self) -> NDArray[np.float64]:
        """Probability (X,E) that a behavior fails: the state stays, without a percept."""
        states = np.arange(len(self.x_names))
        silent = (self.transition * (1 - self.observation_probability))[:, states, states].T
        return np.where(self.legal, silent, 0.0)

    def charged(self, behavior: int, *, failed: bool) -> float:
        """Return the cost of an execution in seconds; a failed execution has the same cost."""
        return float(self._outcome_costs()[int(failed)][behavior])

    def charged_for(self, behavior: int, x: int, next_x: int, *, perceived: bool) -> float:
        """Return the cost in seconds of an execution that led from one state to the next."""
        return self.charged(behavior, failed=nothing_happened(x, next_x, perceived=perceived))

    def expected_cost(self) -> NDArray[np.float64]:
        """Return the expected cost (X,E) in seconds of executing a behavior in a state."""
        cost, cost_of_failure = self._outcome_costs()
        return np.asarray(cost + self.failure_probability * (cost_of_failure - cost))

    def _outcome_costs(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return costs (E,) of executions by which something happens, and nothing."""
        return self.cost, self.cost

    @property
    def exit_value(self) -> float:
        """Reward of the answer "I do not know"; -inf if the agent may not give it."""
        return ABSTAINED if self.abstain else -np.inf

    def reported(self, action: int) -> NDArray[np.bool_] | None:
        """Return the report of an answer, (N,) values or (1,) yes; None for "I do not know"."""
        if action == self.abstention:
            return None
        return self.query.report_of(action - self.n_behaviors)

    def check_action(self, x: int, action: int) -> None:
        """Check that an action exists and is legal in the state, before the robot moves.

        Raises
        ------
        SettingsError
            The problem does not have the action, or the action is not legal in the state.
        """
        if not 0 <= action < self.n_actions:
            last = self.n_actions - 1
            raise SettingsError(f"The planner commands action {action}; expected 0 to {last}.")
        if action < self.n_behaviors and not self.legal[x, action]:
            legal = [self.behavior_names[e] for e in np.flatnonzero(self.legal[x])]
            raise SettingsError(
                f"The planner commands {self.behavior_names[action]!r} in {self.x_names[x]!r}, "
                f"where only {legal} are legal; command one of them, or answer."
            )

    def state_label(self, x: int) -> str:
        """Return the label of a state, or its name if it has no label."""
        return self.x_labels[x] if x < len(self.x_labels) else self.x_names[x]

    def action_name(self, action: int) -> str:
        """Return the name of a behavior, or the text of an answer."""
        if action < self.n_behaviors:
            return self.action_label(action)
        values = self.reported(action)
        if values is None:
            return self.action_label(action)
        return f"report {self.query.report_name(values)}"

    def action_label(self, action: int) -> str:
        """Return the name of a behavior, "answer" or "abstain"."""
        if action < self.n_behaviors:
            return self.behavior_names[action]
        return "abstain" if action == self.abstention else "answer"


def _log_normalized(log_joint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return log-probabilities (N,2,C) that sum to 1 over the truths."""
    return np.asarray(log_joint - np.logaddexp.reduce(log_joint, axis=1, keepdims=True))
