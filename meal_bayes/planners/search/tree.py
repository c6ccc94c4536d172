"""The tree of a search, and the sampled MOMDPs of its simulations.

The tree is a struct of arrays, which kernels extend and from which a decision is read. Each sampled
MOMDP has its own object: a latent class and a truth for each attribute, drawn from the belief, and
a confusion row for each behavior, drawn from its Dirichlet distribution given the percepts of this
trial when the behavior is first executed [Katt2017, Guez2012]. The percepts of the simulation are
drawn from these rows.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import MOMDP, Belief, answer_value
from meal_bayes.planners.jit import Index, by_reference, called_kernel, kernel
from meal_bayes.planners.momdp_arrays import Percepts
from meal_bayes.planners.plans.bayes_error import predictive
from meal_bayes.planners.solver import TreeEdge

KEPT = 8  # number of sampled MOMDPs whose rows a decision contains
DEPTH = 60  # largest number of steps of a simulation
_LOGGED = 40  # number of edges of the second level that a decision contains

NODE = np.dtype([
    ("x", np.int64),
    ("branch", np.int64),  # outcome of the behavior that led here
    ("visits", np.int64),
    ("p", np.float64),  # Pr(this node | parent, behavior)
    ("stop", np.float64),  # value of the best report or exit, exact
    ("value", np.float64),  # best of report, exit and edges
    ("bonus", np.float64),  # the exploration bonus in it
], align=True)  # fmt: skip
EDGE = np.dtype([
    ("visits", np.int64),
    ("first", np.int64),  # first child, -1 before any
    ("count", np.int64),  # number of children, which are consecutive
    ("reward", np.float64),  # of the step: its bonus minus its cost
    ("step_bonus", np.float64),  # the bonus in it
    ("value", np.float64),
    ("bonus", np.float64),  # the exploration bonus in it
], align=True)  # fmt: skip


@by_reference
class Tree(NamedTuple):
    """Nodes in the order of their creation; the first is the root."""

    size: Ints  # (1,) nodes in use
    node: NDArray[np.void]  # (S,) records of `NODE`
    edge: NDArray[np.void]  # (S,E) records of `EDGE`
    prob: Floats  # (S,N,C) Pr(latent class)
    level: Ints  # (S,N) percept that led here, -1 for none


class Percept(NamedTuple):
    """A level of one attribute's percept."""

    attribute: Index
    behavior: Index
    level: Index


def make_tree(momdp: MOMDP, belief: Belief, capacity: int) -> Tree:
    """Create a tree with a root, with memory for `capacity` nodes."""
    tree = Tree(
        size=np.ones(1, np.int64),
        # Not initialized, because this would take half a millisecond; nodes are written when made.
        node=np.empty((capacity,), NODE),
        edge=np.empty((capacity, momdp.n_behaviors), EDGE),
        prob=np.empty((capacity, *belief.log_prob.shape)),
        level=np.empty((capacity, len(belief.log_prob)), np.int64),
    )
    stop = answer_value(momdp, belief)
    tree.prob[0] = np.exp(belief.log_prob)
    tree.level[0] = -1
    tree.edge[0] = 0
    tree.node[0] = (belief.x, 0, 0, 1.0, stop, stop, 0.0)
    return tree


def standard_errors(tree: Tree) -> Floats:
    """Compute the standard errors (E,) of averages of the sampled returns at the root.

    The error of a behavior with which no simulation began is 0.
    """
    errors = np.zeros(tree.edge.shape[1])
    for a in np.flatnonzero(tree.edge["first"][0] >= 0):
        edge = tree.edge[0, a]
        children = tree.node[edge["first"] : edge["first"] + edge["count"]]
        p = children["p"]
        value = children["value"]
        # Var over children of V(child), which an average of n returns would have over n.
        variance = (p * (value - (p * value).sum()) ** 2).sum()
        errors[a] = np.sqrt(variance / max(edge["visits"], 1))
    return errors


def top_edges(tree: Tree) -> tuple[TreeEdge, ...]:
    """Return the edges of the first level of the tree, and the most visited of the second."""
    root = tree.edge[0]
    actions = np.flatnonzero(root["visits"]).tolist()
    first = [
        TreeEdge(
            level=1,
            parent=-1,
            action=a,
            observation=(),
            visits=int(root["visits"][a]),
            value=float(root["value"][a] - root["bonus"][a]),
            bonus=float(root["bonus"][a]),
        )
        for a in actions
    ]
    second: list[TreeEdge] = []
    for parent, a in enumerate(actions):
        children = slice(root["first"][a], root["first"][a] + root["count"][a])
        opened = np.flatnonzero(tree.node["visits"][children])  # others have no edges yet
        for child in (children.start + opened).tolist():
            observation = tuple(z for z in tree.level[child].tolist() if z >= 0)
            edge = tree.edge[child]
            second.extend(
                TreeEdge(
                    level=2,
                    parent=parent,
                    action=b,
                    observation=observation,
                    visits=int(edge["visits"][b]),
                    value=float(edge["value"][b] - edge["bonus"][b]),
                    bonus=float(edge["bonus"][b]),
                )
                for b in np.flatnonzero(edge["visits"]).tolist()
            )
    second.sort(key=lambda edge: -edge.visits)
    return (*first, *second[:_LOGGED])


