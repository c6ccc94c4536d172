"""Interfaces of planning: a `Solver` (the paper's Sol) makes a `Policy`, which makes `Decision`s.

`POMCP`, `OpenLoop` and `Factored` choose an action by `choose`; baselines have their own rules.

The functions `solve` and `decide` check what a user's own planner returns.
"""

import hashlib
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, FrozenArrays, is_whole
from meal_bayes.errors import SettingsError
from meal_bayes.look import AMOUNT, best_options, estimate_text, facts_repr
from meal_bayes.momdp import MOMDP, Belief, answer_value, best_answer
from meal_bayes.seeds import stream

RULE = "this agent follows a rule and compares nothing"
MAX_STEPS = 100  # of a trial, by default, also of one that is simulated
_PRINTED = 6  # actions of a decision that is printed; an HTML table has all


class TreeEdge(NamedTuple):
    """One edge of the first two levels of a search tree.

    Attributes
    ----------
    level : int
        Level of the edge in the tree, 1 or 2.
    parent : int
        Position of the parent edge in the list; -1 for an edge at the root.
    action : int
        Index of the behavior.
    observation : tuple[int, ...]
        Percept levels after the behavior of the parent edge; () if there are none.
    visits : int
        Number of simulations that passed through the edge.
    value : float
        Estimate of the expected reward of this trial.
    bonus : float
        Estimate of the expected exploration bonus in seconds.
    """

    level: int
    parent: int
    action: int
    observation: tuple[int, ...]
    visits: int
    value: float
    bonus: float = 0.0


class GoingOn(NamedTuple):
    """By how much the value of the best behavior exceeds that of answering now.

    Attributes
    ----------
    value : float
        Expected additional reward of this trial in seconds. Below 0, answering now is better. NaN
        if actions were not compared.
    bonus : float
        Expected exploration bonus in seconds.
    variance : float
        Variance of `value` in s^2; 0 if both values are exact.
    """

    value: float
    bonus: float
    variance: float


@dataclass(frozen=True, slots=True)
class Decision(FrozenArrays):
    """A chosen action, with the values and visit counts on which the choice is based.

    Attributes
    ----------
    action : int
        Index of the action: 0 to E - 1 is a behavior, E + y is the report of answer y (a
        combination of values, or no and yes), and E + Y is "I do not know".
    values : NDArray[np.float64]
        (E+1,) expected reward of the rest of this trial after each behavior, and of the best answer
        (the last entry). nan if the planner did not compute a value.
    value_se : NDArray[np.float64]
        (E+1,) standard error of each value: 0 if the value is exact, nan if the error is unknown.
    visits : NDArray[np.int64]
        (E+1,) number of simulations that began with each action.
    tree : tuple[TreeEdge, ...]
        The first two levels of the search tree.
    simulations : int
        Number of simulations of the search.
    sampled_rows : NDArray[np.float64] | None
        (M,N,K) rows of the confusion matrices of the chosen behavior in M sampled MOMDPs; None if
        none were sampled.
    gap : float | None
        Upper bound, in seconds, of the loss by this decision. The expected reward (with exploration
        bonus) of the best possible action is higher by at most this bound. None if no bound is
        known.
    bonus : NDArray[np.float64] | None
        (E+1,) expected exploration bonus in seconds. The chosen action maximizes `values` +
        `bonus`. None if the solver does not separate the two; `values` then contain the bonus.
    momdp : MOMDP | None
        The decision problem, from which the names of the actions are read. A trial sets it, so
        solvers can leave it out.

    Examples
    --------
    >>> import meal_bayes
    >>> trial = meal_bayes.ask(
    ... "heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", logs=None
    ... )
    >>> decision = trial.steps[0].decision
    >>> decision.action
    0
    >>> len(decision.values) == trial.momdp.n_behaviors + 1
    True
    """

    action: int
    values: NDArray[np.float64]
    value_se: NDArray[np.float64]
    visits: NDArray[np.int64]
    tree: tuple[TreeEdge, ...] = ()
    simulations: int = 0
    sampled_rows: NDArray[np.float64] | None = None
    gap: float | None = None
    bonus: NDArray[np.float64] | None = None
    momdp: MOMDP | None = field(default=None, compare=False)

    __repr__ = facts_repr

    @property
    def total(self) -> NDArray[np.float64]:
        """Sum of `values` and `bonus`, (E+1,); the chosen action maximizes it."""
        return self.values if self.bonus is None else self.values + self.bonus

    def going_on(self) -> GoingOn:
        """Return by how much the value of the best behavior exceeds that of answering now."""
        total = self.total
        if np.isnan(total[:-1]).all():
            return GoingOn(np.nan, 0.0, 0.0)
        best = int(np.nanargmax(total[:-1]))
        value = float(self.values[best] - self.values[-1])
        # Var(Q(best) - Q(answer)) of independent estimates
        errors = np.nan_to_num(self.value_se[[best, -1]])
        return GoingOn(
            value=value,
            bonus=float(total[best] - total[-1]) - value,
            variance=float((errors**2).sum()),
        )

    @property
    def explores(self) -> bool:
        """Whether any action has a nonzero exploration bonus."""
        return self.bonus is not None and bool(self.bonus.any())

    @property
    def value_heads(self) -> tuple[str, ...]:
        """Names of the columns in tables of values: the values, and the bonus if there is one."""
        if self.explores:
            return "this answer", "for later questions"
        # Older logs, and solvers that know sums alone.
        if self.bonus is None and self.momdp is not None and self.momdp.bonus.any():
            return ("this answer and later ones",)
        return ("expected reward",)

    @property
    def _chosen(self) -> int:
        return min(self.action, len(self.values) - 1)

    def _name(self, option: int) -> str:
        """Return the name of one of the E+1 compared actions, of which the last answers."""
        answers = option == len(self.values) - 1
        if self.momdp is None:
            return "answer" if answers else f"behavior {option}"
        if not answers:
            return self.momdp.behavior_names[option]
        return self.momdp.action_name(self.action) if self._chosen == option else "answer now"

    def _compared(self, most: int) -> dict[int, list[str]]:
        """Return the values of the best actions as text, best first, by action."""
        compared = {}
        for option in best_options(self.total, self._chosen, most):
            cells = [estimate_text(self.values[option], self.value_se[option])]
            if self.bonus is not None and self.explores:
                cells.append(f"{self.bonus[option]:{AMOUNT}}")
            if self.simulations:  # none begins with the answer
                cells.append("" if option == len(self.values) - 1 else str(self.visits[option]))
            compared[option] = cells
        return compared

    @property
    def _heads(self) -> list[str]:
        return [*self.value_heads, *(["simulations"] if self.simulations else [])]

    def _facts(self) -> tuple[str, dict[str, str]]:
        compared = self._compared(_PRINTED)
        facts = {
            self._name(option): ", ".join(
                f"{head} {cell}" for head, cell in zip(self._heads, cells, strict=True) if cell
            )
            for option, cells in compared.items()
        }
        return f"Decision: {self._name(self._chosen)}", facts or {"why": RULE}

    @classmethod
    def exact(
        cls, action: int, values: NDArray[np.float64], bonus: NDArray[np.float64] | None = None
    ) -> "Decision":
        """Return a decision with exact values (E+1,); nan marks actions without a value."""
        visits = np.zeros(len(values), dtype=np.int64)
        bonuses = np.zeros(len(values)) if bonus is None else bonus
        return cls(action, values, no_errors(values), visits, bonus=bonuses)


