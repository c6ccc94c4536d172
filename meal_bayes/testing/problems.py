"""Decision problems of many kinds, on which solvers are checked."""

from collections.abc import Iterator

import numpy as np

from meal_bayes.arrays import Floats, check_whole
from meal_bayes.domain import Domain, Query, load_domain
from meal_bayes.momdp import MOMDP, Objective, build_momdp, with_joint_prior

_PERCEPTS = 2  # of a behavior: used up soon


def example_problems(seed: int = 0, *, known_rows: bool = False) -> Iterator[MOMDP]:
    """Yield small problems of several kinds, with random confusion matrices.

    The problems have one to three attributes, two or four levels, costs and diagrams of the shipped
    domains, and rewards with or without discount. In some problems percepts run out, priors and
    percepts are certain, or the agent may abstain. Without `known_rows`, some problems also have
    objects with confusion matrices of their own (finite precision), or truths that share latent
    classes.

    Parameters
    ----------
    seed : int
        Seed of the confusion matrices.
    known_rows : bool
        Whether to yield only problems that satisfy the paper's Eq. 8, for solvers that need it.
    """
    check_whole("seed", seed)
    rng = np.random.default_rng(seed)
    toy, roc36, cy101 = (load_domain(name) for name in ("toy", "roc36", "cy101"))
    abstaining = Objective(abstain=True)
    undiscounted = Objective(discount=1.0)
    yield build_momdp(toy, _query(toy, 1), _rows(rng, toy, 1, 2))
    yield build_momdp(toy, _query(toy, 2), _rows(rng, toy, 2, 4), limit=_PERCEPTS)
    yield build_momdp(
        roc36, _query(roc36, 3), _rows(rng, roc36, 3, 2), limit=_PERCEPTS, objective=abstaining
    )
    yield build_momdp(cy101, _query(cy101, 1), _rows(rng, cy101, 1, 2), prior=0.1)
    yield build_momdp(toy, _query(toy, 2), _rows(rng, toy, 2, 2), limit=0, objective=undiscounted)
    deciding = np.tile(np.eye(2), (2, len(toy.behaviors), 1, 1))
    yield build_momdp(toy, _query(toy, 2), deciding, prior=[0.5, 1.0], objective=abstaining)
    if known_rows:
        return
    yield build_momdp(roc36, _query(roc36, 2), _rows(rng, roc36, 2, 4), 4.0, limit=_PERCEPTS)
    classes = rng.dirichlet(np.ones(3), (2, 2))
    shared = rng.dirichlet(np.ones(4), (2, len(toy.behaviors), 3))
    yield build_momdp(toy, _query(toy, 2), shared, 2.0, latent_classes=classes)
    exclusive = [0.3, 0.4, 0.3, 0.0]
    yield with_joint_prior(build_momdp(toy, _query(toy, 2), shared[:, :, :2], 2.0), exclusive)


def _query(domain: Domain, n: int) -> Query:
    return Query(domain.attributes[:n])


def _rows(rng: np.random.Generator, domain: Domain, n: int, levels: int) -> Floats:
    """Draw confusion matrices (n,E,2,levels)."""
    return rng.dirichlet(np.ones(levels), (n, len(domain.behaviors), 2))
