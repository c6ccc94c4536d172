"""Active inference by pymdp as a solver of our MOMDPs: `pip install inferactively-pymdp`."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from pymdp.agent import Agent
from pymdp.control import Policies

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, best_answer, initial_belief
from meal_bayes.planners import Decision, History, unvalued
from meal_bayes.planners.momdp_arrays import Dynamics, dynamics_of

_MOST_PLANS = 4_000  # of one state: longer ones are left out before shorter ones


@dataclass(frozen=True, slots=True)
class Pymdp:
    """The plan of the least expected free energy, as long as it is better than to answer at once.

    pymdp is given what helps it: the exact belief, behaviors that never fail (their costs count the
    failures), only plans that are legal, and the most valuable answer where it answers. What an
    answer is worth by the belief of now is the same after all plans, as a plan of active inference
    foresees how much percepts will tell, but not what answers they will change.
    """

    steps: int = 3  # of a plan, at most
    scale: float = 0.002  # of preferences, nats a second

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "PymdpPolicy":
        """Lay the MOMDP out as models of pymdp, one for each state that plans begin in."""
        dynamics = dynamics_of(momdp)
        if not np.isinf(momdp.precision).all() or not momdp.class_is_truth or momdp.bonus.any():
            raise SettingsError("pymdp is given known rates without a bonus, no finite precision.")
        if np.count_nonzero(dynamics.branch["p"], axis=2).max() > 1:
            raise SettingsError("A behavior that succeeds has several outcomes; give it one.")
        plans = [_plans_from(dynamics, x, self.steps) for x in range(momdp.terminal)]
        policy = PymdpPolicy(
            momdp,
            int(dynamics.step["legal"].sum()),
            plans,
            [_scores(_agent(momdp, dynamics, of_x, self)) if of_x else None for of_x in plans],
        )
        for x in range(momdp.terminal):
            policy.worth(replace(initial_belief(momdp), x=x))  # compiled before decisions are timed
        return policy


@dataclass(frozen=True, slots=True)
class PymdpPolicy:
    """Policy of `Pymdp`."""

    momdp: MOMDP
    pairs: int  # of a state and a legal behavior
    plans: list[list[tuple[int, ...]]]  # of each state
    scores: list[Callable[[list[jnp.ndarray]], jnp.ndarray] | None]

    def worth(self, belief: Belief) -> np.ndarray:
        """Return minus the expected free energy of each plan."""
        score = self.scores[belief.x]
        if score is None:
            return np.zeros(0)
        # Places are the legal pairs, then the states themselves, then the end of a plan.
        place = np.zeros(self.pairs + self.momdp.terminal + 1)
        place[self.pairs + belief.x] = 1.0
        truths = np.stack([1 - belief.positive, belief.positive], axis=1)  # (N,2)
        return np.asarray(score([jnp.asarray(part)[None, None] for part in (*truths, place)]))

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the first behavior of the best plan, or answer where none is worth its cost."""
        belief = history.belief
        worth = self.worth(belief)
        action = best_answer(self.momdp, belief)
        if worth.max(initial=0.0) > 0:
            action = self.plans[belief.x][int(worth.argmax())][0]
        return unvalued(self.momdp, action)


def _scores(agent: Agent) -> Callable[[list[jnp.ndarray]], jnp.ndarray]:
    return jax.jit(lambda states: agent.infer_policies(states)[1][0])


def _plans_from(dynamics: Dynamics, x: int, steps: int) -> list[tuple[int, ...]]:
    """List the legal sequences of behaviors from x, the shortest first."""
    plans: list[tuple[int, ...]] = []
    ends = [((), x)]
    for _ in range(steps):
        ends = [
            ((*plan, int(e)), int(dynamics.branch["x"][at, e, 0]))
            for plan, at in ends
            for e in np.flatnonzero(dynamics.step["legal"][at])
        ]
        plans.extend(plan for plan, _ in itertools.islice(ends, _MOST_PLANS - len(plans)))
    return plans


def _agent(
    momdp: MOMDP, dynamics: Dynamics, plans: list[tuple[int, ...]], settings: Pymdp
) -> Agent:
    """Build the agent that compares plans.

    Factors are the attributes and the place, which is the last pair of a state and a behavior.
    Modalities are the attributes' percepts (or none), and the place, by which costs are preferred.
    """
    pairs = np.argwhere(dynamics.step["legal"])
    number = {(x, e): m for m, (x, e) in enumerate(pairs.tolist())}
    states = momdp.terminal
    places = len(pairs) + states + 1
    end = places - 1
    levels = momdp.levels
    moves = np.zeros((places, places, momdp.n_behaviors + 1))  # the last action ends a plan
    moves[end] = 1.0
    at = [*dynamics.branch["x"][pairs[:, 0], pairs[:, 1], 0].tolist(), *range(states)]
    for place, x in enumerate(at):
        for e in np.flatnonzero(dynamics.step["legal"][x]).tolist() if x < states else ():
            moves[:, place, e] = np.eye(places)[number[x, e]]
    percepts = np.zeros((len(momdp.query), levels + 1, 2, places))
    percepts[:, levels] = 1.0
    for m, (x, e) in enumerate(pairs.tolist()):
        if dynamics.branch["senses"][x, e, 0]:
            percepts[:, :levels, :, m] = momdp.confusion[:, e].transpose(0, 2, 1)
            percepts[:, levels, :, m] = 0.0
    cost = np.zeros(places)
    cost[: len(pairs)] = dynamics.step["cost"][pairs[:, 0], pairs[:, 1]]
    n = len(momdp.query)
    sequences = np.zeros((len(plans), settings.steps, n + 1), int)
    for plan, row in zip(plans, sequences[:, :, n], strict=True):
        row[:] = (*plan, *(momdp.n_behaviors,) * (settings.steps - len(plan)))
    batched = partial(map, lambda array: jnp.asarray(array, jnp.float32)[None])
    return Agent(
        A=list(batched([*percepts, np.eye(places)])),
        B=list(batched([*([np.eye(2)[:, :, None]] * n), moves])),
        C=list(batched([*([np.zeros(levels + 1)] * n), -settings.scale * cost])),
        D=list(batched([*([np.full(2, 0.5)] * n), np.eye(places)[0]])),
        A_dependencies=[*([i, n] for i in range(n)), [n]],
        B_dependencies=[[i] for i in range(n + 1)],
        num_controls=[*([1] * n), momdp.n_behaviors + 1],
        policies=Policies(jnp.asarray(sequences)),
    )
