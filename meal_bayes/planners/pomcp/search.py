"""POMCP's tree search, read from the top: simulate, select, expand, value, execute, back up.

The search values its leaves by the plans' kernels. Two entry kernels would each hold a copy of
these, and a third of what a first decision waits for would be compiled twice: so there is one, of
plans and search. Python calls it by the functions of `planners.entry`.

Kernels over the tree and the sampled MOMDPs (`tree.py`), and the leaf evaluators. Open-loop plans
give a lower bound for any MOMDP. Where the marginals are the state (Eq. 8) and few enough, a table
of factored value iteration estimates the optimum.
"""

from typing import NamedTuple

import numpy as np

from meal_bayes.planners.factored.grid import value_after
from meal_bayes.planners.kernels import NO_BEHAVIOR, Index, entry_kernel, kernel
from meal_bayes.planners.open_loop.values import (
    evaluate_plans,
    is_idle,
    stop_value,
    true_chance,
    value_plans,
)
from meal_bayes.planners.pomcp.tree import (
    DEPTH,
    KEPT,
    Percept,
    Sampled,
    Tree,
    condition,
    draw_object,
    draw_percept,
)

ENUMERATE = 64  # percept vectors up to which an edge gets a child for each
DRAWN = 24  # children of an edge with more


class Growing(NamedTuple):
    """How a tree is to grow."""

    simulations: int
    exploration: float  # UCB1's constant, s of reward
    averaged: bool  # do edges average returns? else they take the expectation over outcomes


class Search(NamedTuple):
    """A tree that grows."""

    tree: Tree
    sampled: Sampled
    growing: Growing


class Edge(NamedTuple):
    """Indices of an edge."""

    node: Index
    behavior: Index


class Return(NamedTuple):
    """What a simulation comes to from a step on."""

    value: float
    bonus: float  # of it, what shaping pays


class Outcome(NamedTuple):
    """An outcome of a behavior from a node."""

    node: Index
    behavior: Index
    percept: Index  # its levels as digits, of the informative attributes alone; -1 = to be drawn


@entry_kernel
def plan(evaluator, beliefs, search, reader, rng):
    """Value plans at beliefs, then grow a tree from its root; either may be nothing to do.

    A simulation descends the tree in a MOMDP sampled from the posterior, until ending is best, or
    to a child of the first edge that is new, and backs up its return. Leaves are valued by plans,
    or by a table where `reader` is not None: numba compiles a kernel for each of the two, without
    the other's code. Returns how many simulations fit the tree's capacity.
    """
    if reader is None:
        value_plans(evaluator, beliefs)
    model = evaluator.model
    scratch = evaluator.scratch
    tree = search.tree
    sampled = search.sampled
    width = model.dynamics.branch.shape[2] * ENUMERATE
    for done in range(search.growing.simulations):
        if tree.size[0] + width >= tree.node.shape[0]:  # a free node stays, for `_execute`
            return done
        draw_object(model.percepts, sampled, rng)
        node = np.int64(0)
        depth = 0
        value = 0.0  # of what follows, and of it the bonus
        bonus = 0.0
        is_new = False
        while depth < DEPTH and not is_new:
            # A node's edges begin with what its leaf evaluator says of each behavior.
            x = tree.node[node].x
            if tree.node[node].visits == 0:
                if reader is None:
                    evaluate_plans(evaluator, x, tree.prob[node], -np.inf, np.bool_(True))
                _open_node(model, scratch, tree, reader, node)
            tree.node[node].visits += 1
            # Select, or end here: the report's value is exact, and needs no further simulation.
            a = _select(tree, node, search.growing.exploration)
            value = tree.node[node].stop
            bonus = 0.0
            if a < 0:
                break
            # An edge that is new gets its children, and the simulation ends in one of them.
            edge = Edge(node, a)
            is_new = tree.edge[node, a].first < 0
            if is_new:
                _expand(model, scratch, tree, edge, rng)
                _value_children(evaluator, tree, reader, edge)
            # Execute in the sampled MOMDP.
            tree.edge[node, a].visits += 1
            sampled.path[depth, 0] = node
            sampled.path[depth, 1] = a
            paid = _step_bonus(model, x, a, sampled.truth, scratch.evidence.total)
            sampled.paid[depth] = paid
            sampled.reward[depth] = paid - model.dynamics.step[x, a].cost
            node = _execute(model, tree, sampled, edge, rng)
            _count_percept(scratch.evidence, tree.level[node], a, 1.0)
            depth += 1
            value = tree.node[node].value
            bonus = tree.node[node].bonus
        # Back up along the path: return = R + g return. The percepts on the way are removed.
        for t in range(depth - 1, -1, -1):
            a = sampled.path[t, 1]
            _count_percept(scratch.evidence, tree.level[node], a, -1.0)
            node = sampled.path[t, 0]
            discount = model.dynamics.step[tree.node[node].x, a].discount
            value = sampled.reward[t] + discount * value
            bonus = sampled.paid[t] + discount * bonus
            outcome = Return(value, bonus)
            _back_up(tree, Edge(node, a), discount, outcome, search.growing.averaged)
        if depth > 0:
            _keep_rows(tree, sampled)
    return search.growing.simulations


