"""Open-loop feedback control: follow the best plan, look again after every step [Bertsekas2005]."""

from dataclasses import dataclass

import numpy as np

from meal_bayes.momdp import MOMDP
from meal_bayes.planners.compiled import Compiled, compile_momdp
from meal_bayes.planners.open_loop.library import plans_for
from meal_bayes.planners.open_loop.values import Plans, open_loop_values, remember, room_for
from meal_bayes.planners.solver import Decision, History, choose


@dataclass(frozen=True, slots=True)
class OpenLoop:
    """Values every plan of a library as if no percept could change it, exactly.

    A percept can only help, and what is left of a plan is a plan of the library: the policy is
    worth at least the best plan, whose value is therefore a lower bound on the optimum. It takes
    any MOMDP, and microseconds a decision.
    """

    paid: float = np.inf  # percepts of a behavior in a trial that shaping pays for

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "OpenLoopPolicy":
        """Make the plan library; nothing in it is random."""
        problem = compile_momdp(momdp)
        problem = problem._replace(paid=np.minimum(problem.paid, self.paid))
        return OpenLoopPolicy(momdp, problem, plans_for(problem))


@dataclass(frozen=True, slots=True)
class OpenLoopPolicy:
    """Policy of `OpenLoop`."""

    momdp: MOMDP
    problem: Compiled
    plans: Plans

    def repaid(self, momdp: MOMDP) -> "OpenLoopPolicy":
        """Follow the same plans where exploring pays otherwise, and the prior may be another."""
        problem = self.problem._replace(bonus=momdp.bonus.copy(), shaped=bool(momdp.bonus.any()))
        return OpenLoopPolicy(momdp, problem, self.plans)

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Take the first behavior of the best plan."""
        belief = history.belief
        weight = np.exp(belief.weight)[None]
        work = room_for(self.problem, self.plans)
        remember(work, belief.seen.astype(np.float64))
        values = np.empty((1, self.momdp.n_behaviors))
        open_loop_values(self.problem, self.plans, belief.x, weight, 0, work, values)
        exit_value = float(self.problem.exit_value[belief.x])
        action, every = choose(self.momdp, belief, values[0], exit_value)
        return Decision(action, every, every * 0.0, np.zeros(len(every), np.int64))
