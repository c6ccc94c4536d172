"""Other libraries' planners, as solvers of our MOMDPs: the extra `bench` installs them."""

import random
from bisect import bisect
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import pomdp_py

from meal_bayes.momdp import MOMDP, Belief, best_answer, percept_probabilities
from meal_bayes.planners import Decision, History

_DEPTH = 40  # steps of a simulation, at most; random roll-outs report long before


@dataclass(frozen=True, slots=True)
class PomdpPy:
    """POUCT of pomdp-py: textbook tree search with random roll-outs.

    It is given what helps it: the exact belief, tables in place of arithmetic, objects that are
    made once, only actions that a planner may choose, the most probable report where it reports,
    and UCB1's constant at the spread of the rewards [Silver2010].

    One black box makes the whole step and, by way of its options that take several steps, lets a
    simulation end with the trial: undocumented, and the fastest that we could make it.
    """

    simulations: int = 1500  # a decision

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "PomdpPyPolicy":
        """Lay the MOMDP out as a model of pomdp-py.

        Known rates (Eq. 8), and percepts whose coming depends on behavior and x' only.
        """
        tables = _Tables(momdp)
        planner = pomdp_py.POUCT(
            max_depth=_DEPTH,
            num_sims=self.simulations,
            discount_factor=momdp.discount,
            exploration_const=momdp.correct - momdp.incorrect,
            rollout_policy=_Actions(tables),
        )
        return PomdpPyPolicy(momdp, tables, planner)


@dataclass(frozen=True, slots=True)
class PomdpPyPolicy:
    """Policy of `PomdpPy`; every decision grows a fresh tree, as ours does."""

    momdp: MOMDP
    tables: "_Tables"
    planner: pomdp_py.POUCT

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Search from the present belief."""
        random.seed(int(rng.integers(2**63)))  # pomdp-py draws from Python's own generator
        e, belief = self.momdp.n_behaviors, history.belief
        start = _Belief(self.tables, belief)
        agent = pomdp_py.Agent(start, _Actions(self.tables), blackbox_model=_Step(self.tables))
        action = int(self.planner.plan(agent).number)
        values = np.full(e + 1, np.nan)
        for taken in self.tables.allowed[belief.x]:
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
        self.x, self.y = x, y


class _Action(_Numbered, pomdp_py.Action):
    pass


class _Observation(_Numbered, pomdp_py.Observation):
    pass


class _Tables:
    """States (x, y), observations (x', percept or none), and cumulated probabilities."""

    def __init__(self, momdp: MOMDP) -> None:
        n_x, n_y, n_e = len(momdp.x_names), 2 ** len(momdp.query), momdp.n_behaviors
        n_z = momdp.levels ** len(momdp.query)
        self.states = [[_State(x * n_y + y, x, y) for y in range(n_y)] for x in range(n_x)]
        self.actions = [_Action(number) for number in range(momdp.n_actions)]
        self.seen = [[_Observation(x * (n_z + 1) + z) for z in range(n_z + 1)] for x in range(n_x)]
        self.end, self.n_e, self.none = momdp.terminal, n_e, n_z
        self.cost, self.abstention = momdp.cost.tolist(), momdp.abstention
        self.correct, self.incorrect = float(momdp.correct), float(momdp.incorrect)
        self.move = [
            [list(accumulate(row)) for row in momdp.transition[e].tolist()] for e in range(n_e)
        ]
        possible = momdp.observation_probability * (momdp.transition > 0)
        self.comes = possible.max(axis=1).tolist()  # (E,X) by x'
        self.percept = [
            [list(accumulate(row)) for row in percept_probabilities(momdp, e).tolist()]
            for e in range(n_e)
        ]
        self.allowed: list[list[_Action]] = []
        for x in range(self.end):
            behaviors = np.flatnonzero(momdp.legal[x]).tolist()
            answers = range(n_e, momdp.n_actions)
            self.allowed.append([self.actions[number] for number in (*behaviors, *answers)])
        self.allowed.append(self.actions[:1])  # nothing is left to do

    def next_state(self, state: _State, action: _Action) -> _State:
        """Draw x'; y stays."""
        number, x = action.number, state.x
        if number >= self.n_e or x == self.end:
            return self.states[self.end][state.y]
        return self.states[min(bisect(self.move[number][x], random.random()), self.end)][state.y]

    def observation(self, next_state: _State, action: _Action) -> _Observation:
        """Draw a percept, or none."""
        number, x = action.number, next_state.x
        comes = self.comes[number][x] if number < self.n_e and x != self.end else 0.0
        if not comes or random.random() >= comes:
            return self.seen[x][self.none]
        limits = self.percept[number][next_state.y]
        return self.seen[x][min(bisect(limits, random.random()), self.none - 1)]

    def reward(self, state: _State, action: _Action) -> float:
        """Pay for a behavior, or for a report."""
        if state.x == self.end:
            return 0.0
        if action.number < self.n_e:
            return -self.cost[action.number]
        if action.number == self.abstention:
            return 0.0
        return self.correct if action.number - self.n_e == state.y else self.incorrect


class _Step(pomdp_py.BlackboxModel):
    """(s, a) to (s', o, r, steps); what ends the trial takes all the steps that are left."""

    def __init__(self, tables: _Tables) -> None:
        self.tables = tables

    def sample(self, state: _State, action: _Action) -> tuple[_State, _Observation, float, int]:
        after = self.tables.next_state(state, action)
        steps = _DEPTH + 1 if after.x == self.tables.end else 1
        reward = self.tables.reward(state, action)
        return after, self.tables.observation(after, action), reward, steps


class _Actions(pomdp_py.RandomRollout):
    def __init__(self, tables: _Tables) -> None:
        self.allowed = tables.allowed

    def get_all_actions(self, state: _State, history: object = None) -> list[_Action]:
        return self.allowed[state.x]

    def rollout(self, state: _State, history: object) -> _Action:
        return random.choice(self.allowed[state.x])


class _Belief(pomdp_py.GenerativeDistribution):
    """The exact belief, to be drawn from."""

    def __init__(self, tables: _Tables, belief: Belief) -> None:
        self.states = tables.states[belief.x]
        self.limits = list(accumulate(belief.joint.tolist()))

    def random(self) -> _State:
        return self.states[min(bisect(self.limits, random.random()), len(self.states) - 1)]