@kernel
def _select(tree, node, exploration):
    """Choose by UCB1 among the behaviors; ending has no variance and so no bonus. -1 = end."""
    best = -1
    best_score = tree.node[node].stop
    spread = np.log(tree.node[node].visits + 1.0)
    for a in range(tree.edge.shape[1]):
        edge = tree.edge[node, a]
        if edge.value > -np.inf:  # else it is illegal, or cannot help
            # Q(node, a) + c sqrt(ln n(node) / n(node, a))
            score = edge.value + exploration * np.sqrt(spread / (edge.visits + 1.0))
            if score > best_score:
                best = a
                best_score = score
    return best


@kernel
def _expand(model, scratch, tree, edge, rng):
    """Create the children of an edge: every informative outcome, or a sample of too many."""
    node, a = edge
    x = tree.node[node].x
    outcomes = 1.0
    for i in range(tree.level.shape[1]):
        scratch.chance[i] = true_chance(model.percepts, tree.prob[node], i)
        outcomes *= scratch.evidence.counts.shape[2] if model.percepts.informative[i, a] else 1
    total = scratch.evidence.total
    paid = _step_bonus(model, x, a, scratch.chance, total)
    tree.edge[node, a].paid = paid
    tree.edge[node, a].reward = paid - model.dynamics.step[x, a].cost
    tree.edge[node, a].first = tree.size[0]
    perceives = total[a] < model.percepts.limit[a]
    listed = outcomes <= ENUMERATE
    for k in range(model.dynamics.branch.shape[2]):
        branch = model.dynamics.branch[x, a, k]
        if branch.p <= 0.0:
            break
        for outcome in range(int(outcomes) if listed else DRAWN):
            # Pr(child) = Pr(branch) Pr(percept), or an equal part of the branch if it is drawn.
            child = tree.node[tree.size[0]]
            prob = tree.prob[tree.size[0]]
            tree.level[tree.size[0]][:] = -1
            child.branch = k
            child.p = branch.p if listed else branch.p / DRAWN
            for i in range(prob.shape[0]):
                for c in range(prob.shape[1]):
                    prob[i, c] = tree.prob[node, i, c]
            if branch.senses and perceives:
                percept = Outcome(node, a, outcome if listed else -1)
                _perceive(model.percepts, scratch.evidence, tree, percept, rng)
            else:  # no percept: one child for the branch
                child.p = branch.p if outcome == 0 else 0.0
            if child.p > 0.0:
                child.x = branch.x
                child.visits = 0
                child.stop = stop_value(model, prob)
                child.bonus = 0.0
                tree.size[0] += 1
    tree.edge[node, a].count = tree.size[0] - tree.edge[node, a].first


@kernel
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


@kernel
def _value_children(evaluator, tree, reader, edge):
    """Value the children of a new edge: the best of ending and of the leaf evaluator."""
    model = evaluator.model
    scratch = evaluator.scratch
    node, a = edge
    scratch.error[:] = -1.0
    for child in range(tree.edge[node, a].first, tree.size[0]):
        leaf = tree.node[child]
        level = tree.level[child]
        prob = tree.prob[child]
        _count_percept(scratch.evidence, level, a, 1.0)
        if reader is None:
            for i in range(level.shape[0]):
                scratch.column[i] = level[i] + 1
            leaf.value = evaluate_plans(evaluator, leaf.x, prob, leaf.stop, np.bool_(False))
            if model.shaped and leaf.value > leaf.stop:
                for b in range(scratch.value.shape[0]):
                    if scratch.value[b] == leaf.value:
                        leaf.bonus = scratch.bonus[b]
        else:
            for i in range(level.shape[0]):
                scratch.chance[i] = true_chance(model.percepts, prob, i)
            leaf.value = max(leaf.stop, value_after(reader, leaf.x, NO_BEHAVIOR, scratch.chance))
        _count_percept(scratch.evidence, level, a, -1.0)