def no_errors(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard errors of exact values: 0, and nan where one is not valued."""
    return np.where(np.isnan(values), np.nan, 0.0)


@dataclass(frozen=True, slots=True)
class History:
    """The steps of a trial so far, on which a policy may depend.

    Attributes
    ----------
    belief : Belief
        Belief after these steps.
    actions : tuple[int, ...]
        Index of each executed behavior, in order.
    perceived : tuple[bool, ...]
        Whether each action yielded a percept.
    moved : tuple[int, ...]
        Index of the state after each action.
    cost : float
        Cost of these steps, s.
    unread : tuple[int, ...]
        Positions of actions whose features could not be read.
    """

    belief: Belief
    actions: tuple[int, ...] = ()
    perceived: tuple[bool, ...] = ()
    moved: tuple[int, ...] = ()
    cost: float = 0.0
    unread: tuple[int, ...] = ()

    def after(
        self, belief: Belief, action: int, perceived: bool, cost: float, *, unread: bool = False
    ) -> "History":
        """Return the history after one more behavior, given its cost and the belief after it."""
        return History(
            belief,
            actions=(*self.actions, action),
            perceived=(*self.perceived, perceived),
            moved=(*self.moved, belief.x),
            cost=self.cost + cost,
            unread=(*self.unread, len(self.actions)) if unread else self.unread,
        )


@runtime_checkable
class Policy(Protocol):
    """Protocol of policies, whose method `decide` chooses the next action of a trial.

    A policy may have an attribute `deterministic`. If it is true, a decision depends only on the
    belief and the random generator, and may be cached.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> domain = meal_bayes.load_domain("toy")
    >>> query = meal_bayes.Query(domain.attributes[:1])
    >>> rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    >>> momdp = meal_bayes.build_momdp(domain, query, rows)
    >>> from meal_bayes.planners import History
    >>> rng = np.random.default_rng(0)
    >>> policy = meal_bayes.POMCP(simulations=50).solve(momdp, rng)
    >>> isinstance(policy, meal_bayes.Policy)
    True
    """

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the next action.

        Parameters
        ----------
        history : History
            The steps of the trial so far; `history.belief` is the belief after them.
        rng : np.random.Generator
            Random generator to use. Other sources of randomness make trials irreproducible.

        Returns
        -------
        decision : Decision
            A legal behavior or an answer, with its values if the policy computes values.
        """
        ...


@runtime_checkable
class Solver(Protocol):
    """Protocol of planners, whose method `solve` returns a policy for a MOMDP.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> domain = meal_bayes.load_domain("toy")
    >>> query = meal_bayes.Query(domain.attributes[:1])
    >>> rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    >>> momdp = meal_bayes.build_momdp(domain, query, rows)
    >>> from meal_bayes.planners import History
    >>> rng = np.random.default_rng(0)
    >>> isinstance(meal_bayes.POMCP(), meal_bayes.Solver)
    True
    """

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Policy:
        """Return a policy for a MOMDP.

        Parameters
        ----------
        momdp : MOMDP
            The decision problem of a question.
        rng : np.random.Generator
            Random generator to use while solving.

        Returns
        -------
        policy : Policy
            A new policy for each call.
        """
        ...


@dataclass(slots=True)
class MemoizedPolicy:
    """A deterministic policy that stores its decision for each state with its percept counts.

    Each search has its own random stream, so decisions do not depend on the order of trials.
    """

    policy: Policy
    _decisions: dict[tuple[int, bytes], Decision] = field(default_factory=dict)

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the next action; equal beliefs get the same decision."""
        belief = history.belief
        key = belief.x, belief.percept_counts.tobytes()
        if key not in self._decisions:
            counts = hashlib.blake2b(key[1], digest_size=8).hexdigest()
            policy_rng = stream(0, "remembered decisions", belief.x, counts)
            self._decisions[key] = self.policy.decide(history, policy_rng)
        return self._decisions[key]


def unvalued(momdp: MOMDP, action: int) -> Decision:
    """Return the decision of a policy that does not compute values."""
    return Decision.exact(action, np.full(momdp.n_behaviors + 1, np.nan))


def is_worth_going_on(value: float, ending: float) -> bool:
    """Return whether to execute a behavior of this value if answering has the value `ending`.

    All planners that compare values stop by this rule, in `choose` and in `search.policy._certain`.
    `Greedy` has its own rule.
    """
    return value > ending


def choose(
    momdp: MOMDP, belief: Belief, values: Floats, bonus: Floats | None = None
) -> tuple[int, Floats, Floats]:
    """Choose the behavior with the highest value, or the answer if its value is at least as high.

    Parameters
    ----------
    momdp : MOMDP
        The problem.
    belief : Belief
        Belief for which to choose.
    values : NDArray[np.float64]
        (E,) values of the behaviors, including the exploration bonus; -inf if not legal.
    bonus : NDArray[np.float64] | None
        (E,) exploration bonus of the behaviors; none by default.

    Returns
    -------
    tuple
        The action; the values (E+1,) of all behaviors (nan for -inf) and of the best answer,
        without exploration bonus; and the bonus (E+1,). These are the arguments of
        `Decision.exact`.
    """
    best = int(values.argmax())
    ending = answer_value(momdp, belief)
    going_on = is_worth_going_on(values[best], ending)
    action = best if going_on else best_answer(momdp, belief)
    bonuses = np.zeros(momdp.n_behaviors + 1)
    if bonus is not None:
        bonuses[:-1] = np.where(np.isneginf(values), 0.0, bonus)
    total = np.append(values, ending)
    return action, np.where(np.isneginf(total), np.nan, total) - bonuses, bonuses


# --- The boundary


def checked_solver(value: object, agent: str) -> Solver:
    """Return the planner of an agent; raise `SettingsError` if it is not one."""
    if not callable(getattr(value, "solve", None)):
        raise SettingsError(
            f"The planner of agent {agent!r} is {value!r:.60}; expected an object with a method "
            "solve(momdp, rng)."
        )
    solver: Any = value
    return solver  # type: ignore[no-any-return]


def solve(solver: Solver, momdp: MOMDP, rng: np.random.Generator) -> Policy:
    """Return a planner's policy; raise `SettingsError` if it does not return one."""
    policy: Any = solver.solve(momdp, rng)
    if not callable(getattr(policy, "decide", None)):
        raise SettingsError(
            f"solve() of the planner {type(solver).__name__} returned {policy!r:.60}; expected a "
            "policy, an object with a method decide(history, rng)."
        )
    return policy  # type: ignore[no-any-return]


def decide(policy: Policy, history: History, rng: np.random.Generator) -> Decision:
    """Return a policy's decision; raise `SettingsError` if it is not one."""
    decision: object = policy.decide(history, rng)
    if not isinstance(decision, Decision):
        raise SettingsError(
            f"decide() of the policy {type(policy).__name__} returned {decision!r:.60}; expected a "
            "Decision, as of `unvalued(momdp, action)`."
        )
    if not is_whole(decision.action):
        raise SettingsError(
            f"decide() of the policy {type(policy).__name__} chose the action "
            f"{decision.action!r:.60}; expected its index, as of momdp.behavior_names.index(name)."
        )
    return decision
