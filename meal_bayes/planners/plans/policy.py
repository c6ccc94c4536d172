"""Open-loop feedback control: follow the best plan, look again after every step [Bertsekas2005].

The kernels multiply the errors of attributes, which are independent; values of a group are not, nor
attributes with a joint prior. So there a plan's gain is averaged over percepts of objects drawn
from the belief: a report after the plan is right with the largest posterior Pr(y), which every
sample has exactly. The gain over reporting now is sampled as max_y b'(y) - b'(best report now),
whose second part is b(best) on average: a plan that changes no report gains nothing, without noise.
"""

from dataclasses import dataclass, replace

import numpy as np

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.momdp.belief import percepts_left, truths_of
from meal_bayes.momdp.observation import predictive, sample_rows
from meal_bayes.planners.momdp_arrays import MOMDPArrays, arrays_of, paid_share
from meal_bayes.planners.plans.library import plan_library
from meal_bayes.planners.plans.values import Plans, plan_values
from meal_bayes.planners.solver import Decision, History, choose

_SAMPLES = 192
_PERCEPTS = 6  # of one behavior that a plan looks ahead to


@dataclass(frozen=True, slots=True)
class OpenLoop:
    """Values every plan of a library as if no percept could change it.

    A percept can only help, and what is left of a plan is a plan of the library: the policy is
    worth at least the best plan, whose value is therefore a lower bound on the optimum. After an
    outcome that is not the likeliest a plan goes back and tries again (see `paths`), or the
    policy does better. It takes any MOMDP, and microseconds a decision. Where attributes are
    coupled, as the values of a group are, their errors are no product: then plans are valued by
    sampled percepts, in milliseconds.
    """

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "OpenLoopPolicy":
        """Build the plan library; nothing in it is random."""
        model = arrays_of(momdp)
        return OpenLoopPolicy(momdp, model, plan_library(momdp, model))


@dataclass(frozen=True, slots=True)
class OpenLoopPolicy:
    """Policy of `OpenLoop`."""

    momdp: MOMDP
    model: MOMDPArrays
    plans: Plans
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

        The value is -inf where there is no plan. The error (E,) is the standard error of the mean
        over the sampled objects and percepts.
        """
        from_x = slice(*self.plans.first[belief.x : belief.x + 2])
        plan = self.plans.plan[from_x]
        planned = self.plans.observation_counts[from_x]
        total = belief.shown
        most = np.minimum(np.maximum(percepts_left(self.momdp, belief), 0), _PERCEPTS)
        coming = np.minimum(planned, most).astype(int)
        ending, error = _ending_of_plans(self.momdp, belief, coming, rng)
        value = plan["discount"] * ending - plan["cost"]
        if plan["lost"].any():
            value += plan["lost"] * _lost_ending(self.momdp, belief, rng)
        pay = np.zeros(len(plan))
        if self.model.shaped:
            fraction = paid_share(self.model.bonus_limit, total, planned)
            expected_percepts = self.plans.expected_percepts[from_x]
            pay = (expected_percepts * fraction * (coming > 0)) @ _mean_bonus(self.model, belief)
            value += pay
        error = plan["discount"] * error
        return _best_by_first(value, pay, error, plan["action"], self.momdp.n_behaviors)


def _mean_bonus(model: MOMDPArrays, belief: Belief) -> Floats:
    """Compute what a percept of each behavior is paid, over the truths that are believed, (E,)."""
    truth = np.stack([1 - belief.positive, belief.positive], axis=1)  # (N,2)
    return np.asarray((model.bonus * truth[:, None]).sum(axis=(0, 2)))


def _best_by_first(
    value: Floats, pay: Floats, error: Floats, action: Ints, n_behaviors: int
) -> tuple[Floats, Floats, Floats]:
    """Return value, pay and error (E,) of the best plan of each first behavior."""
    best = np.full(n_behaviors, -np.inf)
    np.maximum.at(best, action, value)
    pay_of_best = np.zeros(n_behaviors)
    is_best = value == best[action]
    pay_of_best[action[is_best]] = pay[is_best]
    error_of_best = np.zeros(n_behaviors)
    error_of_best[action[is_best]] = error[is_best]
    return best, pay_of_best, error_of_best


def _ending_of_plans(
    momdp: MOMDP, belief: Belief, coming: Ints, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Estimate the value of the best report where plans (J,) end, and its standard error (J,).

    They end after so many percepts of each behavior (J,E). Those with equal percepts are valued
    once.
    """
    counts, row = np.unique(coming, axis=0, return_inverse=True)
    value, error = _ending(momdp, belief, counts, rng)
    return value[row.ravel()], error[row.ravel()]


def _lost_ending(momdp: MOMDP, belief: Belief, rng: np.random.Generator) -> Floats:
    """Value an answer at once, without a percept."""
    no_percepts = np.zeros((1, momdp.n_behaviors), int)
    return _ending(momdp, belief, no_percepts, rng)[0]