@kernel
def _open_node(model, scratch, tree, reader, node):
    """Create the edges of a visited node; values are -inf where a behavior cannot help."""
    total = scratch.evidence.total
    x = tree.node[node].x
    tree.node[node].bonus = 0.0
    for i in range(scratch.chance.shape[0]):
        scratch.chance[i] = true_chance(model.percepts, tree.prob[node], i)
    for a in range(tree.edge.shape[1]):
        value = scratch.value[a]
        bonus = scratch.bonus[a]
        if reader is not None:
            # Bellman, one step ahead of the table: Q(x, b, a) = R + g sum_k p_k E V(x_k, b').
            # There is no bonus where a table is read.
            value = -np.inf
            if model.dynamics.step[x, a].legal and not is_idle(model, x, a, total):
                mean = 0.0
                for k in range(model.dynamics.branch.shape[2]):
                    branch = model.dynamics.branch[x, a, k]
                    behavior = a if branch.senses else NO_BEHAVIOR
                    mean += branch.p * value_after(reader, branch.x, behavior, scratch.chance)
                step = model.dynamics.step[x, a]
                value = -step.cost + step.discount * mean
        edge = tree.edge[node, a]
        edge.visits = 0
        edge.first = -1
        edge.count = 0
        edge.value = value
        edge.bonus = bonus
        if value > tree.node[node].value:
            tree.node[node].value = value
            tree.node[node].bonus = bonus


@kernel
def _step_bonus(model, x, a, chance, total):
    """Compute what a behavior is paid for its percept, at Pr(attribute is true) (N,)."""
    paid = 0.0
    if model.shaped and total[a] < model.paid[a]:
        for i in range(chance.shape[0]):
            b = chance[i]
            mean = b * model.bonus[i, a, 1] + (1.0 - b) * model.bonus[i, a, 0]
            paid += model.dynamics.step[x, a].percepts * mean
    return paid


@kernel
def _count_percept(evidence, level, a, sign):
    """Count a percept (N,) of a behavior (sign 1), or remove it (-1); level -1 is none."""
    if level[0] >= 0:
        evidence.total[a] += sign
        for i in range(level.shape[0]):
            evidence.counts[i, a, level[i]] += sign


@kernel
def _execute(model, tree, sampled, edge, rng):
    """Execute a behavior in the sampled MOMDP; return the child that it leads to.

    Where not all outcomes have a child, the percept may have none: then one of them is drawn.
    """
    dynamics = model.dynamics
    percepts = model.percepts
    node, a = edge
    x = tree.node[node].x
    # The branch by inversion, and a percept of the sampled object, into a node that is free.
    u = rng.random()
    k = 0
    while k < dynamics.branch.shape[2] - 1:
        p = dynamics.branch[x, a, k].p
        if u < p or dynamics.branch[x, a, k + 1].p <= 0.0:
            break
        u -= p
        k += 1
    level = tree.level[tree.size[0]]
    draw_percept(percepts, sampled, a, level, rng)
    # The sibling that shows these levels, or one of the branch at random (reservoir sampling).
    first = tree.edge[node, a].first
    successor = first
    siblings = 0
    for child in range(first, first + tree.edge[node, a].count):
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
    return successor


@kernel
def _back_up(tree, edge, discount, outcome, averaged):
    """Update an edge by a return, averaged, or by the exact expectation; then its node.

    The value of a node is that of its best action; of it, the bonus is what this one is paid.
    """
    node, a = edge
    record = tree.edge[node, a]
    if averaged:  # Q += (return - Q) / n
        record.value += (outcome.value - record.value) / record.visits
        record.bonus += (outcome.bonus - record.bonus) / record.visits
    else:  # Q = R + g sum over children of Pr(child) V(child)
        mean = 0.0
        paid = 0.0
        for child in range(record.first, record.first + record.count):
            mean += tree.node[child].p * tree.node[child].value
            paid += tree.node[child].p * tree.node[child].bonus
        record.value = record.reward + discount * mean
        record.bonus = record.paid + discount * paid
    # V = max(stop, max_a Q)
    best = tree.node[node].stop
    bonus = 0.0
    for other in range(tree.edge.shape[1]):
        if tree.edge[node, other].value > best:
            best = tree.edge[node, other].value
            bonus = tree.edge[node, other].bonus
    tree.node[node].value = best
    tree.node[node].bonus = bonus


@kernel
def _keep_rows(tree, sampled):
    """Keep the sampled rows of the simulation's first behavior, for the decision to show."""
    a = sampled.path[0, 1]
    last = (tree.edge[0, a].visits - 1) % KEPT
    for i in range(sampled.latent.shape[0]):
        for z in range(sampled.rows.shape[2]):
            sampled.kept[a, last, i, z] = sampled.rows[a, i, z]
