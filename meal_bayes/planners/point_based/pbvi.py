"""Point-based value iteration (after [Pineau2003]) of MOMDPs (as in [Ong2010]).

A backup keeps one alpha vector for each x and belief point; the points are beliefs that simulated
trials reach, first at random, then mostly under the plan so far. Every vector is the value of a
plan that exists, so that what the vectors promise is a lower bound on the optimum.

What departs from the textbook: geometric failures are summed out; points are compared by the
square roots of their probabilities, which is finer near certainty, where the last percepts pay; a
sweep's backups see the vectors of the same sweep.
"""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.point_based.alpha_vectors import AlphaVectorPolicy, AlphaVectors
from meal_bayes.planners.point_based.problem import (
    Choice,
    Floats,
    Plans,
    Problem,
    problem_of,
)

_BLOCK = 4_000_000  # products of beliefs and vectors held at a time
_RANDOM = np.array([0.1, 0.3])  # fraction of random actions, half of the trials each

_Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PBVI:
    """Settings; equal generators give equal policies, unless the time runs out.

    Attributes
    ----------
    points : beliefs of each x, at most.
    rounds : of collecting points and sweeping over them.
    sweeps : a round, at most.
    tolerance : sweeps end when no point gains as much reward.
    trials : simulated in a round to collect points.
    steps : of a simulated trial, at most.
    spacing : between points, in square roots of probabilities; halved every round.
    seconds : no sweep begins after that.

    Raises
    ------
    SettingsError : a number that is out of its range.
    """

    points: int = 500
    rounds: int = 5
    sweeps: int = 200
    tolerance: float = 0.01
    trials: int = 200
    steps: int = 60
    spacing: float = 0.1
    seconds: float = np.inf

    def __post_init__(self) -> None:
        whole = min(self.points, self.rounds, self.sweeps, self.trials, self.steps)
        if whole < 1 or not (self.tolerance >= 0 and self.spacing > 0 and self.seconds > 0):
            raise SettingsError(
                "PBVI needs points, rounds, sweeps, trials and steps >= 1, tolerance >= 0, "
                f"spacing > 0 and seconds > 0; found {self}."
            )

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> AlphaVectorPolicy:
        """Solve a MOMDP; the policy's `lower_bound` is one on the optimum (but for `limit`).

        Raises
        ------
        SettingsError : finite precision, several latent classes a truth, or too many attributes.
        """
        problem = problem_of(momdp)
        deadline = time.monotonic() + self.seconds
        plans = list(problem.known)
        points = [np.empty((0, len(problem.start)))] * len(plans)
        for index in range(self.rounds):
            points = self._collect(problem, plans, points, index, rng)
            for _ in range(self.sweeps):
                if time.monotonic() > deadline or _sweep(problem, plans, points) <= self.tolerance:
                    break
        alpha = AlphaVectors(
            np.concatenate([plan.vectors for plan in plans]),
            np.repeat(np.arange(len(plans)), [len(plan.actions) for plan in plans]),
            np.concatenate([plan.actions for plan in plans]),
        )
        return AlphaVectorPolicy(momdp, alpha)

    def _collect(
        self,
        problem: Problem,
        plans: list[Plans],
        points: list[Floats],
        index: int,
        rng: np.random.Generator,
    ) -> list[Floats]:
        """Add the beliefs that simulated trials meet; the start always stays a point."""
        random = np.resize(_RANDOM, self.trials) if index else np.ones(self.trials)
        met = _simulate(problem, plans, random, self.steps, rng)
        both = map(np.concatenate, zip(points, met, strict=True))
        out = [self._thin(beliefs, self.spacing / 2**index, rng) for beliefs in both]
        out[problem.start_x] = np.concatenate([problem.start[None], out[problem.start_x]])
        return out

    def _thin(self, beliefs: Floats, spacing: float, rng: np.random.Generator) -> Floats:
        """Keep one belief of each cell, and no more than `points`."""
        cells = np.round(np.sqrt(beliefs) / spacing).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        first = np.sort(first)
        if len(first) > self.points:
            first = np.sort(rng.choice(first, self.points, replace=False))
        return beliefs[first]


