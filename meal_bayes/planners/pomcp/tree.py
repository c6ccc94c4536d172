"""The search tree: a struct of arrays that the kernels grow, and what is read off it afterwards."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.kernels import records
from meal_bayes.planners.solver import TreeEdge

_LOGGED = 40  # edges of the second level that a decision keeps

NODE = np.dtype([
    ("x", np.int64),
    ("branch", np.int64),  # outcome of the behavior that led here
    ("visits", np.int64),
    ("p", np.float64),  # Pr(this node | parent, behavior)
    ("stop", np.float64),  # value of the best report or exit, exact
    ("value", np.float64),  # best of report, exit and edges
], align=True)  # fmt: skip
EDGE = np.dtype([
    ("visits", np.int64),
    ("first", np.int64),  # first child, -1 before any
    ("count", np.int64),  # children, which stand in a row
    ("reward", np.float64),  # cost and bonus
    ("value", np.float64),
], align=True)  # fmt: skip


class Tree(NamedTuple):
    """Nodes in the order in which they were made; the first is the root.

    Attributes
    ----------
    size : (1,) nodes in use.
    node : (S,) records of `NODE`.
    edge : (S,E) records of `EDGE`.
    prob : (S,N,C) Pr(latent class).
    level : (S,N) percept that led here, -1 for none.
    """

    size: NDArray[np.int64]
    node: NDArray[np.void]
    edge: NDArray[np.void]
    prob: NDArray[np.float64]
    level: NDArray[np.int64]


def make_tree(capacity: int, n_behaviors: int, n_attributes: int, n_classes: int) -> Tree:
    """Create an empty tree for so many nodes."""
    return Tree(
        size=np.zeros(1, np.int64),
        node=records((capacity,), NODE),
        edge=records((capacity, n_behaviors), EDGE),
        prob=np.empty((capacity, n_attributes, n_classes)),
        level=np.empty((capacity, n_attributes), np.int64),
    )


def standard_errors(tree: Tree) -> NDArray[np.float64]:
    """Compute the standard errors (E,) that averages of the root's sampled returns would have."""
    errors = np.zeros(tree.edge.shape[1])
    for a in np.flatnonzero(tree.edge["first"][0] >= 0):
        edge = tree.edge[0, a]
        children = tree.node[edge["first"] : edge["first"] + edge["count"]]
        p, value = children["p"], children["value"]
        variance = (p * (value - (p * value).sum()) ** 2).sum()
        errors[a] = np.sqrt(variance / max(edge["visits"], 1))
    return errors


def top_edges(tree: Tree) -> tuple[TreeEdge, ...]:
    """Return the first two levels of the tree, of the second the most visited edges."""
    visits, first, count, _, values = (tree.edge[name][0].tolist() for name in EDGE.names or ())
    taken = [a for a, n in enumerate(visits) if n]
    edges = [TreeEdge(1, -1, a, (), visits[a], values[a]) for a in taken]
    rows = [np.arange(first[a], first[a] + count[a]) for a in taken]
    children = np.concatenate([np.zeros(0, np.int64), *rows])
    parent = np.repeat(np.arange(len(taken)), [len(row) for row in rows])
    opened = tree.node["visits"][children] > 0  # else without edges
    children, parent = children[opened], parent[opened]
    often = tree.edge["visits"][children]
    child, b = np.nonzero(often)
    most = np.argsort(-often[child, b], kind="stable")[:_LOGGED]
    child, b = child[most], b[most]
    observations = [tuple(z for z in row if z >= 0) for row in tree.level[children[child]].tolist()]
    value = tree.edge["value"][children[child], b]
    columns = (
        parent[child].tolist(),
        b.tolist(),
        observations,
        often[child, b].tolist(),
        value.tolist(),
    )
    return (*edges, *(TreeEdge(2, *edge) for edge in zip(*columns, strict=True)))
