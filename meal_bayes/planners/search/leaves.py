"""Values of new tree nodes and of their behaviors, from plans or from a table.

Open-loop plans give a lower bound for any MOMDP. If the marginal probabilities are a sufficient
state (Eq. 8) and there are few attributes, a table of factored value iteration estimates the
optimal value. `reader` reads the table; it is None if plans are used. numba compiles the search
separately for each of the two cases.
"""

import numpy as np

from meal_bayes.planners.jit import NO_BEHAVIOR, called_kernel
from meal_bayes.planners.plans.values import evaluate_plans, is_useless, true_chance
from meal_bayes.planners.table.grid import value_after


@called_kernel
def value_leaf(evaluator, reader, tree, child):
    """Write the value of a new node: the best of answering and of the plans' or table's value.

    The errors in `scratch` are shared with the siblings of the node; `_value_children` clears them.
    """
    model = evaluator.model
    scratch = evaluator.scratch
    leaf = tree.node[child]
    prob = tree.prob[child]
    if reader is None:
        # Siblings with the same level of an attribute share its belief and its errors.
        for i in range(prob.shape[0]):
            scratch.column[i] = tree.level[child, i] + 1
        leaf.value = evaluate_plans(evaluator, leaf.x, prob, leaf.stop, np.bool_(False))
        if model.shaped and leaf.value > leaf.stop:
            for b in range(scratch.value.shape[0]):
                if scratch.value[b] == leaf.value:
                    leaf.bonus = scratch.bonus[b]
    else:
        for i in range(prob.shape[0]):
            scratch.chance[i] = true_chance(model.percepts, prob, i)
        leaf.value = max(leaf.stop, value_after(reader, leaf.x, NO_BEHAVIOR, scratch.chance))


@called_kernel
def value_behaviors(evaluator, reader, x, prob):
    """Write the values of the behaviors from x into `scratch.value` (E,); -inf if useless.

    The exploration bonus in the value is written into `scratch.bonus`; with a table, there is none.
    """
    model = evaluator.model
    scratch = evaluator.scratch
    if reader is None:
        evaluate_plans(evaluator, x, prob, -np.inf, np.bool_(True))
    else:
        total = scratch.evidence.total
        for i in range(prob.shape[0]):
            scratch.chance[i] = true_chance(model.percepts, prob, i)
        for a in range(scratch.value.shape[0]):
            step = model.dynamics.step[x, a]
            scratch.value[a] = -np.inf
            scratch.bonus[a] = 0.0
            if not step.legal or is_useless(model, x, a, total):
                continue
            # Bellman, one step ahead of the table: Q(x, b, a) = R + g sum_k p_k E V(x_k, b').
            mean = 0.0
            for k in range(model.dynamics.branch.shape[2]):
                branch = model.dynamics.branch[x, a, k]
                behavior = a if branch.senses else NO_BEHAVIOR
                mean += branch.p * value_after(reader, branch.x, behavior, scratch.chance)
            scratch.value[a] = -step.cost + step.discount * mean
