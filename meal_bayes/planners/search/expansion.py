"""New edges of a tree: their children, what these believe, and what they are worth."""

from typing import NamedTuple

import numpy as np

from meal_bayes.planners.jit import NO_BEHAVIOR, Index, called_kernel, kernel
from meal_bayes.planners.plans.values import (
    evaluate_plans,
    is_useless,
    stop_value,
    true_chance,
)
from meal_bayes.planners.search.tree import Percept, condition
from meal_bayes.planners.table.grid import value_after

ENUMERATE = 64  # percept vectors up to which an edge gets a child for each
DRAWN = 24  # children of an edge with more


class Edge(NamedTuple):
    """Indices of an edge."""

    node: Index
    behavior: Index


class BranchOutcome(NamedTuple):
    """An outcome of a behavior from a node."""

    node: Index
    behavior: Index
    percept: Index  # its levels as digits, of the informative attributes alone; -1 = to be drawn


@called_kernel
def expand(model, scratch, tree, edge, rng):
    """Create the children of an edge: every informative outcome, or a sample of too many."""
    node, a = edge
    x = tree.node[node].x
    outcomes = 1.0
    for i in range(tree.level.shape[1]):
        scratch.chance[i] = true_chance(model.percepts, tree.prob[node], i)
        # K^n outcomes, of the n attributes that the behavior informs of.
        outcomes *= scratch.evidence.counts.shape[2] if model.percepts.informative[i, a] else 1
    total = scratch.evidence.total
    bonus = step_bonus(model, x, a, scratch.chance, total)
    # R(x, b, a) = bonus - cost; what follows is added when the edge is backed up.
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
            # The next free node becomes the child: p = Pr(branch) Pr(percept), by which `_perceive`
            # multiplies, or an equal part of the branch if the percept is drawn.
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
                # An outcome of probability 0 takes no node: the next one overwrites it.
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
        # The outcome's number holds the levels as digits to the base K, one an informed attribute.
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
def value_children(evaluator, tree, reader, edge):
    """Value the children of a new edge: the best of ending and of the leaf evaluator."""
    model = evaluator.model
    scratch = evaluator.scratch
    node, a = edge
    scratch.error[:] = -1.0
    scratch.tabled[:] = -1.0
    for child in range(tree.edge[node, a].first, tree.size[0]):
        leaf = tree.node[child]
        level = tree.level[child]
        prob = tree.prob[child]
        count_percept(scratch.evidence, level, a, 1.0)
        if reader is None:
            # Siblings that show an attribute the same level share its belief, and so its errors.
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
        count_percept(scratch.evidence, level, a, -1.0)


@called_kernel
def open_node(model, scratch, tree, reader, node):
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
            if model.dynamics.step[x, a].legal and not is_useless(model, x, a, total):
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
def step_bonus(model, x, a, chance, total):
    """Compute the bonus (s) of a behavior's percept, at Pr(attribute is true) (N,)."""
    bonus = 0.0
    if model.shaped and total[a] < model.bonus_limit[a]:
        for i in range(chance.shape[0]):
            b = chance[i]
            # Eq. 11 is of a truth: E over the belief b.
            mean = b * model.bonus[i, a, 1] + (1.0 - b) * model.bonus[i, a, 0]
            bonus += model.dynamics.step[x, a].percepts * mean
    return bonus


@kernel
def count_percept(evidence, level, a, sign):
    """Count a percept (N,) of a behavior (sign 1), or remove it (-1); level -1 is none."""
    if level[0] >= 0:
        evidence.total[a] += sign
        for i in range(level.shape[0]):
            evidence.counts[i, a, level[i]] += sign
