"""Compile the kernels of a solver before they are needed, or load them from the cache."""

from dataclasses import replace

import numpy as np

from meal_bayes.domain import Event, Query, load_domain
from meal_bayes.momdp import build_momdp, initial_belief
from meal_bayes.planners.plans.policy import OpenLoop
from meal_bayes.planners.search.policy import POMCP
from meal_bayes.planners.solver import History, Solver
from meal_bayes.planners.table.policy import Factored


def warm_up(solver: Solver, limit: float = 3, *, yes_or_no: bool = False) -> None:
    """Compile the kernels that a solver needs; do nothing for a solver without kernels.

    Parameters
    ----------
    solver : Solver
        Solver of this package.
    limit : float
        Largest number of percepts of a behavior in a trial. This number selects the kernel of
        `POMCP`, which uses a table if the number is unlimited and rates are known (Eq. 8), and
        open-loop plans otherwise.
    yes_or_no : bool
        Whether to compile the kernels for yes-or-no questions; they differ from those for values.
    """
    if isinstance(solver, POMCP):  # compilation would use up a limit of time
        solver = replace(solver, milliseconds=None, simulations=1)
    if isinstance(solver, POMCP | OpenLoop | Factored):
        domain = load_domain("toy")
        query = Query(domain.attributes[:1], event=Event((True,)) if yes_or_no else None)
        rng = np.random.Generator(np.random.PCG64(0))
        rows = np.broadcast_to([[0.6, 0.4], [0.4, 0.6]], (1, len(domain.behaviors), 2, 2))
        momdp = build_momdp(domain, query, rows, limit=limit)
        solver.solve(momdp, rng).decide(History(initial_belief(momdp)), rng)
