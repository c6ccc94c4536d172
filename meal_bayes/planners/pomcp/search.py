"""POMCP's tree search, read from the top: simulate, select, expand, value, execute, back up.

Kernels over the tree and the sampled MOMDPs (`tree.py`), and the leaf evaluators. Open-loop plans
give a lower bound for any MOMDP. Where the marginals are the state (Eq. 8) and few enough, a table
of factored value iteration estimates the optimum.
"""

from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Floats
from meal_bayes.planners.factored.grid import Table, value_after
from meal_bayes.planners.kernels import entry_kernel, kernel
from meal_bayes.planners.open_loop.values import evaluate_plans, is_idle, stop_value, true_chance
from meal_bayes.planners.pomcp.tree import DEPTH, KEPT, condition, draw_object, draw_percept

ENUMERATE = 64  # percept vectors up to which an edge gets a child for each
DRAWN = 24  # children of an edge with more


class Tabled(NamedTuple):
    """A table over a grid of marginal beliefs as leaf, and the buffer that reads it."""

    table: Table
    reading: Floats


@entry_kernel
def search(model, plans, tabled, scratch, tree, sampled, options, rng):
    """Grow a tree by simulations, from its root; return how many fit the capacity.

    A simulation descends the tree in a MOMDP sampled from the posterior, until it ends or leaves
    the tree, and backs up its return. `options` (3,): the number of simulations, the
    exploration constant, and whether edges average returns (1) or take the expectation over their
    outcomes (0). Leaves are valued by `plans`, or by a table where `tabled` is not None: numba
    compiles a kernel for each of the two, without the other's code. `scratch` holds the percepts
    on the way.
    """
    simulations, exploration, averaged = int(options[0]), options[1], options[2]
    width = model.dynamics.branch.shape[2] * ENUMERATE
    for done in range(simulations):
        if tree.size[0] + width >= tree.node.shape[0]:  # a free node stays, for `_execute`
            return done
        draw_object(model.percepts, sampled, rng)
        node, depth, value, new = done * 0, 0, 0.0, False
        while depth < DEPTH and not new:
            x = tree.node[node].x
            if tree.node[node].visits == 0:
                if tabled is None:
                    evaluate_plans(model, plans, x, tree.prob[node], scratch, -np.inf, x >= 0)
                _open_node(model, tabled, scratch, tree, node)
            tree.node[node].visits += 1
            a, value = _select(tree, node, exploration), tree.node[node].stop
            if a < 0:
                break
            new = tree.edge[node, a].first < 0
            if new:
                _expand(model, scratch, tree, node, a, rng)
                scratch.error[:] = -1.0
                for child in range(tree.edge[node, a].first, tree.size[0]):
                    leaf = tree.node[child]
                    _arrive(model, tabled, scratch, tree, child, a)
                    if tabled is None:
                        leaf.value = evaluate_plans(
                            model, plans, leaf.x, tree.prob[child], scratch, leaf.stop, x < 0
                        )
                    _count_percept(scratch, tree.level[child], a, -1.0)
            tree.edge[node, a].visits += 1
            sampled.path[depth, 0], sampled.path[depth, 1] = node, a
            sampled.reward[depth] = _step_reward(model, x, a, sampled.truth, scratch.total)
            node = _execute(model, scratch, tree, sampled, node, a, rng)
            depth, value = depth + 1, tree.node[node].value
        _back_up(model.dynamics.step, scratch, tree, sampled, node, depth, value, averaged)
    return simulations


@kernel
def _select(tree, node, exploration):
    """Choose by UCB1 among the behaviors; ending has no variance and so no bonus. -1 = end."""
    best, best_score = -1, tree.node[node].stop
    spread = np.log(tree.node[node].visits + 1.0)
    for a in range(tree.edge.shape[1]):
        edge = tree.edge[node, a]
        if edge.value > -np.inf:  # else it is illegal, or cannot help
            score = edge.value + exploration * np.sqrt(spread / (edge.visits + 1.0))
            if score > best_score:
                best, best_score = a, score
    return best


