"""Paths of plans on a transition diagram: costs of their steps, and shortest paths to percepts.

A behavior may have several outcomes: a shaken object may slip. A plan follows the most probable
outcome of each of its behaviors. A plan is a policy, with a value that is a lower bound, only if it
also says what to do after another outcome. The rule is to return to the state in which the behavior
began and to try again; if no path leads back, the robot answers at once. Let the behavior have the
cost c, the discount factor g, the most probable outcome with probability p, and other outcomes o
with probabilities p_o (failures are summed out, see `momdp_arrays`). From outcome o, the path back
has the cost C_o, the discount factor D_o, and the probability L_o that it does not lead back. With
the value W after the most probable outcome, and the value S of an answer,

    V = -c + g [p W + sum_o p_o (D_o V + L_o S - C_o)]    and so    V = -cost + discount W + lost S,

cost = (c + g sum_o p_o C_o) / k, discount = g p / k, lost = g sum_o p_o L_o / k,
k = 1 - g sum_o p_o D_o. If a behavior has only one outcome, these are c, g and 0.
"""

import heapq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.planners.jit import by_reference
from meal_bayes.planners.momdp_arrays import Dynamics, memoized


class PlanSteps(NamedTuple):
    """Steps of plans, each repeated until its most probable outcome occurs."""

    target: Ints  # (X,E) x after the most probable outcome
    senses: Bools  # (X,E) does the most probable outcome have a percept?
    cost: Floats  # (X,E) discounted cost in seconds
    discount: Floats  # (X,E) discount factor after the most probable outcome
    lost: Floats  # (X,E) discounted Pr(no path leads back); the plan then ends with an answer
    percepts: Floats  # (X,E) expected discounted number of percepts, for bonuses


class Detours(NamedTuple):
    """Cost, discount factor and probability of failure of the way from each state to one state."""

    cost: Floats  # (X,) C: expected discounted cost in seconds
    reached: Floats  # (X,) D: discounted Pr(the goal is reached)
    lost: Floats  # (X,) L: discounted Pr(a state is reached from which no path leads to the goal)


def plan_steps(dynamics: Dynamics) -> PlanSteps:
    """Compute the steps of plans on a diagram, which include returning and trying again."""
    step = dynamics.step
    branch = dynamics.branch
    likeliest = branch["p"].argmax(axis=2)[:, :, None]
    target = np.take_along_axis(branch["x"], likeliest, axis=2)[:, :, 0]
    senses = np.take_along_axis(branch["senses"], likeliest, axis=2)[:, :, 0]
    probability = np.take_along_axis(branch["p"], likeliest, axis=2)[:, :, 0]
    steps = PlanSteps(
        target=target,
        senses=senses,
        cost=step["cost"].copy(),
        discount=step["discount"].copy(),
        lost=np.zeros(step.shape),
        percepts=step["percepts"].copy(),
    )
    # A step with one certain outcome does not change.
    several = step["legal"] & (np.count_nonzero(branch["p"], axis=2) > 1)
    for x in np.flatnonzero(several.any(axis=1)).tolist():
        back = detours_to(dynamics, target, x)
        for a in np.flatnonzero(several[x]).tolist():
            others = branch["p"][x, a].copy()
            others[likeliest[x, a]] = 0.0
            g = step["discount"][x, a]
            ends = branch["x"][x, a]
            # k = 1 - g sum_o p_o D_o
            k = 1.0 - g * (others @ back.reached[ends])
            steps.cost[x, a] = (step["cost"][x, a] + g * (others @ back.cost[ends])) / k
            steps.discount[x, a] = g * probability[x, a] / k
            steps.lost[x, a] = g * (others @ back.lost[ends]) / k
            steps.percepts[x, a] = step["percepts"][x, a] / k
    return steps


def detours_to(dynamics: Dynamics, target: Ints, goal: int) -> Detours:
    """Compute cost, discount factor and failure of the cheapest way to x `goal` from every state.

    The policy is found by Dijkstra's algorithm from the goal backwards, along the most probable
    outcomes. Its values include all outcomes: they solve C = c + g P C, D = g P D with D = 1 at the
    goal, and L = g P L with L = 1 in states from which no path leads to the goal.
    """
    step = dynamics.step
    n_states = len(step)
    behavior = np.full(n_states, -1)
    settled = np.zeros(n_states, np.bool_)
    queue = [(0.0, goal, -1)]
    while queue:
        distance, x, first = heapq.heappop(queue)
        if settled[x]:
            continue
        settled[x] = True
        behavior[x] = first
        for source, a in np.argwhere(step["legal"] & (target == x)).tolist():
            if not settled[source]:
                heapq.heappush(queue, (distance + float(step["cost"][source, a]), source, a))
    # (I - g P) (C, D, L) = (cost, 1 at the goal, 1 without a path)
    on_path = np.flatnonzero(settled & (np.arange(n_states) != goal))
    moves = np.zeros((n_states, n_states))  # g P of the policy; rows of final states stay 0
    cost = np.zeros(n_states)
    for x in on_path.tolist():
        a = behavior[x]
        branch = dynamics.branch[x, a]
        np.add.at(moves[x], branch["x"], step["discount"][x, a] * branch["p"])
        cost[x] = step["cost"][x, a]
    ends = np.stack([cost, np.arange(n_states) == goal, ~settled], axis=1).astype(float)
    return Detours(*np.linalg.solve(np.eye(n_states) - moves, ends).T)


