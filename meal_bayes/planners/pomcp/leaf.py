"""What values a new node of the tree: the one place where the leaf evaluators meet.

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
from meal_bayes.planners.open_loop.values import Plans, behavior_values, evaluate_plans, stop_value


class Leaf(NamedTuple):
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
def leaf_value(model, leaf, x, prob):
    """Value of a new node: ending now, the best plan, or what the table says."""
    stop = stop_value(model, x, prob)
    value = evaluate_plans(model, leaf.plans, x, prob, leaf.scratch, stop)
    if leaf.table.value.shape[0] == 0:
        return value
    table, chance, nothing = leaf.table, leaf.scratch.chance, -leaf.table.size[0]
    estimate = value_after(table, model.percepts.rows, x, nothing, chance, leaf.reading)
    return max(value, estimate)


@kernel
def edge_values(model, leaf, x, prob):
    """Value of every behavior of a visited node -> `leaf.scratch.value` (E,), -inf for none."""
    scratch = leaf.scratch
    behavior_values(model, leaf.plans, x, prob, scratch)
    if leaf.table.value.shape[0] == 0:
        return
    for a in range(scratch.value.shape[0]):
        if scratch.value[a] == -np.inf:
            continue
        mean = 0.0
        for k in range(model.dynamics.branch.shape[2]):
            branch = model.dynamics.branch[x, a, k]
            behavior = a if branch.senses else -leaf.table.size[0]
            mean += branch.p * value_after(
                leaf.table, model.percepts.rows, branch.x, behavior, scratch.chance, leaf.reading
            )
        reward = step_reward(model, x, a, scratch.chance, scratch.total)
        scratch.value[a] = max(scratch.value[a], reward + model.dynamics.step[x, a].discount * mean)


@kernel
def step_reward(model, x, a, chance, total):
    """Cost of a behavior, and its bonus where the attributes have chances (N,) to be true."""
    reward = -model.dynamics.step[x, a].cost
    if model.shaped and total[a] < model.paid[a]:
        for i in range(chance.shape[0]):
            b = chance[i]
            mean = b * model.bonus[i, a, 1] + (1.0 - b) * model.bonus[i, a, 0]
            reward += model.dynamics.step[x, a].bonus_scale * mean
    return reward
