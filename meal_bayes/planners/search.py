"""The tree search: select, expand, back up. Numba kernels over the leaf's (`leaf.py`).

Order of reading: `search` (one decision) at the end, `_select`, `_expand`, `_back_up` above it.
numba's cache sees changes of this file alone: after a change of `leaf.py`, touch this one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.leaf import (
    DEPTH,
    Beliefs,
    kernel,
    open_loop_values,
    seeming,
    stop_value,
    truth,
)

ENUMERATE = 64  # percept vectors up to which an edge gets a child for each
SAMPLED = 24  # children of an edge with more


class Tree(NamedTuple):
    """Search tree: struct of arrays; row 0 is the root, outcomes of an edge stand in a row."""

    size: NDArray[np.int64]  # (1,) nodes in use
    x: NDArray[np.int64]  # (S,)
    beliefs: Beliefs  # (S,N)
    value: NDArray[np.float64]  # (S,) best of report, exit and edges
    stop: NDArray[np.float64]  # (S,) value of the best report or exit, exact
    visits: NDArray[np.int64]  # (S,)
    edge_value: NDArray[np.float64]  # (S,E) lower bound on the value of each behavior
    edge_visits: NDArray[np.int64]  # (S,E)
    reward: NDArray[np.float64]  # (S,E) cost and bonus of an expanded edge
    children: NDArray[np.int64]  # (S,E) first child of an expanded edge, -1 before
    child_count: NDArray[np.int64]  # (S,E)
    child_p: NDArray[np.float64]  # (S,) Pr(this node | parent, behavior)
    levels: NDArray[np.int64]  # (S,N) percept that led here, -1 for "none"


@kernel
def _factor(problem, i, e, v, z, seen, total):
    c, s = problem.confusion[i, e, v, z], problem.precision[i, e, v]
    return c if np.isinf(s) else (s * c + seen[i, e, z]) / (s + total)


@kernel
def _new_node(problem, plans, tree, x, told, felt, yes, total, p, scratch):
    """Append a node: exact stop value, open-loop lower bounds for its behaviors."""
    node = tree.size[0]
    tree.size[0] += 1
    tree.x[node], tree.child_p[node], tree.visits[node] = x, p, 0
    for i in range(told.shape[0]):
        tree.beliefs.told[node, i], tree.beliefs.felt[node, i], tree.levels[node, i] = (
            told[i],
            felt[i],
            -1,
        )
    tree.stop[node] = stop_value(problem, x, tree.beliefs, node)
    tree.value[node] = tree.stop[node]
    beliefs, edges = tree.beliefs, tree.edge_value
    open_loop_values(problem, plans, x, beliefs, node, yes, total, scratch, edges)
    for a in range(tree.edge_value.shape[1]):
        tree.edge_visits[node, a] = 0
        tree.children[node, a] = -1
        tree.child_count[node, a] = 0
        tree.value[node] = max(tree.value[node], tree.edge_value[node, a])
    return node


@kernel
def _expand(problem, plans, tree, node, a, work, rng):
    """Make the children of an edge: every outcome, or a sample where there are too many."""
    seen, yes, total, levels, scratch = work.seen, work.yes, work.total, work.levels, work.weights
    told, felt = work.told, work.felt
    n, k_levels, x = seen.shape[0], seen.shape[2], tree.x[node]
    joint = float(k_levels) ** n
    perceives = total[a] < problem.limit[a]
    tree.children[node, a] = tree.size[0]
    tree.reward[node, a] = _step_reward(problem, tree, node, a, total)
    for k in range(problem.branches[x, a]):
        mass, next_x = problem.branch_p[x, a, k], problem.branch_x[x, a, k]
        if not (problem.branch_sense[x, a, k] and perceives):
            for i in range(n):
                told[i], felt[i] = tree.beliefs.told[node, i], tree.beliefs.felt[node, i]
            _new_node(problem, plans, tree, next_x, told, felt, yes, total, mass, scratch)
            continue
        sampled = joint > ENUMERATE
        for outcome in range(SAMPLED if sampled else int(joint)):
            p, rest = mass / SAMPLED if sampled else mass, outcome
            for i in range(n):
                on_truth = problem.direct[a] or problem.flip[i] == 0.0
                if on_truth:
                    b = truth(problem, tree.beliefs, node, i)
                else:
                    b = seeming(problem, tree.beliefs, node, i)
                if sampled:
                    z = _draw_level(problem, i, a, b, seen, total[a], rng)
                else:
                    z, rest = rest % k_levels, rest // k_levels
                f1 = _factor(problem, i, a, 1, z, seen, total[a])
                f0 = _factor(problem, i, a, 0, z, seen, total[a])
                if not sampled:
                    p *= b * f1 + (1.0 - b) * f0
                ratio = np.log(f1) - np.log(f0)
                told[i] = tree.beliefs.told[node, i] + (ratio if on_truth else 0.0)
                felt[i] = tree.beliefs.felt[node, i] + (0.0 if on_truth else ratio)
                levels[i] = z
            if p <= 0.0:
                continue
            for i in range(n):
                yes[i, a] += levels[i] >= k_levels // 2
            total[a] += 1.0
            child = _new_node(problem, plans, tree, next_x, told, felt, yes, total, p, scratch)
            for i in range(n):
                tree.levels[child, i] = levels[i]
            total[a] -= 1.0
            for i in range(n):
                yes[i, a] -= levels[i] >= k_levels // 2
    tree.child_count[node, a] = tree.size[0] - tree.children[node, a]


@kernel
def _draw_level(problem, i, a, b, seen, total, rng):
    v = 1 if rng.random() < b else 0
    u, levels = rng.random(), seen.shape[2]
    for z in range(levels):
        u -= _factor(problem, i, a, v, z, seen, total)
        if u < 0.0:
            return z
    return levels - 1


@kernel
def _back_up(problem, tree, node, a):
    """Edge value = cost, bonus and the exact expectation over its children; node value = best."""
    x, value = tree.x[node], 0.0
    first = tree.children[node, a]
    for child in range(first, first + tree.child_count[node, a]):
        value += tree.child_p[child] * tree.value[child]
    tree.edge_value[node, a] = tree.reward[node, a] + problem.discount[x, a] * value
    best = tree.stop[node]
    for other in range(tree.edge_value.shape[1]):
        best = max(best, tree.edge_value[node, other])
    tree.value[node] = best


@kernel
def _step_reward(problem, tree, node, a, total):
    x = tree.x[node]
    reward = -problem.cost[x, a]
    if problem.shaped and total[a] < problem.limit[a]:
        for i in range(tree.beliefs.told.shape[1]):
            b = truth(problem, tree.beliefs, node, i)
            mean = b * problem.bonus[i, a, 1] + (1.0 - b) * problem.bonus[i, a, 0]
            reward += problem.bonus_scale[x, a] * mean
    return reward


@kernel
def _select(problem, tree, node, exploration):
    """UCB1 over the behaviors; ending has no variance and so gets no bonus. -1 = end."""
    x, best, best_score = tree.x[node], -1, tree.stop[node]
    spread = np.log(tree.visits[node] + 1.0)
    for a in range(tree.edge_value.shape[1]):
        if problem.legal[x, a]:
            score = tree.edge_value[node, a] + exploration * np.sqrt(
                spread / (tree.edge_visits[node, a] + 1.0)
            )
            if score > best_score:
                best, best_score = a, score
    return best


@kernel
def search(problem, plans, tree, work, x, seen, total, simulations, exploration, rng):
    """Grow the tree from the belief in `work.told`, `work.felt`; return the simulations made."""
    n, n_behaviors, k_levels = seen.shape
    here, yes, count, path = work.seen, work.yes, work.total, work.path
    width = 2 * min(float(k_levels) ** n, ENUMERATE) + 2  # room that one expansion may need
    tree.size[0] = 0
    for done in range(simulations + 1):
        for e in range(n_behaviors):
            count[e] = total[e]
            for i in range(n):
                yes[i, e] = 0.0
                for z in range(k_levels):
                    here[i, e, z] = seen[i, e, z]
                    yes[i, e] += seen[i, e, z] if z >= k_levels // 2 else 0.0
        if done == 0:
            _new_node(problem, plans, tree, x, work.told, work.felt, yes, count, 1.0, work.weights)
            continue
        node, depth = 0, 0
        while depth < DEPTH:
            tree.visits[node] += 1
            a = _select(problem, tree, node, exploration)
            if a < 0 or (tree.children[node, a] < 0 and tree.size[0] + width > tree.x.shape[0]):
                break
            tree.edge_visits[node, a] += 1
            path[depth, 0], path[depth, 1] = node, a
            depth += 1
            if tree.children[node, a] < 0:
                _expand(problem, plans, tree, node, a, work, rng)
                break
            child, u = tree.children[node, a], rng.random()
            last = child + tree.child_count[node, a] - 1
            while child < last and u >= tree.child_p[child]:
                u -= tree.child_p[child]
                child += 1
            if tree.levels[child, 0] >= 0:
                for i in range(n):
                    z = tree.levels[child, i]
                    here[i, a, z] += 1.0
                    yes[i, a] += 1.0 if z >= k_levels // 2 else 0.0
                count[a] += 1.0
            node = child
        for t in range(depth - 1, -1, -1):
            _back_up(problem, tree, path[t, 0], path[t, 1])
        if tree.size[0] + width > tree.x.shape[0]:
            return done
    return simulations
