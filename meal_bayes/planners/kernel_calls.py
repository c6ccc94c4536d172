"""Python's calls of the kernel that values open-loop plans and searches trees."""

import contextlib
import threading
from collections.abc import Iterator

import numpy as np

from meal_bayes.arrays import Floats
from meal_bayes.momdp import Belief
from meal_bayes.planners.factored.grid import Reader
from meal_bayes.planners.momdp_arrays import MOMDPArrays
from meal_bayes.planners.open_loop.values import (
    Beliefs,
    BestPlans,
    Evaluator,
    Plans,
    make_evaluator,
)
from meal_bayes.planners.pomcp.search import Growing, TreeSearch, value_and_search
from meal_bayes.planners.pomcp.tree import EDGE, NODE, Sampled, Tree


class _KernelGenerator(threading.local):
    """One generator a thread for the kernels: numba keeps every one that it was ever given."""

    def __init__(self) -> None:
        self.generator = np.random.Generator(np.random.PCG64(0))


_KERNEL = _KernelGenerator()
_NO_BELIEFS = Beliefs(
    x=0,
    prob=np.empty((0, 0, 0)),
    drop_useless=False,
    best=BestPlans(value=np.empty((0, 0)), plan=np.empty((0, 0), np.int64)),
)
_NO_SEARCH = TreeSearch(
    tree=Tree(
        size=np.ones(1, np.int64),
        node=np.empty(0, NODE),
        edge=np.empty((0, 0), EDGE),
        prob=np.empty((0, 0, 0)),
        level=np.empty((0, 0), np.int64),
    ),
    sampled=Sampled(
        prob=np.empty((0, 0)),
        counts=np.empty((0, 0, 0)),
        latent=np.empty(0, np.int64),
        truth=np.empty(0),
        drawn=np.empty(0, np.bool_),
        rows=np.empty((0, 0, 0)),
        recent=np.empty((0, 0, 0, 0)),
        path=np.empty((0, 2), np.int64),
        reward=np.empty(0),
        bonus=np.empty(0),
    ),
    growing=Growing(simulations=0, exploration=0.0, averaged=False),
)


@contextlib.contextmanager
def kernel_generator(rng: np.random.Generator) -> Iterator[np.random.Generator]:
    """Return a generator for the kernels that goes on where `rng` is, and `rng` where it ended."""
    if not isinstance(rng.bit_generator, np.random.PCG64):
        yield rng
        return
    generator = _KERNEL.generator
    generator.bit_generator.state = rng.bit_generator.state
    yield generator
    rng.bit_generator.state = generator.bit_generator.state


def grow_tree(
    evaluator: Evaluator, search: TreeSearch, reader: Reader | None, rng: np.random.Generator
) -> int:
    """Grow a tree by simulations; leaves are valued by plans, or by a table where one is read.

    Returns how many simulations fit the tree's capacity.
    """
    return int(value_and_search(evaluator, _NO_BELIEFS, search, reader, rng))


def best_plans(
    evaluator: Evaluator, x: int, beliefs: Floats, *, drop_useless: bool = False
) -> BestPlans:
    """Value the best plan of each first behavior from x at beliefs (B,N,C).

    See `evaluate_plans`; the evaluator holds the values at the last belief.
    """
    shape = len(beliefs), len(evaluator.scratch.value)
    best = BestPlans(value=np.empty(shape), plan=np.empty(shape, np.int64))
    at_beliefs = Beliefs(x, beliefs, drop_useless, best)
    value_and_search(evaluator, at_beliefs, _NO_SEARCH, None, _KERNEL.generator)  # nothing is drawn
    return best


def plan_values(model: MOMDPArrays, plans: Plans, belief: Belief) -> Evaluator:
    """Value the best plan of each first behavior -> `scratch.value` (E,) of the evaluator."""
    evaluator = make_evaluator(model, plans)
    evidence = evaluator.scratch.evidence
    evidence.counts[:] = belief.percept_counts
    evidence.total[:] = belief.shown
    best_plans(evaluator, belief.x, np.exp(belief.log_prob)[None], drop_useless=True)
    return evaluator