def _sweep(problem: Problem, plans: list[Plans], points: list[Floats]) -> float:
    """Update every point, replacing `plans`; return the largest gain of any point."""
    gain = 0.0
    for x in reversed(range(len(plans))):
        beliefs, known = points[x], problem.known[x]
        if not len(beliefs):
            continue
        products = beliefs @ plans[x].vectors.T
        best, before = products.argmax(axis=1), products.max(axis=1)
        vectors, actions, values = plans[x].vectors[best], plans[x].actions[best], before.copy()
        for choice in problem.choices[x]:
            ahead = _look_ahead(choice, plans, beliefs)
            value = (ahead * beliefs).sum(axis=1)
            better = value > values
            vectors[better], values[better] = ahead[better], value[better]
            actions[better] = choice.action
        gain = max(gain, float((values - before).max()))
        vectors = np.concatenate([known.vectors, vectors])
        _, first = np.unique(vectors.round(9), axis=0, return_index=True)
        first.sort()
        plans[x] = Plans(vectors[first], np.concatenate([known.actions, actions])[first])
    return gain


def _look_ahead(choice: Choice, plans: list[Plans], beliefs: Floats) -> Floats:
    """Compute the vector of an action followed by the best plan for each outcome, (n,Y)."""
    n_y = beliefs.shape[1]
    vector = np.tile(choice.reward, (len(beliefs), 1))
    for next_x in np.unique(choice.next_x):
        outcome = choice.outcome[choice.next_x == next_x]  # (Q,Y,Y)
        after = np.einsum("ny,qyz->nqz", beliefs, outcome, optimize=True).reshape(-1, n_y)
        follow = plans[next_x].vectors
        best = np.empty(len(after), dtype=np.int64)
        step = max(1, _BLOCK // len(follow))
        for begin in range(0, len(after), step):
            best[begin : begin + step] = (after[begin : begin + step] @ follow.T).argmax(axis=1)
        taken = follow[best].reshape(len(beliefs), -1, n_y)
        vector += np.einsum("qyz,nqz->ny", outcome, taken, optimize=True)
    return vector


def _simulate(
    problem: Problem,
    plans: list[Plans],
    random: Floats,
    steps: int,
    rng: np.random.Generator,
) -> list[Floats]:
    """Simulate trials and collect the beliefs met at each x.

    Parameters
    ----------
    problem : what can be done.
    plans : what is done, mostly; a plan that reports ends the trial.
    random : (trials,) fraction of steps at which an action is drawn instead.
    steps : of a trial, at most.
    rng : of actions and outcomes.
    """
    xs = np.full(len(random), problem.start_x)
    beliefs = np.tile(problem.start, (len(random), 1))
    met = [[np.empty((0, len(problem.start)))] for _ in plans]
    walking = np.ones(len(random), dtype=bool)
    for _ in range(steps):
        at = xs.copy()
        for x in np.unique(at[walking]):
            here = np.flatnonzero(walking & (at == x))
            met[x].append(beliefs[here])
            legal = np.array([choice.action for choice in problem.choices[x]], dtype=np.int64)
            picked = plans[x].actions[(beliefs[here] @ plans[x].vectors.T).argmax(axis=1)]
            if len(legal):
                drawn = rng.random(len(here)) < random[here]
                picked = np.where(drawn, rng.choice(legal, len(here)), picked)
            walking[here] = np.isin(picked, legal)
            for choice in problem.choices[x]:
                moving = here[picked == choice.action]
                if len(moving):
                    xs[moving], beliefs[moving] = _draw(choice, beliefs[moving], rng)
    return [np.concatenate(part) for part in met]


def _draw(choice: Choice, beliefs: Floats, rng: np.random.Generator) -> tuple[_Integers, Floats]:
    """Draw an outcome for each belief: next x, next belief."""
    after = np.einsum("ny,qyz->nqz", beliefs, choice.outcome, optimize=True)
    limits = after.sum(axis=2).cumsum(axis=1)  # (n,Q), up to the discount
    uniform = rng.random(len(beliefs)) * limits[:, -1]
    drawn = (limits <= uniform[:, None]).sum(axis=1).clip(max=limits.shape[1] - 1)
    taken = after[np.arange(len(beliefs)), drawn]
    return choice.next_x[drawn], taken / taken.sum(axis=1, keepdims=True)
