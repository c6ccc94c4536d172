"""Planners of POMDPPlanners as solvers of our MOMDPs: `pip install POMDPPlanners`."""

import random
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from peer_tables import PeerTables
from POMDPPlanners.core.belief import WeightedParticleBelief
from POMDPPlanners.core.environment import DiscreteActionsEnvironment, SpaceInfo, SpaceType
from POMDPPlanners.core.policy import Policy as PeersPolicy
from POMDPPlanners.planners.mcts_planners.pomcp import POMCP
from POMDPPlanners.planners.mcts_planners.sparse_pft import SparsePFT

from meal_bayes.momdp import MOMDP, best_answer
from meal_bayes.planners import Decision, History

_DEPTH = 40  # steps of a simulation, at most; random roll-outs report long before
_CHILDREN = 4  # beliefs that an action may lead to, of Sparse-PFT

State = tuple[int, int]  # x, y
Observation = tuple[int, int]  # x', percept or none


@dataclass(frozen=True, slots=True)
class PomdpPlanners:
    """POMCP, or Sparse-PFT, a tree search over beliefs in which rewards are expectations.

    Both are given what pomdp-py is given: the exact belief, tables in place of arithmetic, only
    actions that a planner may choose, and the most probable report where they report. Sparse-PFT
    is given the exact filter, too, where the library's own would draw x' for each particle.
    """

    planner: str  # "pomcp" or "sparse-pft"
    simulations: int = 1500  # a decision

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "PomdpPlannersPolicy":
        """Lay the MOMDP out as an environment of the library."""
        problem = _Problem(momdp)
        make = {"pomcp": self._pomcp, "sparse-pft": self._sparse_pft}[self.planner]
        return PomdpPlannersPolicy(momdp, problem, make(problem), self.simulations)

    def _pomcp(self, problem: "_Problem") -> PeersPolicy:
        return POMCP(
            environment=problem,
            discount_factor=problem.discount_factor,
            depth=_DEPTH - 1,  # counted from 0
            exploration_constant=problem.spread,
            name=self.planner,
            n_simulations=self.simulations,
        )

    def _sparse_pft(self, problem: "_Problem") -> PeersPolicy:
        # It adds c N / sqrt(n) to an action's value, which at the last of N simulations is to be
        # UCB1's term, spread * sqrt(log N / n).
        n = self.simulations
        return SparsePFT(
            environment=problem,
            discount_factor=problem.discount_factor,
            depth=_DEPTH - 1,
            c_ucb=float(problem.spread * np.sqrt(np.log(n)) / n),
            beta_ucb=1.0,
            belief_child_num=_CHILDREN,
            name=self.planner,
            n_simulations=n,
        )


@dataclass(frozen=True, slots=True)
class PomdpPlannersPolicy:
    """Policy of `PomdpPlanners`; every decision grows a fresh tree, as ours does."""

    momdp: MOMDP
    problem: "_Problem"
    planner: PeersPolicy
    simulations: int

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Search from the present belief."""
        random.seed(int(rng.integers(2**63)))  # the library draws from Python's own generator,
        np.random.seed(int(rng.integers(2**32)))  # noqa: NPY002  and from NumPy's
        e = self.momdp.n_behaviors
        belief = history.belief
        (action,), _ = self.planner.action(_ExactBelief.at(belief.x, belief.joint))
        if action >= e:
            # It is spared choosing between answers by luck: ours knows the best one.
            action = best_answer(self.momdp, belief)
        unknown = np.full(e + 1, np.nan)
        visits = np.zeros(e + 1, dtype=np.int64)
        return Decision(action, unknown, unknown, visits, simulations=self.simulations)


class _ExactBelief(WeightedParticleBelief):
    """A particle of each (x, y) that is possible, weighted by its probability."""

    @classmethod
    def at(cls, x: int, probabilities: NDArray[np.float64]) -> "_ExactBelief":
        """Make the belief of probabilities (Y,) at a known x."""
        possible = np.flatnonzero(probabilities)
        # It normalizes them, and refuses those that are 0 alone.
        logs = np.log(probabilities[possible]) - 1.0
        return cls([(x, y) for y in possible.tolist()], logs)

    def update(
        self, action: int, observation: Observation, pomdp: "_Problem", state: State | None = None
    ) -> "_ExactBelief":
        """Condition on one step, by Eq. 8."""
        x, percept = observation
        tables = pomdp.tables
        probabilities = np.zeros(tables.n_y)
        probabilities[[y for _, y in self.particles]] = self.normalized_weights
        if percept != tables.none:
            probabilities *= tables.percepts[action][:, percept]
        return _ExactBelief.at(x, probabilities)


class _Problem(DiscreteActionsEnvironment):
    """The MOMDP, whose observations tell x' and a percept or none.

    The library knows one list of actions for all states. Before it reads the list it asks whether
    the state ends the trial, so that the list is then that of the state's x.
    """

    def __init__(self, momdp: MOMDP) -> None:
        discrete = SpaceInfo(SpaceType.DISCRETE, SpaceType.DISCRETE)
        super().__init__(float(momdp.discount), "momdp", discrete)
        self.tables = PeerTables(momdp)
        self.spread = float(momdp.correct - momdp.incorrect)
        self.actions = self.tables.allowed[momdp.start]

    def is_terminal(self, state: State) -> bool:
        self.actions = self.tables.allowed[state[0]]
        return state[0] == self.tables.end

    def get_actions(self) -> list[int]:
        return self.actions

    def sample_next_state(self, state: State, action: int, n_samples: int = 1) -> State:
        return self.tables.next_x(state[0], action), state[1]

    def sample_observation(self, next_state: State, action: int, n_samples: int = 1) -> Observation:
        x, y = next_state
        return x, self.tables.percept(x, y, action)

    def reward(self, state: State, action: int, next_state: State | None = None) -> float:
        x, y = state
        return self.tables.reward[x][y][action]

    def is_equal_observation(self, observation1: Observation, observation2: Observation) -> bool:
        return observation1 == observation2

    def hash_action(self, action: int) -> int:
        return action

    def _unasked(self, *_: object, **__: object) -> None:
        raise NotImplementedError("a search from an exact belief has no need of it")

    initial_state_dist = initial_observation_dist = _unasked
    transition_log_probability = observation_log_probability = _unasked
