"""Values of open-loop plans if attributes are dependent, by a group or by a joint prior.

If attributes are dependent, the probability that a report is right is not a product over
attributes. Therefore the answer at the end of a plan is valued after each outcome, that is, after
each combination of percepts of the plan. Few outcomes are enumerated, many are sampled. After an
outcome, the largest posterior probability Pr(y) is computed exactly.

The gain of a plan is the mean over its outcomes of max_y b'(y) - b'(best answer now). The mean of
the second term is b(best answer now), so a plan that changes no answer has a gain of exactly 0,
without noise from sampling.

If outcomes are sampled, the best plan is chosen by one sample and valued by a second one. The
largest of several estimates is too high on average; a second, independent estimate for the same
plan is not.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Floats, Ints, freeze
from meal_bayes.domain import Query
from meal_bayes.momdp import MOMDP, Belief, answer_value
from meal_bayes.momdp.belief import Truths, joint_tables, truths_of
from meal_bayes.momdp.observation import predictive, sample_rows

SAMPLES = 256  # number of sampled outcomes of a plan
ENUMERATED = 512  # largest number of outcomes that are all enumerated
PERCEPTS = 6  # largest number of percepts of one behavior in a plan


class Endings(NamedTuple):
    """Values of the best answer at the end of plans."""

    value: Floats  # (J,)
    error: Floats  # (J,) standard errors; 0 if all outcomes are enumerated


class CoupledPlans:
    """Values of the answers after plans, at one belief.

    Plans are given by their numbers of percepts of each behavior (J,E). `endings` computes the
    values for all plans; `fresh` computes some of them again with new samples.
    """

    def __init__(
        self, momdp: MOMDP, belief: Belief, counts: Ints, rng: np.random.Generator, samples: int
    ) -> None:
        self.momdp = momdp
        self.belief = belief
        self.counts = counts
        self.rng = rng
        self.samples = samples
        self._now = answer_value(momdp, belief)
        # Percepts with the same probability in all classes are uninformative.
        rows = momdp.confusion
        same = (rows == rows[:, :, :1]).all(axis=(2, 3))
        same &= (momdp.precision == momdp.precision[:, :, :1]).all(axis=2)
        self._told = counts[:, None] * ~same  # (J,N,E) informative percepts
        self._log_likelihood: dict[tuple[int, int, int], Floats] = {}
        most = int(counts.max(initial=0))
        ways = np.array([math.comb(k + momdp.levels - 1, k) for k in range(most + 1)], float)
        self.is_enumerated = ways[self._told].prod(axis=(1, 2)) <= ENUMERATED

    def endings(self) -> Endings:
        """Compute the values of the answers after all plans."""
        endings = Endings(np.zeros(len(self.counts)), np.zeros(len(self.counts)))
        for j in np.flatnonzero(self.is_enumerated).tolist():
            after, weight = self._enumerate(j)
            endings.value[j] = self._now + weight @ self._gain(after)
        self._sample(np.flatnonzero(~self.is_enumerated), endings)
        return endings

    def fresh(self, endings: Endings, plans: Ints) -> Endings:
        """Return the endings, with those of some plans from new samples, if they are sampled."""
        again = Endings(endings.value.copy(), endings.error.copy())
        self._sample(plans[~self.is_enumerated[plans]], again)
        return again

    def _gain(self, after: Floats) -> Floats:
        """Compute the gain (M,) of the best answer after outcomes over the best answer now.

        The gain is the difference of two expected rewards after an outcome: that of the answer that
        is best then, and that of the answer that is best now. Outcomes are ln Pr(class) (M,N,C).
        """
        momdp = self.momdp
        reports = momdp.reports
        belief = self.belief
        truths = self._truths(after)
        if reports.event is not None:
            answers = reports.answers(reports.probability(truths))
            best = answers.max(axis=1)
            now = answers[:, reports.answers(reports.probability(belief)).argmax()]
        else:
            factors = truths.factors(momdp.query.groups)
            chosen = [row.argmax() for row in belief.factors]
            likeliest = np.stack([row.max(axis=1) for row in factors], axis=1)
            unchanged = np.stack(
                [row[:, y] for row, y in zip(factors, chosen, strict=True)], axis=1
            )
            best = reports.of_right(likeliest)
            now = reports.of_right(unchanged)
        if momdp.exit_value > -np.inf:  # the agent may abstain
            best = np.maximum(best, momdp.exit_value)
            if self._now == momdp.exit_value:
                now = np.full(len(best), momdp.exit_value)
        return np.asarray(best - now)

    def _truths(self, after: Floats) -> "Truths | _Values":
        """Return the posterior of the truth after outcomes ln Pr(class) (M,N,C)."""
        momdp = self.momdp
        if momdp.joint is None:
            return truths_of(momdp, after)
        return _Values(momdp.query, joint_tables(momdp, momdp.joint, after))

    # --- All outcomes

    def _enumerate(self, j: int) -> tuple[Floats, Floats]:
        """Enumerate the outcomes of a plan -> ln Pr(class) after each (M,N,C), Pr(outcome) (M,)."""
        belief = self.belief
        by_attribute = [self._of_attribute(j, i) for i in range(len(belief.log_prob))]
        index = np.indices([len(outcomes) for outcomes in by_attribute])
        index = index.reshape(len(by_attribute), -1)  # (N,M)
        evidence = np.stack(
            [outcomes[m] for outcomes, m in zip(by_attribute, index, strict=True)], axis=1
        )
        # Pr(outcome) = sum_y b(y) prod_i Pr(outcome_i | y_i, percepts so far)
        weight = np.repeat(belief.joint[:, None], index.shape[1], axis=1)  # (Y,M)
        of_truth = self._class_of_truth()
        for i, y in enumerate(self.momdp.query.values.T.astype(np.intp)):
            likelihood = of_truth[i] @ np.exp(by_attribute[i]).T  # (2,M_i)
            weight *= likelihood[y][:, index[i]]
        return belief.log_prob + evidence, weight.sum(axis=0)

    def _of_attribute(self, j: int, i: int) -> Floats:
        """Compute ln Pr(outcome | class) of one attribute after plan j, (M,C)."""
        log_likelihood = np.zeros((1, self.momdp.n_classes))
        for e in np.flatnonzero(self._told[j, i]).tolist():
            more = self._of_behavior(i, e, int(self._told[j, i, e]))
            log_likelihood = (log_likelihood[:, None] + more).reshape(-1, more.shape[1])
        return log_likelihood

    def _of_behavior(self, i: int, e: int, k: int) -> Floats:
        """Compute ln Pr(levels of the next k percepts | class), (M,C), one row for each count."""
        key = i, e, k
        if key not in self._log_likelihood:
            momdp = self.momdp
            seen = self.belief.percept_counts[i, e]
            total = seen.sum()
            count, ways = _level_counts(k, momdp.levels)
            drawn = np.zeros((len(count), momdp.n_classes))
            # Polya's urn. The order does not matter, so all percepts of the lowest level are first.
            for m, of_level in enumerate(count.tolist()):
                past = 0
                for z, number in enumerate(of_level):
                    for more in range(number):
                        mean = momdp.confusion[i, e, :, z]
                        spread = momdp.precision[i, e]
                        p = predictive(mean, spread, seen[z] + more, total + past)
                        drawn[m] += np.log(p.clip(1e-300))
                        past += 1
            self._log_likelihood[key] = drawn + np.log(ways)[:, None]
        return self._log_likelihood[key]

    def _class_of_truth(self) -> Floats:
        """Compute Pr(class | truth, percepts so far) ~ Pr(class | percepts) Pr(truth | class)."""
        joint = np.exp(self.belief.log_prob + self.momdp.log_truth.transpose(1, 0, 2))  # (2,N,C)
        joint /= joint.sum(axis=2, keepdims=True).clip(1e-300)
        return joint.transpose(1, 0, 2)

    # --- Samples of them

    def _sample(self, plans: Ints, endings: Endings) -> None:
        """Write values of answers after plans, by sampled objects and percepts, into `endings`."""
        if not len(plans):
            return
        momdp = self.momdp
        most = self.counts[plans].max(axis=0)
        behaviors = np.argsort(-most, kind="stable")[: np.count_nonzero(most)]
        evidence = self._sampled_evidence(behaviors, most[behaviors])
        for j in plans.tolist():
            percepts = self.counts[j, behaviors]
            told = np.flatnonzero(percepts)
            after = self.belief.log_prob + evidence[percepts[told], told].sum(axis=0)  # (S,N,C)
            gain = self._gain(after)
            endings.value[j] = self._now + gain.mean()
            endings.error[j] = _standard_error(gain, momdp.correct - momdp.incorrect)

    def _sampled_truths(self) -> Ints:
        """Sample truths (S,N) from the belief."""
        belief = self.belief
        rng = self.rng
        if belief.joint_table is not None:
            # With evenly spaced quantiles, each value vector occurs as often as expected, +-1.
            quantiles = (np.arange(self.samples) + rng.random()) / self.samples
            cumulative = belief.joint_table.cumsum()
            number = np.searchsorted(cumulative, quantiles * cumulative[-1], side="right")
            values = self.momdp.query.values.astype(int)
            return np.asarray(values[number.clip(max=len(cumulative) - 1)])
        truth = np.zeros((self.samples, len(self.momdp.query)), int)
        for indices, prob in zip(self.momdp.query.variables, belief.marginals, strict=True):
            value = rng.choice(len(prob), self.samples, p=prob / prob.sum())
            truth[:, indices] = (value[:, None] == np.arange(len(prob)))[:, -len(indices) :]
        return truth

    def _sampled_evidence(self, behaviors: Ints, most: Ints) -> Floats:
        """Sample objects, and `most` (B,) percepts of each of the behaviors (B,).

        `most` must not increase. Returns ln Pr(first u percepts of a behavior | class),
        (U+1,B,S,N,C).
        """
        momdp = self.momdp
        rng = self.rng
        n = len(momdp.query)
        attributes = np.arange(n)
        truth = self._sampled_truths()
        of_truth = self._class_of_truth()[attributes, truth]  # (S,N,C)
        latent = (of_truth.cumsum(axis=2) < rng.random((self.samples, n, 1))).sum(axis=2)
        latent = latent.clip(max=momdp.n_classes - 1)
        seen = self.belief.percept_counts[:, behaviors]  # (N,B,K)
        confusion = momdp.confusion[:, behaviors]
        precision = momdp.precision[:, behaviors]
        means = confusion[attributes, :, latent]
        rows = sample_rows(means, precision[attributes, :, latent], seen, rng)  # (S,N,B,K)
        # Draw percepts from these rows one after another, and compute their evidence.
        counts = np.tile(seen, (self.samples, 1, 1, 1))
        below = rows.cumsum(axis=3)[..., :-1]
        shape = len(behaviors), self.samples, n, momdp.n_classes
        evidence = np.zeros((int(most.max(initial=0)) + 1, *shape))
        for u in range(len(evidence) - 1):
            b = np.count_nonzero(most > u)  # number of behaviors with another percept
            sample, attribute, behavior = np.ogrid[: self.samples, :n, :b]
            z = (below[:, :, :b] <= rng.random((self.samples, n, b, 1))).sum(axis=3)
            mean = confusion[attribute, behavior, :, z]
            count = counts[sample, attribute, behavior, z, None]
            total = counts[:, :, :b].sum(axis=3)[..., None]
            prob = predictive(mean, precision[:, :b], count, total)
            log_prob = np.log(prob.clip(1e-300)).transpose(2, 0, 1, 3)
            evidence[u + 1, :b] = evidence[u, :b] + log_prob
            counts[sample, attribute, behavior, z] += 1
        return evidence


def _standard_error(gain: Floats, reward_range: float) -> float:
    """Compute the standard error of the mean of sampled gains (S,).

    A rare outcome may not be among the samples. Therefore two outcomes are added to the variance,
    one with a gain of 0 and one with the whole range of rewards, so the error is never 0.
    """
    mean = gain.mean()
    variance = (((gain - mean) ** 2).sum() + mean**2 + (reward_range - mean) ** 2) / len(gain)
    return float(np.sqrt(variance / len(gain)))


class _Values(NamedTuple):
    """Posterior of all combinations of values after outcomes, (M,Y); see `Truths`."""

    query: Query
    joint_table: Floats

    @property
    def positive(self) -> Floats:
        """Pr(attribute is true), (M,N)."""
        return np.asarray(self.joint_table @ self.query.values)

    def factors(self, groups: tuple[tuple[int, ...], ...]) -> list[Floats]:
        """Return the probabilities of all combinations, because they do not factor."""
        return [self.joint_table]


class _LevelCounts(NamedTuple):
    """Possible numbers of percepts of each level."""

    counts: Ints  # (M,K) number of percepts of each level
    ways: Floats  # (M,) number of orders of these percepts


@lru_cache(maxsize=64)
def _level_counts(percepts: int, levels: int) -> _LevelCounts:
    """List the possible numbers of percepts of each level, for a given number of percepts."""
    counts = [(percepts,)] if levels == 1 else [
        (first, *rest)
        for first in range(percepts + 1)
        for rest in _level_counts(percepts - first, levels - 1).counts.tolist()
    ]  # fmt: skip
    ways = [math.factorial(percepts) / math.prod(map(math.factorial, row)) for row in counts]
    return _LevelCounts(freeze(np.array(counts), np.int64), freeze(ways))
