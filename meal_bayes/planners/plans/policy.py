"""Open-loop feedback control [Bertsekas2005]: follow the best plan, and replan after each step."""

from dataclasses import dataclass, replace

import numpy as np

from meal_bayes.arrays import Floats, Ints, plain_fields
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, answer_value
from meal_bayes.momdp.belief import percepts_left
from meal_bayes.planners.momdp_arrays import MOMDPArrays, arrays_of, paid_share
from meal_bayes.planners.plans.coupled import PERCEPTS, SAMPLES, CoupledPlans
from meal_bayes.planners.plans.library import plan_library
from meal_bayes.planners.plans.values import Plans, plan_values
from meal_bayes.planners.solver import Decision, History, choose


@dataclass(frozen=True, slots=True)
class OpenLoop:
    """Planner that follows the best open-loop plan and plans again after each step.

    The value of a plan is computed as if percepts could not change it. Planning again after a
    percept can only improve the policy, so the value of the best plan is a lower bound on the
    optimal value. After an outcome that is not the most probable one, a plan returns to the earlier
    state and tries the behavior again (see `paths`). The planner works for any MOMDP and takes
    microseconds for a decision. If attributes are dependent (such as values of a group), it
    computes the values of plans from all possible percepts, or from samples of them; this takes
    milliseconds.

    Attributes
    ----------
    samples : int
        Number of sampled objects and percepts for plans about dependent attributes; at least 2.
    """

    samples: int = SAMPLES

    def __post_init__(self) -> None:
        plain_fields(self)
        if self.samples < 2:
            raise SettingsError(
                f"OpenLoop: samples is {self.samples}; give two or more, because values are means."
            )

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "OpenLoopPolicy":
        """Build the library of plans, which is deterministic, and return the policy."""
        model = arrays_of(momdp)
        return OpenLoopPolicy(momdp, model, plan_library(momdp, model), self.samples)


@dataclass(frozen=True, slots=True)
class OpenLoopPolicy:
    """Policy of `OpenLoop`."""

    momdp: MOMDP
    model: MOMDPArrays
    plans: Plans
    samples: int = SAMPLES
    deterministic: bool = True

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the first behavior of the best plan."""
        belief = history.belief
        scratch = plan_values(self.model, self.plans, belief).scratch
        values = scratch.value
        if not self.momdp.coupled:
            return Decision.exact(*choose(self.momdp, belief, values, scratch.bonus))
        coupled, bonus, error = self._coupled_values(belief, rng)
        values = np.where(np.isneginf(values), values, coupled)
        decision = Decision.exact(*choose(self.momdp, belief, values, bonus))
        return replace(decision, value_se=decision.value_se + np.append(error, 0.0))

    def _coupled_values(
        self, belief: Belief, rng: np.random.Generator
    ) -> tuple[Floats, Floats, Floats]:
        """Estimate the value (E,) of the best plan of each first behavior, its bonus and its error.

        The value is -inf if there is no plan. The error (E,) is the standard error of the mean over
        sampled outcomes, and 0 if all outcomes are enumerated.
        """
        momdp = self.momdp
        from_x = slice(*self.plans.first[belief.x : belief.x + 2])
        plan = self.plans.plan[from_x]
        planned = self.plans.observation_counts[from_x]
        most = np.minimum(np.maximum(percepts_left(momdp, belief), 0), PERCEPTS)
        coming = np.minimum(planned, most).astype(int)
        # Plans with equal percepts have the same value at their end.
        counts, row = np.unique(coming, axis=0, return_inverse=True)
        row = row.ravel()
        # lost S - cost, where S is the value of answering now
        fixed = plan["lost"] * answer_value(momdp, belief) - plan["cost"]
        pay = np.zeros(len(plan))
        if self.model.shaped:
            fraction = paid_share(self.model.bonus_limit, belief.shown, planned)
            expected_percepts = self.plans.expected_percepts[from_x]
            pay = (expected_percepts * fraction * (coming > 0)) @ _mean_bonus(self.model, belief)
        ends = CoupledPlans(momdp, belief, counts, rng, self.samples)
        endings = ends.endings()
        value = fixed + pay + plan["discount"] * endings.value[row]
        best = _best_by_first(value, plan["action"], momdp.n_behaviors)
        has_plan = best >= 0
        chosen = best[has_plan]
        endings = ends.fresh(endings, np.unique(row[chosen]))
        values = np.full(momdp.n_behaviors, -np.inf)
        bonus = np.zeros(momdp.n_behaviors)
        error = np.zeros(momdp.n_behaviors)
        discount = plan["discount"][chosen]
        bonus[has_plan] = pay[chosen]
        values[has_plan] = (fixed + pay)[chosen] + discount * endings.value[row[chosen]]
        error[has_plan] = discount * endings.error[row[chosen]]
        return values, bonus, error


def _mean_bonus(model: MOMDPArrays, belief: Belief) -> Floats:
    """Compute the expected bonus of a percept of each behavior under the belief, (E,)."""
    truth = np.stack([1 - belief.positive, belief.positive], axis=1)  # (N,2)
    return np.asarray((model.bonus * truth[:, None]).sum(axis=(0, 2)))


def _best_by_first(value: Floats, action: Ints, n_behaviors: int) -> Ints:
    """Return the best plan of each first behavior, (E,); -1 if there is none."""
    best = np.full(n_behaviors, -1)
    ascending = np.argsort(value, kind="stable")
    best[action[ascending]] = ascending  # the last one written is the best
    return best
