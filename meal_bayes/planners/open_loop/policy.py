"""Open-loop feedback control: follow the best plan, look again after every step [Bertsekas2005]."""

from dataclasses import dataclass

import numpy as np

from meal_bayes.momdp import MOMDP
from meal_bayes.planners.compiled import Compiled, compile_momdp
from meal_bayes.planners.open_loop.coupled import coupled_values
from meal_bayes.planners.open_loop.library import plan_library
from meal_bayes.planners.open_loop.values import Plans, plan_values
from meal_bayes.planners.solver import Decision, History, choose


@dataclass(frozen=True, slots=True)
class OpenLoop:
    """Values every plan of a library as if no percept could change it, exactly.

    A percept can only help, and what is left of a plan is a plan of the library: the policy is
    worth at least the best plan, whose value is therefore a lower bound on the optimum. It takes
    any MOMDP, and microseconds a decision. Where attributes are the values of a group their errors
    are no product: then plans are valued by sampled percepts (`coupled.py`), in milliseconds.
    """

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "OpenLoopPolicy":
        """Build the plan library; nothing in it is random."""
        problem = compile_momdp(momdp)
        return OpenLoopPolicy(momdp, problem, plan_library(momdp, problem))


@dataclass(frozen=True, slots=True)
class OpenLoopPolicy:
    """Policy of `OpenLoop`."""

    momdp: MOMDP
    problem: Compiled
    plans: Plans
    deterministic: bool = True

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the first behavior of the best plan."""
        belief = history.belief
        values = plan_values(self.problem, self.plans, belief).value
        if self.momdp.query.groups:
            coupled = coupled_values(self.momdp, self.problem, self.plans, belief, rng)
            values = np.where(np.isneginf(values), values, coupled)
        return Decision.exact(*choose(self.momdp, belief, values))