def _ending(
    momdp: MOMDP, belief: Belief, counts: Ints, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Estimate the value of the best report after so many percepts (J,E), and its error (J,)."""
    reports = momdp.reports
    if reports.event is None:
        right, error = _right(momdp, belief, counts, rng)
        earned = reports.of_right(np.array([[0.0], [1.0]]))  # by a wrong report, and a right one
        return reports.of_right(right[:, None]), float(np.ptp(earned)) * error
    now = reports.answers(reports.probability(belief))  # (2,)
    evidence = _sampled_evidence(momdp, belief, int(counts.max(initial=0)), rng)
    ending: Floats = np.full(len(counts), now.max())
    error = np.zeros(len(counts))
    for j, percepts in enumerate(counts):
        behaviors = np.flatnonzero(percepts)
        after = belief.log_prob + evidence[percepts[behaviors], behaviors].sum(axis=0)  # (S,N,C)
        answers = reports.answers(reports.probability(truths_of(momdp, after)))
        gain = answers.max(axis=1) - answers[:, now.argmax()]
        ending[j] += gain.mean()
        error[j] = gain.std(ddof=1) / np.sqrt(_SAMPLES)
    return ending, error


def _right(
    momdp: MOMDP, belief: Belief, counts: Ints, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Estimate Pr(the best report is right) after so many percepts (J,E), and its error (J,)."""
    evidence = _sampled_evidence(momdp, belief, int(counts.max(initial=0)), rng)
    best = [row.argmax() for row in belief.factors]
    right = np.full(len(counts), belief.certainty)
    error = np.zeros(len(counts))
    for j, count in enumerate(counts):
        behavior = np.flatnonzero(count)
        after = belief.log_prob + evidence[count[behavior], behavior].sum(axis=0)  # (S,N,C)
        likeliest = np.ones(_SAMPLES)  # Pr(the report that is best after the percepts)
        unchanged = np.ones(_SAMPLES)  # Pr(the report that is best now)
        factors = truths_of(momdp, after).factors(momdp.query.groups)
        for probability, value in zip(factors, best, strict=True):
            likeliest = likeliest * probability.max(axis=1)
            unchanged = unchanged * probability[:, value]
        gain = likeliest - unchanged
        right[j] += gain.mean()
        error[j] = gain.std(ddof=1) / np.sqrt(_SAMPLES)
    return right, error


def _sampled_truths(momdp: MOMDP, belief: Belief, rng: np.random.Generator) -> Ints:
    """Sample truths (S,N) from the belief."""
    if belief.joint_table is not None:
        # Evenly spaced quantiles: each value vector comes as often as expected, to within one.
        quantiles = (np.arange(_SAMPLES) + rng.random()) / _SAMPLES
        cumulative = belief.joint_table.cumsum()
        number = np.searchsorted(cumulative, quantiles * cumulative[-1], side="right")
        values = momdp.query.values.astype(int)
        return np.asarray(values[number.clip(max=len(cumulative) - 1)])
    truth = np.zeros((_SAMPLES, len(momdp.query)), int)
    for indices, prob in zip(momdp.query.variables, belief.marginals, strict=True):
        value = rng.choice(len(prob), _SAMPLES, p=prob / prob.sum())
        truth[:, indices] = (value[:, None] == np.arange(len(prob)))[:, -len(indices) :]
    return truth


def _sampled_evidence(momdp: MOMDP, belief: Belief, most: int, rng: np.random.Generator) -> Floats:
    """Sample objects and percepts -> ln Pr(first u percepts of behavior e | class), (U+1,E,S,N,C).

    Behaviors come before samples, so that a plan picks its own with one index.
    """
    n, e, k = belief.percept_counts.shape
    attributes = np.arange(n)
    truth = _sampled_truths(momdp, belief, rng)
    # The class: Pr(c | truth, percepts) ~ Pr(c | percepts) Pr(truth | c)
    joint = np.exp(belief.log_prob + momdp.log_truth.transpose(1, 0, 2))[truth, attributes]
    below = joint.cumsum(axis=2) < rng.random((_SAMPLES, n, 1)) * joint.sum(axis=2)[..., None]
    latent = below.sum(axis=2)  # (S,N)
    means = momdp.confusion[attributes, :, latent]
    precisions = momdp.precision[attributes, :, latent]
    rows = sample_rows(means, precisions, belief.percept_counts, rng)  # (S,N,E,K)
    # Percepts of these rows, one after the other, and what each says of every class.
    counts = np.tile(belief.percept_counts, (_SAMPLES, 1, 1, 1))
    sample, attribute, behavior = np.ogrid[:_SAMPLES, :n, :e]
    evidence = np.zeros((most + 1, e, _SAMPLES, n, momdp.n_classes))
    for u in range(most):
        z = (rows.cumsum(axis=3) <= rng.random((_SAMPLES, n, e, 1))).sum(axis=3).clip(max=k - 1)
        mean = momdp.confusion[attribute, behavior, :, z]
        count = counts[sample, attribute, behavior, z, None]
        prob = predictive(mean, momdp.precision, count, counts.sum(axis=3)[..., None])
        evidence[u + 1] = evidence[u] + np.log(prob.clip(1e-300)).transpose(2, 0, 1, 3)
        counts[sample, attribute, behavior, z] += 1
    return evidence
