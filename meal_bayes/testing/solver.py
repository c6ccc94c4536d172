"""The check of a solver: what its policies decide, from what, and whether they repeat it."""

import copy
import random
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import cloudpickle
import numpy as np

from meal_bayes.arrays import check_kind, check_whole
from meal_bayes.errors import ConformanceError, MealBayesError
from meal_bayes.momdp import MOMDP, Transition, initial_belief, update_belief
from meal_bayes.momdp.belief import percepts_left
from meal_bayes.planners import Decision, History, Solver
from meal_bayes.testing.problems import example_problems

Result = TypeVar("Result")


def check_solver(
    solver: Solver, problems: Iterable[MOMDP] | None = None, *, seed: int = 0, steps: int = 12
) -> None:
    """Check a solver on problems of many kinds.

    The solver must solve each problem. At every belief, it must choose a legal behavior or an
    answer, and return values of the right shape. With equal random generators it must repeat its
    decisions, whatever it solved or decided before. It must not change the problem, the history, or
    NumPy's global generator. The quality of decisions is not checked: a solver that never answers,
    or always abstains, passes.

    Parameters
    ----------
    solver : Solver
        An object with a method `solve(momdp, rng)`.
    problems : Iterable[MOMDP] | None
        Problems to solve; `example_problems()` by default. If the solver is made for one kind of
        problem only, pass problems of this kind, such as `example_problems(known_rows=True)`.
    seed : int
        Seed of the simulated trials.
    steps : int
        Maximum number of steps of a trial.

    Raises
    ------
    ConformanceError
        The check failed; the message says what was found, what was expected, and how to correct it.
    """
    candidate: Any = solver  # users give anything
    name = type(solver).__name__
    if isinstance(candidate, type) or not callable(getattr(candidate, "solve", None)):
        raise ConformanceError(
            f"A solver is an object with solve(momdp, rng); found {candidate!r:.60}. "
            "Give an instance of a class that has this method."
        )
    check_whole("steps", steps)
    check_whole("seed", seed)
    momdps = list(example_problems(seed)) if problems is None else _listed(problems)
    _check_processes(solver, name)
    for number, momdp in enumerate(momdps):
        other = momdps[number - 1]
        if other is momdp:  # the only one: the same with percepts turned round
            other = replace(momdp, confusion=momdp.confusion[..., ::-1])
        _Check(solver, momdp, f"{name}, problem {number}").play(other, seed, steps)


def _check_processes(solver: Any, name: str) -> None:
    try:
        cloudpickle.dumps(solver)
    except Exception as fault:  # whatever an object raises that cannot be copied
        raise ConformanceError(
            f"{name} cannot be sent to other processes, as runs with several jobs do "
            f"({type(fault).__name__}: {fault}). Make open files, locks and threads in solve()."
        ) from fault


def _listed(problems: Any) -> list[MOMDP]:
    """Return problems as a list; refuse what are none."""
    momdps = list(problems) if isinstance(problems, Iterable) else [problems]
    for momdp in momdps:
        check_kind("problem", momdp, MOMDP)
    return momdps


