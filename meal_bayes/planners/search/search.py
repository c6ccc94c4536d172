"""The tree search of POMCP, in the order of a simulation: select, expand, value, execute, back up.

The tree and the sampled MOMDPs are in `tree`, and the values of leaves in `leaves`.
"""

from typing import NamedTuple

import numpy as np

from meal_bayes.planners.jit import Index, by_reference, called_kernel, entry_kernel, kernel
from meal_bayes.planners.plans.values import stop_value, true_chance
from meal_bayes.planners.search.leaves import value_behaviors, value_leaf
from meal_bayes.planners.search.tree import (
    DEPTH,
    KEPT,
    Percept,
    Sampled,
    Tree,
    condition,
    draw_percept,
    draw_root_object,
)

ENUMERATE = 64  # largest number of percept vectors for which an edge gets a child for each
DRAWN = 24  # number of sampled children of an edge with more percept vectors


@by_reference
class Growing(NamedTuple):
    """Settings of the growth of a tree."""

    simulations: int
    exploration: float  # UCB1's constant, s of reward
    averaged: bool  # do edges average returns? otherwise they use the expectation over outcomes


@by_reference
class TreeSearch(NamedTuple):
    """A tree, its sampled MOMDP, and the settings of its growth."""

    tree: Tree
    sampled: Sampled
    growing: Growing


class Return(NamedTuple):
    """Return of a simulation from a step on."""

    value: float
    bonus: float  # the exploration bonus in it


class Edge(NamedTuple):
    """Indices of an edge."""

    node: Index
    behavior: Index


class BranchOutcome(NamedTuple):
    """An outcome of a behavior from a node."""

    node: Index
    behavior: Index
    percept: Index  # levels of informative attributes as digits of a number; -1 = draw the percept


@entry_kernel
def grow_tree(evaluator, search, reader, rng):
    """Grow a tree from its root by simulations.

    A simulation descends the tree in a MOMDP sampled from the posterior, until ending the trial is
    best, a new edge is taken, or the depth is `DEPTH`. Then the values of the edges on its way are
    updated, by default by the expectation over their children; the simulation's own return is used
    only if `growing.averaged`. `reader` reads a table, or is None; see `leaves`. The function
    returns how many simulations the capacity of the tree allowed.
    """
    model = evaluator.model
    scratch = evaluator.scratch
    tree = search.tree
    sampled = search.sampled
    width = model.dynamics.branch.shape[2] * ENUMERATE
    for done in range(search.growing.simulations):
        if tree.size[0] + width >= tree.node.shape[0]:  # `_execute` writes into the next free one
            return done
        # Root sampling [Katt2017]: an object from the belief, and its rows from their posterior.
        draw_root_object(model.percepts, sampled, rng)
        node = np.int64(0)
        depth = 0
        value = 0.0  # value of the last node
        bonus = 0.0  # the exploration bonus in it
        is_new = False
        while depth < DEPTH and not is_new:
            # The edges of a node begin with the leaf evaluator's values of the behaviors.
            x = tree.node[node].x
            if tree.node[node].visits == 0:
                value_behaviors(evaluator, reader, x, tree.prob[node])
                _open_node(scratch, tree, node)
            tree.node[node].visits += 1
            # Select a behavior, or end with the answer, whose value is exact.
            a = _select(tree, node, search.growing.exploration)
            value = tree.node[node].stop
            bonus = 0.0
            if a < 0:
                break
            # A new edge gets its children, and the simulation ends in one of them.
            edge = Edge(node, a)
            is_new = tree.edge[node, a].first < 0
            if is_new:
                _expand(model, scratch, tree, edge, rng)
                _value_children(evaluator, tree, reader, edge)
            # Execute in the sampled MOMDP; store node, action, bonus and reward of the step.
            tree.edge[node, a].visits += 1
            sampled.path[depth, 0] = node
            sampled.path[depth, 1] = a
            paid = _step_bonus(model, x, a, sampled.truth, scratch.evidence.total)
            sampled.bonus[depth] = paid
            sampled.reward[depth] = paid - model.dynamics.step[x, a].cost
            node = _execute(model, tree, sampled, edge, rng)
            _count_percept(scratch.evidence, tree.level[node], a, 1.0)
            depth += 1
            value = tree.node[node].value
            bonus = tree.node[node].bonus
        if depth > 0:
            _back_up_path(evaluator, search, node, depth, Return(value, bonus))
            _keep_rows(tree, sampled)
    return search.growing.simulations


@kernel
def _open_node(scratch, tree, node):
    """Create the edges of a visited node, which begin with the values in `scratch`."""
    tree.node[node].bonus = 0.0
    for a in range(tree.edge.shape[1]):
        edge = tree.edge[node, a]
        edge.visits = 0
        edge.first = -1
        edge.count = 0
        edge.value = scratch.value[a]
        edge.bonus = scratch.bonus[a]
        if edge.value > tree.node[node].value:
            tree.node[node].value = edge.value
            tree.node[node].bonus = edge.bonus


