"""Each rule that a solver owes is broken once, and told; the package's solvers keep them all."""

import random
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from meal_bayes.errors import ConformanceError
from meal_bayes.momdp import MOMDP, best_report
from meal_bayes.planners import Decision, Greedy, History, Policy, Random, RandomLegal, unvalued
from meal_bayes.testing import check_solver, example_problems


class Sound:
    """Executes what is legal and was executed least often, then reports; faults are planted."""

    def __init__(self, **faults: bool) -> None:
        self.faults = faults
        self.lock = threading.Lock() if faults.get("unsendable") else None
        self.shared: dict[str, Any] = {}

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Policy:
        if self.faults.get("changes the problem"):
            momdp.cost.setflags(write=True)
            momdp.cost[0] += 1
        if self.faults.get("shares what it solved"):
            self.shared["momdp"] = momdp
        if self.faults.get("returns no policy"):
            return None  # type: ignore[return-value]
        return SoundPolicy(momdp, self.faults, self.shared)


class SoundPolicy:
    def __init__(self, momdp: MOMDP, faults: dict[str, bool], shared: dict[str, Any]) -> None:
        self.own = momdp
        self.faults = faults
        self.shared = shared
        self.decided = 0
        if faults.get("claims to be deterministic"):
            self.deterministic = True

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        faults = self.faults
        momdp = self.shared.get("momdp", self.own)
        e = momdp.n_behaviors
        belief = history.belief
        self.decided += 1
        legal = np.flatnonzero(momdp.legal[belief.x]).tolist()
        action = best_report(momdp, belief)
        if legal and len(history.actions) < 4:
            action = min(legal, key=history.actions.count)
        if faults.get("commands what is illegal") and len(legal) < e:
            action = next(b for b in range(e) if b not in legal)
        if faults.get("commands what does not exist"):
            action = momdp.n_actions
        if faults.get("names its action"):
            values = np.full(momdp.n_behaviors + 1, np.nan)
            return Decision.exact(momdp.behavior_names[0], values)  # type: ignore[arg-type]
        if faults.get("draws without a seed") and legal:
            action = int(np.random.default_rng().choice(legal))
        if faults.get("draws from NumPy's global generator"):
            np.random.random()  # noqa: NPY002
        if faults.get("draws from NumPy's global generator once") and self.decided == 5:
            np.random.random()  # noqa: NPY002
        if faults.get("draws from Python's global generator"):
            random.random()
        if faults.get("remembers trials") and self.decided > 13:
            action = best_report(momdp, belief)
        if faults.get("changes the history"):
            belief.percept_counts.setflags(write=True)
            belief.percept_counts[...] += 1
        if faults.get("fails where beliefs are certain") and np.isinf(belief.log_prob).any():
            raise ZeroDivisionError
        decision = unvalued(momdp, action)
        if faults.get("returns a number"):
            return action  # type: ignore[return-value]
        if faults.get("has a value too few"):
            decision = Decision.exact(action, np.full(e, np.nan))
        if faults.get("has infinite values"):
            decision = Decision.exact(action, np.full(e + 1, -np.inf))
        if faults.get("has negative errors"):
            decision = replace(decision, value_se=np.full(e + 1, -1.0))
        if faults.get("has a negative gap"):
            decision = replace(decision, gap=-1.0)
        return decision


FAULTS = {
    "commands what is illegal": "where only .* are legal",
    "commands what does not exist": "commands action .* expected 0 to",
    "names its action": "Give an index",
    "returns a number": "returned int. Return a Decision",
    "returns no policy": r"solve\(\) returned None. Return a policy",
    "has a value too few": r"Decision.values has shape .* one entry for each behavior",
    "has infinite values": "Give NaN for no value",
    "has negative errors": "are negative",
    "has a negative gap": "gap is -1.0",
    "draws without a seed": "another policy of it decides differently",
    "draws from NumPy's global generator": "draws from a global generator",
    "draws from NumPy's global generator once": "draws from a global generator",
    "draws from Python's global generator": "draws from a global generator",
    "remembers trials": "the same policy in a later trial decides differently",
    "changes the history": "changes the history.*copy what you change",
    "changes the problem": "changes the MOMDP",
    "shares what it solved": "problem 0: ",
    "claims to be deterministic": "Leave `deterministic` out",
    "fails where beliefs are certain": "ZeroDivisionError.*also where .* the belief is certain",
    "unsendable": "cannot be sent to other processes",
}


def test_a_sound_solver_passes() -> None:
    check_solver(Sound())


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found(fault: str) -> None:
    np.random.random()  # noqa: NPY002  # so that the next draw moves its position alone
    with pytest.raises(ConformanceError, match=FAULTS[fault]) as told:
        check_solver(Sound(**{fault: True}))
    assert "Sound" in str(told.value)
    assert "\n" not in str(told.value)


def test_what_is_no_solver_is_told() -> None:
    for found in (Sound, object(), None):
        with pytest.raises(
            ConformanceError, match=r"A solver is an object with solve\(momdp, rng\)"
        ):
            check_solver(found)  # type: ignore[arg-type]


@pytest.mark.parametrize("solver", [Random(), RandomLegal(30.0), Greedy()], ids=str)
def test_shipped_solvers_pass(solver: Any) -> None:
    check_solver(solver, seed=3)


def test_problems_are_of_many_kinds() -> None:
    problems = list(example_problems())
    known = list(example_problems(known_rows=True))
    assert all(np.isinf(momdp.precision).all() for momdp in known)
    assert any(np.isfinite(momdp.precision).all() for momdp in problems)
    assert any(momdp.latent_classes.shape[-1] > 2 for momdp in problems)
    assert any(momdp.abstain for momdp in known)
    assert any((momdp.limit == 0).all() for momdp in known)
    assert {momdp.levels for momdp in known} == {2, 4}
    assert {len(momdp.query) for momdp in known} == {1, 2, 3}


class OnePolicy:
    """Returns one object, whatever it solves."""

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Policy:
        self.momdp = momdp
        return self

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        return unvalued(self.momdp, best_report(self.momdp, history.belief))


class Writing:
    """Writes into the arrays of its problem, which are read-only."""

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Policy:
        momdp.cost[0] = 0.0
        raise AssertionError


def test_what_is_shared_or_written_is_told_with_its_mend() -> None:
    with pytest.raises(ConformanceError, match=r"one policy object for two problems.*a new one"):
        check_solver(OnePolicy())
    with pytest.raises(ConformanceError, match=r"read-only\. .*are values: copy what you change"):
        check_solver(Writing())
