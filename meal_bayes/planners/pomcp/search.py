"""The tree search: select, expand, back up. Numba kernels over the leaf's (`leaf.py`).

Order of reading: `search` (one decision) at the end, `_select`, `_expand`, `_back_up` above it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.factored.grid import Table, value_after
from meal_bayes.planners.kernels import entry_kernel, kernel
from meal_bayes.planners.open_loop.errors import truth
from meal_bayes.planners.open_loop.values import (
    DEPTH,
    Plans,
    open_loop_value,
    open_loop_values,
    stop_value,
)

ENUMERATE = 64  # percept vectors up to which an edge gets a child for each
SAMPLED = 24  # children of an edge with more


class Leaf(NamedTuple):
    """What values a new node: a table over beliefs where there is one, else open-loop plans."""

    plans: Plans
    table: Table
    reading: NDArray[np.float64]


class Tree(NamedTuple):
    """Search tree: struct of arrays; row 0 is the root, outcomes of an edge stand in a row."""

    size: NDArray[np.int64]  # (1,) nodes in use
    x: NDArray[np.int64]  # (S,)
    weight: NDArray[np.float64]  # (S,N,C) Pr(kind)
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
def _leaf_value(problem, leaf, weight, node, x, work):
    """Value of a new node: of the table of factored value iteration, else of open-loop plans."""
    floor = stop_value(problem, x, weight, node)
    if leaf.table.value.shape[0] == 0:
        return open_loop_value(problem, leaf.plans, x, weight, node, work, floor)
    for i in range(weight.shape[1]):
        work.chance[i] = truth(problem, weight, node, i)
    return max(floor, value_after(leaf.table, problem.confusion, x, -1, work.chance, leaf.reading))


@kernel
def _edge_values(problem, leaf, tree, node, work):
    """Value of every behavior of a visited node: one step ahead of the table, or plans."""
    x, weight, out = tree.x[node], tree.weight, tree.edge_value
    if leaf.table.value.shape[0] == 0:
        open_loop_values(problem, leaf.plans, x, weight, node, work, out)
        return
    for i in range(weight.shape[1]):
        work.chance[i] = truth(problem, weight, node, i)
    for a in range(out.shape[1]):
        if not problem.legal[x, a]:
            out[node, a] = -np.inf
            continue
        mean = 0.0
        for k in range(problem.branches[x, a]):
            perceives = problem.branch_sense[x, a, k] and work.total[a] < problem.limit[a]
            behavior, target = a if perceives else -1, problem.branch_x[x, a, k]
            mean += problem.branch_p[x, a, k] * value_after(
                leaf.table, problem.confusion, target, behavior, work.chance, leaf.reading
            )
        out[node, a] = _step_reward(problem, tree, node, a, work.total)
        out[node, a] += problem.discount[x, a] * mean


@kernel
def _factor(problem, i, e, c, z, seen, total):
    p, s = problem.confusion[i, e, c, z], problem.precision[i, e, c]
    return p if np.isinf(s) else (s * p + seen[i, e, z]) / (s + total)


@kernel
def _new_node(problem, leaf, tree, x, p, work):
    """Append a node of belief `work.weight`, valued by the leaf."""
    node, weight = tree.size[0], tree.weight
    tree.size[0] += 1
    tree.x[node], tree.child_p[node], tree.visits[node] = x, p, 0
    for i in range(weight.shape[1]):
        tree.levels[node, i] = -1
        for c in range(weight.shape[2]):
            weight[node, i, c] = work.weight[i, c]
    tree.stop[node] = stop_value(problem, x, weight, node)
    tree.value[node] = _leaf_value(problem, leaf, weight, node, x, work)
    return node


@kernel
def _open(problem, leaf, tree, node, work):
    """Give a node that is visited its edges."""
    _edge_values(problem, leaf, tree, node, work)
    tree.value[node] = tree.stop[node]
    for a in range(tree.edge_value.shape[1]):
        tree.edge_visits[node, a] = 0
        tree.children[node, a] = -1
        tree.child_count[node, a] = 0
        tree.value[node] = max(tree.value[node], tree.edge_value[node, a])


@kernel
def _condition(problem, tree, node, i, a, z, work):
    """Condition attribute i on level z -> work.weight[i]; return Pr(z)."""
    total = 0.0
    for c in range(tree.weight.shape[2]):
        w = tree.weight[node, i, c] * _factor(problem, i, a, c, z, work.seen, work.total[a])
        work.weight[i, c] = w
        total += w
    if total > 0.0:
        for c in range(tree.weight.shape[2]):
            work.weight[i, c] /= total
    return total


@kernel
def _expand(problem, leaf, tree, node, a, work, rng):
    """Make the children of an edge: every outcome, or a sample where there are too many.

    Percepts that tell nothing of an attribute are not told apart.
    """
    n, k_levels, x = work.seen.shape[0], work.seen.shape[2], tree.x[node]
    levels, joint = work.levels, 1.0
    for i in range(n):
        joint *= k_levels if problem.informative[i, a] else 1
    perceives = work.total[a] < problem.limit[a]
    tree.children[node, a] = tree.size[0]
    tree.reward[node, a] = _step_reward(problem, tree, node, a, work.total)
    for k in range(problem.branches[x, a]):
        mass, next_x = problem.branch_p[x, a, k], problem.branch_x[x, a, k]
        for i in range(n):
            levels[i] = 0
            for c in range(tree.weight.shape[2]):
                work.weight[i, c] = tree.weight[node, i, c]
        if not (problem.branch_sense[x, a, k] and perceives):
            _new_node(problem, leaf, tree, next_x, mass, work)
            continue
        sampled = joint > ENUMERATE
        for outcome in range(SAMPLED if sampled else int(joint)):
            p, rest = mass / SAMPLED if sampled else mass, outcome
            for i in range(n):
                if not problem.informative[i, a]:
                    continue
                if sampled:
                    levels[i] = _draw_level(problem, tree, node, i, a, work, rng)
                    _condition(problem, tree, node, i, a, levels[i], work)
                else:
                    levels[i], rest = rest % k_levels, rest // k_levels
                    p *= _condition(problem, tree, node, i, a, levels[i], work)
            if p <= 0.0:
                continue
            for i in range(n):
                work.yes[i, a] += levels[i] >= k_levels // 2
            work.total[a] += 1.0
            child = _new_node(problem, leaf, tree, next_x, p, work)
            for i in range(n):
                tree.levels[child, i] = levels[i]
            work.total[a] -= 1.0
            for i in range(n):
                work.yes[i, a] -= levels[i] >= k_levels // 2
    tree.child_count[node, a] = tree.size[0] - tree.children[node, a]


@kernel
def _draw_level(problem, tree, node, i, a, work, rng):
    u, levels = rng.random(), work.seen.shape[2]
    for z in range(levels):
        for c in range(tree.weight.shape[2]):
            factor = _factor(problem, i, a, c, z, work.seen, work.total[a])
            u -= tree.weight[node, i, c] * factor
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
        for i in range(tree.weight.shape[1]):
            b = truth(problem, tree.weight, node, i)
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


@entry_kernel
def search(problem, leaf, tree, work, x, seen, simulations, exploration, rng):
    """Grow the tree by simulations, from the belief in `work.weight` if empty; how many it had."""
    n, n_behaviors, k_levels = seen.shape
    here, yes, count, path = work.seen, work.yes, work.total, work.path
    width = problem.branch_x.shape[2] * min(float(k_levels) ** n, ENUMERATE) + 2  # of an expansion
    begin = -1 if tree.size[0] == 0 else 0
    for done in range(begin, simulations):
        if tree.size[0] + width > tree.x.shape[0]:
            return max(0, done)
        for e in range(n_behaviors):
            count[e] = 0.0
            for z in range(k_levels):
                count[e] += seen[0, e, z]
            for i in range(n):
                yes[i, e] = 0.0
                for z in range(k_levels):
                    here[i, e, z] = seen[i, e, z]
                    yes[i, e] += seen[i, e, z] if z >= k_levels // 2 else 0.0
        if done < 0:
            _open(problem, leaf, tree, _new_node(problem, leaf, tree, x, 1.0, work), work)
            continue
        node, depth = 0, 0
        while depth < DEPTH:
            if tree.visits[node] == 0 and node > 0:
                _open(problem, leaf, tree, node, work)
            tree.visits[node] += 1
            a = _select(problem, tree, node, exploration)
            if a < 0:
                break
            tree.edge_visits[node, a] += 1
            path[depth, 0], path[depth, 1] = node, a
            depth += 1
            if tree.children[node, a] < 0:
                _expand(problem, leaf, tree, node, a, work, rng)
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
    return simulations
