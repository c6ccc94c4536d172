"""The leaf evaluators of the tree search, in one place.

Open-loop plans give a lower bound for any MOMDP. Where the marginals are the state (Eq. 8) and few
enough, a table of factored value iteration estimates the optimum; on a grid that is too coarse for
sharp beliefs it falls short of the plans, so the greater of the two counts.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.factored.grid import Table, value_after
from meal_bayes.planners.kernels import kernel
from meal_bayes.planners.open_loop.errors import Scratch
from meal_bayes.planners.open_loop.values import (
    Plans,
    evaluate_plans,
    is_idle,
    stop_value,
    true_chance,
)


class LeafEvaluator(NamedTuple):
    """Evaluators of beliefs, and their buffers.

    Attributes
    ----------
    plans : open-loop plans.
    table : estimates over a grid of marginal beliefs, or an empty table.
    scratch, reading : buffers; `scratch` holds the percepts on the way to the node.
    """

    plans: Plans
    table: Table
    scratch: Scratch
    reading: NDArray[np.float64]


@kernel
def add_node(model, evaluator, tree, child, x, a):
    """Add the next free node, valued by ending now, the best plan, or the table."""
    tree.size[0] += 1
    node, prob, table = tree.node[child], tree.prob[child], evaluator.table
    node.x, node.visits = x, 0
    count_percept(evaluator.scratch, tree.level[child], a, 1.0)
    node.stop = stop_value(model, x, prob)
    for i in range(prob.shape[0]):
        evaluator.scratch.shown[i] = tree.level[child, i] + 1
        evaluator.scratch.chance[i] = true_chance(model.percepts, prob, i)
    if table.value.shape[0] > 0:
        estimate = _estimate(model, evaluator, x, -table.size[0])
        node.value = max(node.stop, estimate)
    else:
        node.value = evaluate_plans(
            model, evaluator.plans, x, prob, evaluator.scratch, node.stop, x < 0
        )
    count_percept(evaluator.scratch, tree.level[child], a, -1.0)


@kernel
def open_node(model, evaluator, tree, node):
    """Create the edges of a visited node; values are -inf where a behavior cannot help."""
    x, scratch, table = tree.node[node].x, evaluator.scratch, evaluator.table
    tabled = table.value.shape[0] > 0
    if tabled:
        for i in range(scratch.chance.shape[0]):
            scratch.chance[i] = true_chance(model.percepts, tree.prob[node], i)
    else:
        evaluate_plans(model, evaluator.plans, x, tree.prob[node], scratch, -np.inf, x >= 0)
    for a in range(tree.edge.shape[1]):
        value = -np.inf if tabled else scratch.value[a]
        if tabled and model.dynamics.step[x, a].legal and not is_idle(model, x, a, scratch.total):
            mean = 0.0
            for k in range(model.dynamics.branch.shape[2]):
                branch = model.dynamics.branch[x, a, k]
                behavior = a if branch.senses else -table.size[0]
                mean += branch.p * _estimate(model, evaluator, branch.x, behavior)
            reward = step_reward(model, x, a, scratch.chance, scratch.total)
            value = reward + model.dynamics.step[x, a].discount * mean
        edge = tree.edge[node, a]
        edge.visits, edge.first, edge.count = 0, -1, 0
        edge.value = value
        tree.node[node].value = max(tree.node[node].value, value)


@kernel
def _estimate(model, evaluator, x, behavior):
    """Return the table's value at x after a percept of a behavior (none below 0)."""
    return value_after(
        evaluator.table, model.percepts.rows, model.percepts.informative, x, behavior,
        evaluator.scratch.chance, evaluator.reading,
    )  # fmt: skip


@kernel
def step_reward(model, x, a, chance, total):
    """Compute minus the cost of a behavior, plus its bonus at Pr(attribute is true) (N,)."""
    reward = -model.dynamics.step[x, a].cost
    if model.shaped and total[a] < model.paid[a]:
        for i in range(chance.shape[0]):
            b = chance[i]
            mean = b * model.bonus[i, a, 1] + (1.0 - b) * model.bonus[i, a, 0]
            reward += model.dynamics.step[x, a].bonus_scale * mean
    return reward


@kernel
def count_percept(scratch, level, a, sign):
    """Count a percept (N,) of a behavior (sign 1), or remove it (-1); level -1 is none."""
    if level[0] >= 0:
        scratch.total[a] += sign
        for i in range(level.shape[0]):
            scratch.counts[i, a, level[i]] += sign
