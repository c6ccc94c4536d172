"""Compiling a solver's kernels before they are needed, or loading what an earlier process made."""

import numpy as np

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp, initial_belief
from meal_bayes.planners.factored.policy import Factored
from meal_bayes.planners.open_loop.policy import OpenLoop
from meal_bayes.planners.pomcp.policy import POMCP
from meal_bayes.planners.solver import History, Solver


def warm_up(solver: Solver) -> None:
    """Compile the kernels that a solver needs; a solver without kernels is left alone."""
    if isinstance(solver, POMCP | OpenLoop | Factored):
        domain, rng = load_domain("toy"), np.random.Generator(np.random.PCG64(0))
        rows = np.broadcast_to([[0.6, 0.4], [0.4, 0.6]], (1, len(domain.behaviors), 2, 2))
        limit = np.inf if isinstance(solver, Factored) else 3
        momdp = build_momdp(domain, Query(domain.attributes[:1]), rows, limit=limit)
        solver.solve(momdp, rng).decide(History(initial_belief(momdp)), rng)
