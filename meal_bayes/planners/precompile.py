"""Compiling a solver's kernels before they are needed, or loading what an earlier process made."""

from dataclasses import replace

import numpy as np

from meal_bayes.domain import Event, Query, load_domain
from meal_bayes.momdp import build_momdp, initial_belief
from meal_bayes.planners.plans.policy import OpenLoop
from meal_bayes.planners.search.policy import POMCP
from meal_bayes.planners.solver import History, Solver
from meal_bayes.planners.table.policy import Factored


def warm_up(solver: Solver, limit: float = 3, *, yes_or_no: bool = False) -> None:
    """Compile the kernels that a solver needs; a solver without kernels is left alone.

    Parameters
    ----------
    solver : Solver
        Of this package.
    limit : float
        Percepts of a behavior that its trials can have; `POMCP` reads a table where there is none
        and rates are known (Eq. 8), and plans otherwise: two kernels.
    yes_or_no : bool
        Of a question of yes or no, which has kernels of its own.
    """
    if isinstance(solver, POMCP):  # compiling would use up a budget before anything is simulated
        solver = replace(solver, milliseconds=None, simulations=1)
    if isinstance(solver, POMCP | OpenLoop | Factored):
        domain = load_domain("toy")
        query = Query(domain.attributes[:1], event=Event((True,)) if yes_or_no else None)
        rng = np.random.Generator(np.random.PCG64(0))
        rows = np.broadcast_to([[0.6, 0.4], [0.4, 0.6]], (1, len(domain.behaviors), 2, 2))
        momdp = build_momdp(domain, query, rows, limit=limit)
        solver.solve(momdp, rng).decide(History(initial_belief(momdp)), rng)