@kernel
def _select(tree, node, exploration):
    """Choose by UCB1 among the behaviors; ending has no variance and so no bonus. -1 = end."""
    best = -1
    best_score = tree.node[node].stop
    # One visit is added to n(node) and n(node, a), so that the score of a new edge is finite.
    spread = np.log(tree.node[node].visits + 1.0)
    for a in range(tree.edge.shape[1]):
        edge = tree.edge[node, a]
        if edge.value > -np.inf:  # otherwise it is illegal or useless
            # Q(node, a) + c sqrt(ln n(node) / n(node, a))
            score = edge.value + exploration * np.sqrt(spread / (edge.visits + 1.0))
            if score > best_score:
                best = a
                best_score = score
    return best


@called_kernel
def _expand(model, scratch, tree, edge, rng):
    """Create the children of an edge: every informative outcome, or a sample of too many."""
    node, a = edge
    x = tree.node[node].x
    outcomes = 1.0
    for i in range(tree.level.shape[1]):
        scratch.chance[i] = true_chance(model.percepts, tree.prob[node], i)
        # K^n outcomes, for the n attributes about which the behavior is informative.
        outcomes *= scratch.evidence.counts.shape[2] if model.percepts.informative[i, a] else 1
    total = scratch.evidence.total
    bonus = _step_bonus(model, x, a, scratch.chance, total)
    # R(x, b, a) = bonus - cost; later rewards are added when the edge is backed up.
    tree.edge[node, a].step_bonus = bonus
    tree.edge[node, a].reward = bonus - model.dynamics.step[x, a].cost
    tree.edge[node, a].first = tree.size[0]
    perceives = total[a] < model.percepts.limit[a]
    listed = outcomes <= ENUMERATE
    for k in range(model.dynamics.branch.shape[2]):
        branch = model.dynamics.branch[x, a, k]
        if branch.p <= 0.0:
            break
        for outcome in range(int(outcomes) if listed else DRAWN):
            # The next free node becomes the child. Its probability is Pr(branch) Pr(percept), where
            # `_perceive` multiplies the second factor, or Pr(branch) / DRAWN for drawn percepts.
            child = tree.node[tree.size[0]]
            prob = tree.prob[tree.size[0]]
            tree.level[tree.size[0]][:] = -1
            child.branch = k
            child.p = branch.p if listed else branch.p / DRAWN
            for i in range(prob.shape[0]):
                for c in range(prob.shape[1]):
                    prob[i, c] = tree.prob[node, i, c]
            if branch.senses and perceives:
                percept = BranchOutcome(node, a, outcome if listed else -1)
                _perceive(model.percepts, scratch.evidence, tree, percept, rng)
            else:  # no percept: one child for the branch
                child.p = branch.p if outcome == 0 else 0.0
            if child.p > 0.0:
                # The node of an outcome with probability 0 is overwritten by the next one.
                child.x = branch.x
                child.visits = 0
                child.stop = stop_value(model, model.conjunction, prob)
                child.bonus = 0.0
                tree.size[0] += 1
    tree.edge[node, a].count = tree.size[0] - tree.edge[node, a].first


@called_kernel
def _perceive(percepts, evidence, tree, outcome, rng):
    """Compute the belief of the next free node after an outcome, whose percept may be drawn."""
    node, a, digits = outcome
    prob = tree.prob[node]
    child = tree.size[0]
    levels = evidence.counts.shape[2]
    drawn = digits < 0
    for i in range(tree.level.shape[1]):
        tree.level[child, i] = 0
        if not percepts.informative[i, a]:
            continue
        # The number of the outcome has the levels as digits to the base K.
        z = np.int64(0) if drawn else digits % levels
        p = condition(percepts, evidence, Percept(i, a, z), prob, tree.prob[child])
        if not drawn:
            tree.node[child].p *= p
            digits //= levels
        else:  # draw a level by inversion
            u = rng.random() - p
            while u >= 0.0 and z < levels - 1:
                z += 1
                u -= condition(percepts, evidence, Percept(i, a, z), prob, tree.prob[child])
        tree.level[child, i] = z


@called_kernel
def _value_children(evaluator, tree, reader, edge):
    """Compute the values of the children of a new edge with the leaf evaluator."""
    scratch = evaluator.scratch
    node, a = edge
    scratch.error[:] = -1.0
    scratch.tabled[:] = -1.0
    for child in range(tree.edge[node, a].first, tree.size[0]):
        _count_percept(scratch.evidence, tree.level[child], a, 1.0)
        value_leaf(evaluator, reader, tree, child)
        _count_percept(scratch.evidence, tree.level[child], a, -1.0)


