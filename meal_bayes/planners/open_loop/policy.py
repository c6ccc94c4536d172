"""Open-loop feedback control: follow the best plan, look again after every step [Bertsekas2005].

The kernels multiply the errors of attributes, which are independent; values of a group are not. So
there a plan's gain is averaged over percepts of objects drawn from the belief: a report after the
plan is right with the largest posterior Pr(y), which every sample has exactly. The gain over
reporting now is sampled as max_y b'(y) - b'(best report now), whose second part is b(best) on
average: a plan that changes no report gains nothing, without noise.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.momdp.belief import log_odds
from meal_bayes.momdp.observation import predictive, sample_rows
from meal_bayes.planners.compiled import Compiled, compile_momdp
from meal_bayes.planners.open_loop.library import plan_library
from meal_bayes.planners.open_loop.values import Plans, plan_values
from meal_bayes.planners.solver import Decision, History, choose

_SAMPLES = 192
_PERCEPTS = 6  # of one behavior that a plan looks ahead to


@dataclass(frozen=True, slots=True)
class OpenLoop:
    """Values every plan of a library as if no percept could change it, exactly.

    A percept can only help, and what is left of a plan is a plan of the library: the policy is
    worth at least the best plan, whose value is therefore a lower bound on the optimum. It takes
    any MOMDP, and microseconds a decision. Where attributes are the values of a group their errors
    are no product: then plans are valued by sampled percepts, in milliseconds.
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
            coupled = _coupled_values(self.momdp, self.problem, self.plans, belief, rng)
            values = np.where(np.isneginf(values), values, coupled)
        return Decision.exact(*choose(self.momdp, belief, values))


def _coupled_values(
    momdp: MOMDP, problem: Compiled, plans: Plans, belief: Belief, rng: np.random.Generator
) -> Floats:
    """Estimate the value of the best plan of each first behavior (E,); -inf where there is none."""
    span = slice(*plans.first[belief.x : belief.x + 2])
    left = np.maximum(momdp.limit - belief.percept_counts[0].sum(axis=1), 0)
    used = np.minimum(plans.observation_counts[span], np.minimum(left, _PERCEPTS)).astype(int)
    counts, row = np.unique(used, axis=0, return_inverse=True)
    right = _right(momdp, belief, counts, rng)[row.ravel()]
    plan = plans.plan[span]
    value = plan["discount"] * (momdp.incorrect + problem.gap * right) - plan["cost"]
    if problem.shaped:
        truth = np.stack([1 - belief.positive, belief.positive], axis=1)  # (N,2)
        bonus = (problem.bonus * truth[:, None]).sum(axis=(0, 2))  # (E,)
        paid = np.maximum(problem.paid - belief.percept_counts[0].sum(axis=1), 0.0)
        fraction = np.minimum(1.0, paid / np.maximum(plans.observation_counts[span], 1))
        value += (plans.executions[span] * fraction * (used > 0)) @ bonus
    best = np.full(momdp.n_behaviors, -np.inf)
    np.maximum.at(best, plan["action"], value)
    return best


def _right(momdp: MOMDP, belief: Belief, counts: Ints, rng: np.random.Generator) -> Floats:
    """Estimate Pr(the best report is right) after so many percepts of each behavior (J,E)."""
    evidence = _sampled_evidence(momdp, belief, int(counts.max(initial=0)), rng)
    best = [row.argmax() for row in belief.marginals]
    right = np.full(len(counts), belief.certainty)
    for j, used in enumerate(counts):
        of = np.flatnonzero(used)
        after = belief.log_prob + evidence[used[of], of].sum(axis=0)  # (S,N,C)
        positive = expit(log_odds(momdp, after))
        likeliest = same = np.ones(_SAMPLES)
        for places, value in zip(momdp.query.variables, best, strict=True):
            row = positive[:, list(places)]
            row = row if len(places) > 1 else np.hstack([1.0 - row, row])
            likeliest, same = likeliest * row.max(axis=1), same * row[:, value]
        right[j] += (likeliest - same).mean()
    return right


def _sampled_evidence(momdp: MOMDP, belief: Belief, most: int, rng: np.random.Generator) -> Floats:
    """Sample objects and percepts -> ln Pr(first u percepts of behavior e | class), (U+1,E,S,N,C).

    Behaviors come before samples, so that a plan picks its own with one index.
    """
    (n, e, k), each = belief.percept_counts.shape, np.arange(len(momdp.query))
    truth = np.zeros((_SAMPLES, n), int)
    for places, prob in zip(momdp.query.variables, belief.marginals, strict=True):
        value = rng.choice(len(prob), _SAMPLES, p=prob / prob.sum())
        truth[:, places] = (value[:, None] == np.arange(len(prob)))[:, -len(places) :]
    of_class = np.exp(belief.log_prob + momdp.log_truth.transpose(1, 0, 2))[truth, each]  # (S,N,C)
    below = of_class.cumsum(axis=2) < rng.random((_SAMPLES, n, 1)) * of_class.sum(axis=2)[..., None]
    latent = below.sum(axis=2)  # (S,N)
    means, precisions = momdp.confusion[each, :, latent], momdp.precision[each, :, latent]
    rows = sample_rows(means, precisions, belief.percept_counts, rng)  # (S,N,E,K)
    counts = np.tile(belief.percept_counts, (_SAMPLES, 1, 1, 1))
    sample, place, behavior = np.ogrid[:_SAMPLES, :n, :e]
    evidence = np.zeros((most + 1, e, _SAMPLES, n, momdp.n_classes))
    for u in range(most):
        z = (rows.cumsum(axis=3) <= rng.random((_SAMPLES, n, e, 1))).sum(axis=3).clip(max=k - 1)
        prob = predictive(
            momdp.confusion[place, behavior, :, z], momdp.precision,
            counts[sample, place, behavior, z, None], counts.sum(axis=3)[..., None],
        )  # fmt: skip
        evidence[u + 1] = evidence[u] + np.log(prob.clip(1e-300)).transpose(2, 0, 1, 3)
        counts[sample, place, behavior, z] += 1
    return evidence