@by_reference
class ShortestPaths(NamedTuple):
    """Cheapest path from each x to a percept of each behavior, along the most probable outcomes.

    Cost, discount factor and probability of failure include the other outcomes, as in `PlanSteps`.
    """

    target: Ints  # (X,E) x after the most probable outcome of a behavior
    senses: NDArray[np.bool_]  # (X,E) does this outcome have a percept?
    first_action: Ints  # (X,E) first behavior of the path; -1 if there is no path
    end: Ints  # (X,E) x at the end
    cost: Floats  # (X,E) discounted cost in seconds
    discount: Floats  # (X,E) discount factor at the end
    lost: Floats  # (X,E) discounted Pr(the path cannot be completed); the robot then answers
    observation_counts: Ints  # (X,E,E) numbers of percepts on the path, including the last one
    gathered: Ints  # (X,E,G) behaviors of these percepts in increasing order, padded by -1

    def path(self, x: int, behavior: int) -> tuple[int, ...]:
        """Return the behaviors from x to a percept of one behavior; empty if there is no path."""
        a = int(self.first_action[x, behavior])
        if a < 0:
            return ()
        arrived = a == behavior and self.senses[x, a]
        return (a,) if arrived else (a, *self.path(int(self.target[x, a]), behavior))


def find_shortest_paths(steps: PlanSteps, legal: Bools) -> ShortestPaths:
    """Find the cheapest paths by Dijkstra's algorithm from every x."""
    shape = legal.shape
    shortest = ShortestPaths(
        target=steps.target,
        senses=steps.senses,
        first_action=np.full(shape, -1),
        end=np.zeros(shape, np.int64),
        cost=np.zeros(shape),
        discount=np.ones(shape),
        lost=np.zeros(shape),
        observation_counts=np.zeros((*shape, shape[1]), np.int64),
        gathered=np.zeros((*shape, 0), np.int64),
    )
    for start in range(len(legal)):
        # States are settled in order of cost: the first path to a percept is the cheapest.
        queue: list[tuple[float, int, tuple[int, ...]]] = [(0.0, start, ())]
        settled: set[int] = set()
        while queue:
            cost, x, path = heapq.heappop(queue)
            if x in settled:
                continue
            settled.add(x)
            for a in np.flatnonzero(legal[x]).tolist():
                if shortest.senses[x, a] and shortest.first_action[start, a] < 0:
                    _record_path(shortest, steps, start, (*path, a))
                after = cost + float(steps.cost[x, a])
                heapq.heappush(queue, (after, int(shortest.target[x, a]), (*path, a)))
    return shortest._replace(gathered=_behaviors_of(shortest.observation_counts))


def _behaviors_of(observation_counts: Ints) -> Ints:
    """Return the behaviors with percepts in counts (X,E,E), in order, as (X,E,G) padded by -1."""
    gathers = observation_counts > 0
    most = int(gathers.sum(axis=2).max(initial=0))
    # A stable sort puts the behaviors that gather first, in their order.
    order = np.argsort(~gathers, axis=2, kind="stable")[..., :most]
    return np.where(np.take_along_axis(gathers, order, axis=2), order, -1)


def _record_path(
    shortest: ShortestPaths, steps: PlanSteps, start: int, path: tuple[int, ...]
) -> None:
    """Record a path, which ends with a percept."""
    goal = path[-1]
    x = start
    scale = 1.0
    for a in path:
        shortest.observation_counts[start, goal, a] += shortest.senses[x, a]
        # cost += (prod of g so far) c
        shortest.cost[start, goal] += scale * steps.cost[x, a]
        shortest.lost[start, goal] += scale * steps.lost[x, a]
        scale *= steps.discount[x, a]
        x = int(shortest.target[x, a])
    shortest.first_action[start, goal] = path[0]
    shortest.end[start, goal] = x
    shortest.discount[start, goal] = scale


@dataclass(frozen=True, eq=False)
class DiagramPaths:
    """Steps and paths of plans on a diagram, which all MOMDPs with this diagram share."""

    dynamics: Dynamics
    steps: PlanSteps
    shortest: ShortestPaths


_diagrams: dict[object, DiagramPaths] = {}  # cache, by the identity of the dynamics


def diagram_of(dynamics: Dynamics) -> DiagramPaths:
    """Return the steps of plans and the shortest paths of a diagram, which are cached."""

    def make() -> DiagramPaths:
        steps = plan_steps(dynamics)
        return DiagramPaths(dynamics, steps, find_shortest_paths(steps, dynamics.step["legal"]))

    return memoized(_diagrams, id(dynamics.step), make)