class _Check:
    """A solver on one problem; `where` begins every message."""

    def __init__(self, solver: Any, momdp: MOMDP, where: str) -> None:
        self.solver = solver
        self.momdp = momdp
        self.where = where

    def fail(self, fault: str, mend: str) -> ConformanceError:
        return ConformanceError(f"{self.where}: {fault.removesuffix('.')}. {mend}")

    def play(self, other: MOMDP, seed: int, steps: int) -> None:
        """Follow the policy where it goes; where it would answer, take any legal behavior."""
        rng = np.random.default_rng(seed)
        policy = self.solve(self.momdp)
        again = self.solve(self.momdp)
        # Another problem must not change what was solved before.
        if self.solve(other) is policy:
            raise self.fail(
                "solve() returned one policy object for two problems.",
                "Return a new one each time, which keeps what it needs of its own problem.",
            )
        history = History(initial_belief(self.momdp))
        decided: list[tuple[History, int, Decision]] = []
        for step in range(steps):
            policy_seed = int(rng.integers(2**31))
            decision = self.decide(policy, history, policy_seed)
            self.check(decision, history)
            repeated = self.decide(again, history, policy_seed)
            self.check_repeats(decision, repeated, "another policy of it")
            decided.append((history, policy_seed, decision))
            legal = np.flatnonzero(self.momdp.legal[history.belief.x])
            if not len(legal):
                break
            # Beliefs that the policy itself would not reach are visited, too.
            action = int(decision.action)
            if action >= self.momdp.n_behaviors or step % 3 == 2:
                action = int(rng.choice(legal))
            history = _executed(self.momdp, history, action, rng)
        for history, policy_seed, decision in decided:  # as the next trial would
            later = self.decide(policy, history, policy_seed)
            self.check_repeats(decision, later, "the same policy in a later trial")
        self.check_deterministic(policy, decided)

    def solve(self, momdp: MOMDP) -> Any:
        """Return the policy, which is fresh for each call."""
        with self.unchanged(momdp, "solve() changes the MOMDP.", "Copy what you change."):
            policy = self.call(
                "solve()", lambda: self.solver.solve(momdp, np.random.default_rng(1))
            )
        if isinstance(policy, type) or not callable(getattr(policy, "decide", None)):
            raise self.fail(
                f"solve() returned {policy!r:.60}.",
                "Return a policy: an object with a method decide(history, rng).",
            )
        return policy

    def decide(self, policy: Any, history: History, policy_seed: int) -> Decision:
        """Return the policy's decision, of which only the kind has been checked."""
        mend = "Histories, beliefs and MOMDPs are values: copy what you change."
        with (
            self.unchanged(history, "decide() changes the history.", mend),
            self.unchanged(self.momdp, "decide() changes the MOMDP.", mend),
        ):
            decision = self.call(
                f"decide() after {len(history.actions)} steps, in "
                f"{self.momdp.x_names[history.belief.x]!r}",
                lambda: policy.decide(history, np.random.default_rng(policy_seed)),
            )
        if not isinstance(decision, Decision):
            raise self.fail(
                f"decide() returned {type(decision).__name__}.",
                "Return a Decision; unvalued(momdp, action) makes one of an action alone.",
            )
        return decision

    def call(self, what: str, function: Callable[[], Result]) -> Result:
        """Call the solver's own code; global generators must stay as they are."""
        before = _global_states()
        try:
            result = function()
        except Exception as fault:  # whatever it raises
            mend = (
                "It must decide at every belief that can come about, also where percepts have run "
                "out or the belief is certain (log-odds of plus and minus infinity)."
            )
            if "read-only" in str(fault):
                mend = "Histories, beliefs and MOMDPs are values: copy what you change."
            raise self.fail(f"{what} raised {type(fault).__name__}: {fault}", mend) from fault
        if _global_states() != before:
            raise self.fail(
                f"{what} draws from a global generator.",
                "Draw from the rng that is given, so that runs repeat under a seed.",
            )
        return result

    @contextmanager
    def unchanged(self, value: object, fault: str, mend: str) -> Iterator[None]:
        before = copy.deepcopy(value)
        yield
        if not _equal(before, value):
            raise self.fail(fault, mend)

    def check(self, decision: Decision, history: History) -> None:
        """Check a decision: legal, or an answer; and values where they belong."""
        momdp = self.momdp
        if isinstance(decision.action, bool) or not isinstance(decision.action, int | np.integer):
            raise self.fail(
                f"the action is {decision.action!r:.60}.",
                f"Give an index: below {momdp.n_behaviors} a behavior, from there on a report.",
            )
        try:
            momdp.check_action(history.belief.x, int(decision.action))
        except MealBayesError as fault:
            raise self.fail(str(fault), "momdp.legal[belief.x] has the legal behaviors.") from fault
        shape = (momdp.n_behaviors + 1,)
        for field in ("values", "value_se", "visits"):
            actual = np.shape(getattr(decision, field))
            if actual != shape:
                raise self.fail(
                    f"Decision.{field} has shape {actual}.",
                    f"Give {shape}: one entry for each behavior, then one for the best answer.",
                )
        if np.isinf(decision.values).any():
            raise self.fail(
                f"Decision.values hold infinity: {decision.values}.", "Give NaN for no value."
            )
        if (decision.value_se < 0).any() or (np.asarray(decision.visits) < 0).any():
            raise self.fail(
                "Decision.value_se or visits are negative.",
                "A standard error is 0 if the value is exact, and NaN if the error is unknown; "
                "visits are numbers of simulations.",
            )
        if decision.gap is not None and not decision.gap >= 0:
            raise self.fail(
                f"Decision.gap is {decision.gap}.",
                "It is an upper bound of the loss of this decision: a number >= 0, or None.",
            )

    def check_repeats(self, first: Decision, second: Decision, whose: str) -> None:
        """Check that two decisions from equal histories and generators are equal."""
        if not _equal(first, second):
            raise self.fail(
                f"from the same history and generator, {whose} decides differently: "
                f"action {first.action} with {first.values}, then {second.action} with "
                f"{second.values}.",
                "Draw from the rng that is given alone; keep nothing from one trial or problem to "
                "the next: let solve() return a new policy object each time.",
            )

    def check_deterministic(
        self, policy: Any, decided: list[tuple[History, int, Decision]]
    ) -> None:
        """Check of a policy that says so that its decisions depend on the belief alone."""
        if not getattr(policy, "deterministic", False):
            return
        for history, policy_seed, decision in decided:
            # The same belief, reached by nothing: what else it reads of a history is missing.
            bare = self.decide(policy, History(history.belief), policy_seed)
            if bare.action != decision.action:
                raise self.fail(
                    f"it says that it is deterministic, and decides for {bare.action} instead of "
                    f"{decision.action} where the history lacks the steps before.",
                    "Leave `deterministic` out where decisions depend on more than the belief.",
                )