@by_reference
class Sampled(NamedTuple):
    """The MOMDP of one simulation."""

    prob: Floats  # (N,C) Pr(latent class) at the root
    counts: Floats  # (N,E,K) percepts of the trial at the root, by level
    latent: Ints  # (N,) the object's latent classes
    truth: Floats  # (N,) the object's attributes, 0 or 1
    drawn: NDArray[np.bool_]  # (E,) are the rows of a behavior drawn yet?
    rows: Floats  # (E,N,K) Pr(level)
    recent: Floats  # (E,KEPT,N,K) rows of the last simulations that began with a behavior
    path: Ints  # (DEPTH,2) nodes and behaviors of the simulation
    reward: Floats  # (DEPTH,) rewards of its steps
    bonus: Floats  # (DEPTH,) the exploration bonuses in them


def make_sampled(percepts: Percepts, prob: Floats, counts: Floats) -> Sampled:
    """Create the buffers of sampled MOMDPs, from a belief (N,C) and percept counts (N,E,K)."""
    n, e, _, k = percepts.rows.shape
    return Sampled(
        prob=prob,
        counts=counts,
        latent=np.zeros(n, np.int64),
        truth=np.zeros(n),
        drawn=np.zeros(e, np.bool_),
        rows=np.zeros((e, n, k)),
        recent=np.zeros((e, KEPT, n, k)),
        path=np.zeros((DEPTH, 2), np.int64),
        reward=np.zeros(DEPTH),
        bonus=np.zeros(DEPTH),
    )


@called_kernel
def draw_root_object(percepts, sampled, rng):
    """Draw the object of a simulation at the root: a latent class and a truth for each attribute.

    Rows of the confusion matrices are drawn later, when they are first needed.
    """
    sampled.drawn[:] = False
    for i in range(sampled.prob.shape[0]):
        # The class by inversion: the first whose cumulative probability exceeds u.
        u = rng.random()
        c = 0
        while c < sampled.prob.shape[1] - 1 and u >= sampled.prob[i, c]:
            u -= sampled.prob[i, c]
            c += 1
        sampled.latent[i] = c
        # Given the class, the truth does not depend on the percepts.
        sampled.truth[i] = 1.0 if rng.random() < percepts.truth_of_class[i, 1, c] else 0.0


@called_kernel
def _draw_rows(percepts, sampled, e, rng):
    """Draw the object's rows of a behavior from Dirichlet(precision * mean + counts)."""
    levels = percepts.rows.shape[3]
    for i in range(sampled.latent.shape[0]):
        c = sampled.latent[i]
        s = percepts.precision[i, e, c]
        for z in range(levels):
            sampled.rows[e, i, z] = percepts.rows[i, e, c, z]
        # Rows that are known exactly (Eq. 8) are the mean.
        if np.isinf(s):
            continue
        # Gamma variates with the Dirichlet's parameters as shapes, over their sum.
        total = 0.0
        for z in range(levels):
            alpha = s * percepts.rows[i, e, c, z] + sampled.counts[i, e, z]
            sampled.rows[e, i, z] = rng.standard_gamma(alpha) + 1e-300
            total += sampled.rows[e, i, z]
        for z in range(levels):
            sampled.rows[e, i, z] /= total


@kernel
def draw_percept(percepts, sampled, e, level, rng):
    """Draw a percept of a behavior in the sampled MOMDP, and write it into `level` (N,)."""
    levels = percepts.rows.shape[3]
    if not sampled.drawn[e]:
        sampled.drawn[e] = True
        _draw_rows(percepts, sampled, e, rng)
    for i in range(level.shape[0]):
        # The level by inversion, in the object's own row.
        u = rng.random()
        z = 0
        while z < levels - 1 and u >= sampled.rows[e, i, z]:
            u -= sampled.rows[e, i, z]
            z += 1
        level[i] = z


@kernel
def condition(percepts, evidence, percept, prob, out):
    """Write the belief about one attribute after a percept into `out` (N,C); return Pr(level)."""
    i, e, z = percept
    # Pr(c | z) ~ Pr(c) (s c_z + n_z) / (s + n)
    count = evidence.counts[i, e, z]
    total = 0.0
    for other in range(evidence.counts.shape[2]):
        total += evidence.counts[i, e, other]
    prob_level = 0.0
    for c in range(prob.shape[1]):
        mean = percepts.rows[i, e, c, z]
        s = percepts.precision[i, e, c]
        out[i, c] = prob[i, c] * predictive(mean, s, count, total)
        prob_level += out[i, c]
    if prob_level > 0.0:
        for c in range(prob.shape[1]):
            out[i, c] /= prob_level
    return prob_level
