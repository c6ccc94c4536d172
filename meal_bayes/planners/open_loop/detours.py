"""What a step of a plan costs where a behavior has several outcomes, as a shaken object may slip.

A plan follows the likeliest outcome of each of its behaviors. To be a policy, and its value a lower
bound, it must say what follows another one: it goes back to where the behavior began and tries
again; where no path leads back it answers at once. Let the behavior cost c, discount by g, and have
the likeliest outcome with probability p, others with p_o (failures are summed out, see
`momdp_arrays`). From outcome o the path back costs C_o and discounts what follows it by D_o, the
chances L_o of getting lost on it being apart. With W what follows the likeliest outcome, and S an
answer,

    V = -c + g [p W + sum_o p_o (D_o V + L_o S - C_o)]    and so    V = -cost + discount W + lost S,

cost = (c + g sum_o p_o C_o) / k, discount = g p / k, lost = g sum_o p_o L_o / k,
k = 1 - g sum_o p_o D_o. Where every behavior has one outcome they are c, g and 0.
"""

import heapq
from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.planners.momdp_arrays import Dynamics


class PlanSteps(NamedTuple):
    """Steps of plans, tried until the likeliest outcome comes."""

    target: Ints  # (X,E) x of the likeliest outcome
    senses: Bools  # (X,E) does it perceive?
    cost: Floats  # (X,E) s, discounted
    discount: Floats  # (X,E) factor on what follows the likeliest outcome
    lost: Floats  # (X,E) discounted Pr(no path leads back): the plan then ends with an answer
    percepts: Floats  # (X,E) expected, discounted: what a bonus pays


class Detours(NamedTuple):
    """What it takes to come back to one x, from every x; it may lead round, or get lost."""

    cost: Floats  # (X,) C: expected, discounted, s
    reached: Floats  # (X,) D: discounted Pr(it comes back)
    lost: Floats  # (X,) L: discounted Pr(it comes to an x from which it cannot)


def plan_steps(dynamics: Dynamics) -> PlanSteps:
    """Sum up the steps of plans on a diagram."""
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
    # Where one outcome is certain a step is what it was.
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
    """Go to x `goal` by the cheapest paths along the likeliest outcomes; with all outcomes.

    The policy is Dijkstra's, against the arrows from the goal; its figures solve C = c + g P C,
    D = g P D with D = 1 at the goal, and L = g P L with L = 1 where no path leads to it. Where an
    object is to be put down a path must be sure: that is `paths_back`.
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
    # (I - g P) (C, D, L) = what each x adds: its cost, at the goal 1, where no path leads back 1
    on_path = np.flatnonzero(settled & (np.arange(n_states) != goal))
    moves = np.zeros((n_states, n_states))  # g P of the policy; rows of its ends stay 0
    cost = np.zeros(n_states)
    for x in on_path.tolist():
        a = behavior[x]
        branch = dynamics.branch[x, a]
        np.add.at(moves[x], branch["x"], step["discount"][x, a] * branch["p"])
        cost[x] = step["cost"][x, a]
    ends = np.stack([cost, np.arange(n_states) == goal, ~settled], axis=1).astype(float)
    return Detours(*np.linalg.solve(np.eye(n_states) - moves, ends).T)