def _executed(momdp: MOMDP, history: History, action: int, rng: np.random.Generator) -> History:
    """Take any outcome that is possible, and any percept that is."""
    belief = history.belief
    percept = None
    x = int(rng.choice(np.flatnonzero(momdp.transition[action, belief.x])))
    # Any level of positive probability may come, by no rows in particular.
    available = percepts_left(momdp, belief)[action] > 0
    if momdp.observation_probability[action, belief.x, x] > rng.random() and available:
        rows = np.einsum("nc,nck->nk", np.exp(belief.log_prob), momdp.confusion[:, action])
        percept = np.array([rng.choice(np.flatnonzero(row > 0)) for row in rows])
    after = update_belief(belief, momdp, Transition(action, x, percept))
    cost = momdp.charged_for(action, belief.x, x, perceived=percept is not None)
    return history.after(after, action, percept is not None, cost)


def _global_states() -> tuple[object, ...]:
    """Return the states of the global generators of NumPy and of Python."""
    numpy: dict[str, Any] = np.random.get_state(legacy=False)  # noqa: NPY002
    # Most draws move the position alone; the key changes once in 624 words.
    twister = numpy["state"]["key"].tobytes(), numpy["state"]["pos"]
    return twister, numpy["has_gauss"], numpy["gauss"], random.getstate()


def _equal(first: Any, second: Any) -> bool:
    """Compare values field by field, arrays with NaN equal to NaN."""
    if is_dataclass(first) and type(first) is type(second):
        return all(_equal(getattr(first, f.name), getattr(second, f.name)) for f in fields(first))
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second, equal_nan=first.dtype.kind in "fc")
    return bool(first == second)