@called_kernel
def _execute(model, tree, sampled, edge, rng):
    """Execute a behavior in the sampled MOMDP; return the resulting child.

    If only some outcomes have children and the percept has none, one of the children is drawn.
    """
    dynamics = model.dynamics
    percepts = model.percepts
    node, a = edge
    x = tree.node[node].x
    # Draw the branch by inversion, and a percept of the sampled object into a free node.
    u = rng.random()
    k = 0
    while k < dynamics.branch.shape[2] - 1:
        p = dynamics.branch[x, a, k].p
        if u < p or dynamics.branch[x, a, k + 1].p <= 0.0:
            break
        u -= p
        k += 1
    level = tree.level[tree.size[0]]  # the next free node stores the percept temporarily
    draw_percept(percepts, sampled, a, level, rng)
    # The child with these levels, or a random child of the branch (reservoir sampling).
    first = tree.edge[node, a].first
    successor = first
    siblings = 0
    for child in range(first, first + tree.edge[node, a].count):
        if tree.node[child].branch != k:
            continue
        siblings += 1
        same = True
        for i in range(level.shape[0]):
            compares = percepts.informative[i, a] and tree.level[child, i] >= 0
            same = same and not (compares and tree.level[child, i] != level[i])
        if same:
            successor = child
            break
        if rng.random() * siblings < 1.0:
            successor = child
    return successor


@called_kernel
def _back_up_path(evaluator, search, node, depth, leaf):
    """Back up a simulation from its last node, and remove its percepts from the counts."""
    tree = search.tree
    sampled = search.sampled
    value = leaf.value
    bonus = leaf.bonus
    for t in range(depth - 1, -1, -1):
        # Remove the percept of the step, so that the counts are those at its node again.
        a = sampled.path[t, 1]
        _count_percept(evaluator.scratch.evidence, tree.level[node], a, -1.0)
        node = sampled.path[t, 0]
        # return = R + g return
        discount = evaluator.model.dynamics.step[tree.node[node].x, a].discount
        value = sampled.reward[t] + discount * value
        bonus = sampled.bonus[t] + discount * bonus
        _back_up(tree, Edge(node, a), discount, Return(value, bonus), search.growing.averaged)


@kernel
def _back_up(tree, edge, discount, outcome, averaged):
    """Update an edge by the mean return or by the exact expectation, and then its node.

    Value and bonus of a node are those of its best action.
    """
    node, a = edge
    record = tree.edge[node, a]
    if averaged:  # Q += (return - Q) / n
        record.value += (outcome.value - record.value) / record.visits
        record.bonus += (outcome.bonus - record.bonus) / record.visits
    else:  # Q = R + g sum over children of Pr(child) V(child)
        mean = 0.0
        mean_bonus = 0.0
        for child in range(record.first, record.first + record.count):
            mean += tree.node[child].p * tree.node[child].value
            mean_bonus += tree.node[child].p * tree.node[child].bonus
        record.value = record.reward + discount * mean
        record.bonus = record.step_bonus + discount * mean_bonus
    # V = max(stop, max_a Q)
    best = tree.node[node].stop
    bonus = 0.0
    for other in range(tree.edge.shape[1]):
        if tree.edge[node, other].value > best:
            best = tree.edge[node, other].value
            bonus = tree.edge[node, other].bonus
    tree.node[node].value = best
    tree.node[node].bonus = bonus


@called_kernel
def _keep_rows(tree, sampled):
    """Store the sampled rows of the first behavior, which the decision shows."""
    a = sampled.path[0, 1]
    last = (tree.edge[0, a].visits - 1) % KEPT
    for i in range(sampled.latent.shape[0]):
        for z in range(sampled.rows.shape[2]):
            sampled.recent[a, last, i, z] = sampled.rows[a, i, z]


@kernel
def _step_bonus(model, x, a, chance, total):
    """Compute the bonus (s) of a behavior's percept, at Pr(attribute is true) (N,)."""
    bonus = 0.0
    if model.shaped and total[a] < model.bonus_limit[a]:
        for i in range(chance.shape[0]):
            b = chance[i]
            # The bonus depends on the truth: take the expectation over the belief b.
            mean = b * model.bonus[i, a, 1] + (1.0 - b) * model.bonus[i, a, 0]
            bonus += model.dynamics.step[x, a].percepts * mean
    return bonus


@kernel
def _count_percept(evidence, level, a, sign):
    """Count a percept (N,) of a behavior (sign 1), or remove it (-1); level -1 is none."""
    if level[0] >= 0:
        evidence.total[a] += sign
        for i in range(level.shape[0]):
            evidence.counts[i, a, level[i]] += sign