@kernel
def _expand(model, scratch, tree, node, a, rng):
    """Create the children of an edge: every informative outcome, or a sample of too many."""
    x, outcomes = tree.node[node].x, 1.0
    for i in range(tree.level.shape[1]):
        scratch.chance[i] = true_chance(model.percepts, tree.prob[node], i)
        outcomes *= scratch.counts.shape[2] if model.percepts.informative[i, a] else 1
    tree.edge[node, a].reward = _step_reward(model, x, a, scratch.chance, scratch.total)
    tree.edge[node, a].first = tree.size[0]
    perceives, listed = scratch.total[a] < model.percepts.limit[a], outcomes <= ENUMERATE
    for k in range(model.dynamics.branch.shape[2]):
        branch = model.dynamics.branch[x, a, k]
        if branch.p <= 0.0:
            break
        for outcome in range(int(outcomes) if listed else DRAWN):
            child, prob = tree.node[tree.size[0]], tree.prob[tree.size[0]]
            level = tree.level[tree.size[0]]
            child.branch, child.p = k, branch.p if listed else branch.p / DRAWN
            level[:] = -1
            for i in range(prob.shape[0]):
                for c in range(prob.shape[1]):
                    prob[i, c] = tree.prob[node, i, c]
            if branch.senses and perceives:
                _perceive(model.percepts, scratch, tree, node, a, outcome if listed else -1, rng)
            else:
                child.p = branch.p if outcome == 0 else 0.0
            if child.p > 0.0:
                child.x, child.visits, child.stop = branch.x, 0, stop_value(model, prob)
                tree.size[0] += 1
    tree.edge[node, a].count = tree.size[0] - tree.edge[node, a].first


@kernel
def _perceive(percepts, scratch, tree, node, a, outcome, rng):
    """Compute the belief of the next free node, by percept `outcome`, or by a drawn one (-1)."""
    child, levels, rest = tree.size[0], scratch.counts.shape[2], outcome
    for i in range(tree.level.shape[1]):
        tree.level[child, i] = 0
        if not percepts.informative[i, a]:
            continue
        z = rest % levels if outcome >= 0 else i * 0
        p = condition(percepts, scratch, tree.prob[node], i, a, z, tree.prob[child])
        if outcome >= 0:
            tree.node[child].p *= p
            rest //= levels
        else:
            u = rng.random() - p
            while u >= 0.0 and z < levels - 1:
                z += 1
                u -= condition(percepts, scratch, tree.prob[node], i, a, z, tree.prob[child])
        tree.level[child, i] = z


@kernel
def _arrive(model, tabled, scratch, tree, child, a):
    """Count the percept that led to a child; value it by the table, if there is one."""
    node, level = tree.node[child], tree.level[child]
    _count_percept(scratch, level, a, 1.0)
    for i in range(level.shape[0]):
        scratch.shown[i] = level[i] + 1
        scratch.chance[i] = true_chance(model.percepts, tree.prob[child], i)
    if tabled is not None:
        node.value = max(node.stop, _estimate(model, tabled, scratch, node.x, -1 - node.x))


@kernel
def _open_node(model, tabled, scratch, tree, node):
    """Create the edges of a visited node; values are -inf where a behavior cannot help."""
    x = tree.node[node].x
    for i in range(scratch.chance.shape[0]):
        scratch.chance[i] = true_chance(model.percepts, tree.prob[node], i)
    for a in range(tree.edge.shape[1]):
        value = scratch.value[a]
        if tabled is not None:
            value = -np.inf
            if model.dynamics.step[x, a].legal and not is_idle(model, x, a, scratch.total):
                mean = 0.0
                for k in range(model.dynamics.branch.shape[2]):
                    branch = model.dynamics.branch[x, a, k]
                    behavior = a if branch.senses else -1 - a
                    mean += branch.p * _estimate(model, tabled, scratch, branch.x, behavior)
                reward = _step_reward(model, x, a, scratch.chance, scratch.total)
                value = reward + model.dynamics.step[x, a].discount * mean
        edge = tree.edge[node, a]
        edge.visits, edge.first, edge.count, edge.value = 0, -1, 0, value
        tree.node[node].value = max(tree.node[node].value, value)


