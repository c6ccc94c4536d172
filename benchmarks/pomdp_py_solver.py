"""POUCT of pomdp-py as a solver of our MOMDPs: the extra `bench` installs it."""

import random
from bisect import bisect
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import pomdp_py
from peer_tables import Steps

from meal_bayes.momdp import MOMDP, Belief, best_answer
from meal_bayes.planners import Decision, History

_DEPTH = 40  # steps of a simulation, at most; random roll-outs report long before


@dataclass(frozen=True, slots=True)
class PomdpPy:
    """POUCT of pomdp-py: textbook tree search with random roll-outs.

    It is given what helps it: the exact belief, numbers laid out in advance, objects that are
    made once, only actions that a planner may choose, the most probable report where it reports,
    and UCB1's constant at the spread of the rewards [Silver2010].

    One black box makes the whole step and, by way of its options that take several steps, lets a
    simulation end with the trial: undocumented, and the fastest that we could make it.
    """

    simulations: int = 1500  # a decision

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "PomdpPyPolicy":
        """Lay the MOMDP out as a model of pomdp-py."""
        problem = _Problem(momdp)
        planner = pomdp_py.POUCT(
            max_depth=_DEPTH,
            num_sims=self.simulations,
            discount_factor=momdp.discount,
            exploration_const=momdp.correct - momdp.incorrect,
            rollout_policy=_Actions(problem),
        )
        return PomdpPyPolicy(momdp, problem, planner)


@dataclass(frozen=True, slots=True)
class PomdpPyPolicy:
    """Policy of `PomdpPy`; every decision grows a fresh tree, as ours does."""

    momdp: MOMDP
    problem: "_Problem"
    planner: pomdp_py.POUCT

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Search from the present belief."""
        random.seed(int(rng.integers(2**63)))  # pomdp-py draws from Python's own generator
        e = self.momdp.n_behaviors
        belief = history.belief
        start = _Belief(self.problem, belief)
        agent = pomdp_py.Agent(start, _Actions(self.problem), blackbox_model=self.problem)
        action = int(self.planner.plan(agent).number)
        values = np.full(e + 1, np.nan)
        for taken in self.problem.allowed[belief.x]:
            node = agent.tree[taken]
            values[min(taken.number, e)] = np.fmax(values[min(taken.number, e)], node.value)
        if action >= e:
            # It is spared choosing between answers by luck: ours knows the best one.
            action = best_answer(self.momdp, belief)
        unknown = np.full(e + 1, np.nan)
        visits = np.zeros(e + 1, dtype=np.int64)
        return Decision(action, values, unknown, visits, simulations=self.planner.last_num_sims)


class _Numbered:
    """Equal by number; made once, so that comparing is cheap."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __hash__(self) -> int:
        return self.number

    def __eq__(self, other: object) -> bool:
        return self is other


class _State(_Numbered, pomdp_py.State):
    def __init__(self, number: int, x: int, y: int) -> None:
        super().__init__(number)
        self.x = x
        self.y = y


class _Action(_Numbered, pomdp_py.Action):
    pass


class _Observation(_Numbered, pomdp_py.Observation):
    pass


class _Problem(pomdp_py.BlackboxModel):
    """(s, a) to (s', o, r, steps); what ends the trial takes all the steps that are left."""

    def __init__(self, momdp: MOMDP) -> None:
        self.tables = tables = Steps(momdp)
        each_x = range(tables.end + 1)
        percepts = range(tables.none + 1)
        self.states = [
            [_State(x * tables.n_y + y, x, y) for y in range(tables.n_y)] for x in each_x
        ]
        self.seen = [[_Observation(x * len(percepts) + z) for z in percepts] for x in each_x]
        actions = [_Action(number) for number in range(momdp.n_actions)]
        self.allowed = [[actions[number] for number in row] for row in tables.allowed]

    def sample(self, state: _State, action: _Action) -> tuple[_State, _Observation, float, int]:
        """Draw one step."""
        x, percept, reward = self.tables.step(state.x, state.y, action.number)
        steps = _DEPTH + 1 if x == self.tables.end else 1
        return self.states[x][state.y], self.seen[x][percept], reward, steps


class _Actions(pomdp_py.RandomRollout):
    def __init__(self, problem: _Problem) -> None:
        self.allowed = problem.allowed

    def get_all_actions(self, state: _State, history: object = None) -> list[_Action]:
        return self.allowed[state.x]

    def rollout(self, state: _State, history: object) -> _Action:
        return random.choice(self.allowed[state.x])


class _Belief(pomdp_py.GenerativeDistribution):
    """The exact belief, to be drawn from."""

    def __init__(self, problem: _Problem, belief: Belief) -> None:
        self.states = problem.states[belief.x]
        self.limits = list(accumulate(belief.joint.tolist()))

    def random(self) -> _State:
        return self.states[min(bisect(self.limits, random.random()), len(self.states) - 1)]