@kernel
def _estimate(model, tabled, scratch, x, behavior):
    """Return the table's value at x after a percept of a behavior (none below 0)."""
    return value_after(
        tabled.table, model.percepts.rows, model.percepts.informative, x, behavior,
        scratch.chance, tabled.reading,
    )  # fmt: skip


@kernel
def _step_reward(model, x, a, chance, total):
    """Compute minus the cost of a behavior, plus its bonus at Pr(attribute is true) (N,)."""
    reward = -model.dynamics.step[x, a].cost
    if model.shaped and total[a] < model.paid[a]:
        for i in range(chance.shape[0]):
            b = chance[i]
            mean = b * model.bonus[i, a, 1] + (1.0 - b) * model.bonus[i, a, 0]
            reward += model.dynamics.step[x, a].bonus_scale * mean
    return reward


@kernel
def _count_percept(scratch, level, a, sign):
    """Count a percept (N,) of a behavior (sign 1), or remove it (-1); level -1 is none."""
    if level[0] >= 0:
        scratch.total[a] += sign
        for i in range(level.shape[0]):
            scratch.counts[i, a, level[i]] += sign


@kernel
def _execute(model, scratch, tree, sampled, node, a, rng):
    """Execute a behavior in the sampled MOMDP; return the child that it leads to.

    Where not all outcomes have a child, the percept may have none: then one of them is drawn.
    """
    edge, percepts = tree.edge[node, a], model.percepts
    u, k = rng.random(), 0
    while k < model.dynamics.branch.shape[2] - 1:
        branch = model.dynamics.branch[tree.node[node].x, a, k]
        if u < branch.p or model.dynamics.branch[tree.node[node].x, a, k + 1].p <= 0.0:
            break
        u, k = u - branch.p, k + 1
    level = tree.level[tree.size[0]]  # of a node that is free
    draw_percept(percepts, sampled, a, level, rng)
    successor, siblings = edge.first, 0
    for child in range(edge.first, edge.first + edge.count):
        if tree.node[child].branch != k:
            continue
        siblings += 1
        same = True
        for i in range(level.shape[0]):
            apart = percepts.informative[i, a] and tree.level[child, i] >= 0
            same = same and not (apart and tree.level[child, i] != level[i])
        if same:
            successor = child
            break
        if rng.random() * siblings < 1.0:
            successor = child
    _count_percept(scratch, tree.level[successor], a, 1.0)
    return successor


@kernel
def _back_up(steps, scratch, tree, sampled, node, depth, value, averaged):
    """Update the edges on the way to a node by returns, averaged, or by exact expectations.

    The value of a node is that of its best action; the percepts on the way are forgotten.
    """
    for t in range(depth - 1, -1, -1):
        a = sampled.path[t, 1]
        _count_percept(scratch, tree.level[node], a, -1.0)
        node = sampled.path[t, 0]
        edge, step = tree.edge[node, a], steps[tree.node[node].x, a]
        value = sampled.reward[t] + step.discount * value
        if averaged > 0.0:
            edge.value += (value - edge.value) / edge.visits
        else:
            mean = 0.0
            for child in range(edge.first, edge.first + edge.count):
                mean += tree.node[child].p * tree.node[child].value
            edge.value = edge.reward + step.discount * mean
        best = tree.node[node].stop
        for other in range(tree.edge.shape[1]):
            best = max(best, tree.edge[node, other].value)
        tree.node[node].value = best
    if depth > 0:  # a decision shows the rows of its last simulations
        a = sampled.path[0, 1]
        last = (tree.edge[0, a].visits - 1) % KEPT
        for i in range(sampled.latent.shape[0]):
            for z in range(sampled.rows.shape[2]):
                sampled.kept[a, last, i, z] = sampled.rows[a, i, z]
