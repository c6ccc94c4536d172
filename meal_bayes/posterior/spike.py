"""Whether percepts of a pair of attribute and behavior tell anything: a spike at chance.

A pair's Youden's J, counted on objects that its classifiers never saw, is above 0 by chance in half
of the pairs that tell nothing. How far it strays by chance is seen in the pairs below 0, which are
all there by chance. With se the standard error of J by independent percepts,

    kappa^2 = (sum over pairs with J < 0 of (J / se)^2 + 10) / (their number + 10),

and a pair that tells nothing has J ~ Normal(0, kappa se). One that tells has a true J uniform on
(0, 1), about which it strays as much. Of the pairs with J > 0 a share pi tells, which is found with
the probabilities w of each by expectation maximization:

    w = pi S / (pi S + (1 - pi) N),   pi = (sum w + 1) / (their number + 2),
    S = Phi((1 - J) / (kappa se)) - Phi(-J / (kappa se)),   N = 2 phi(J / (kappa se)) / (kappa se).

Pairs with J <= 0 are believed to tell nothing.
"""

import numpy as np
from scipy.special import ndtr

from meal_bayes.arrays import Bools, Floats, no_and_yes_of, tiny_is_zero
from meal_bayes.perception.confusion import youden

_AT_ONE = 10.0  # weight of kappa = 1, in pairs below chance
_ROUNDS = 200  # of expectation maximization, at most
_SAME = 1e-6  # a share that moves by less stays


@tiny_is_zero
def probability_of_telling(counts: Floats, effective: Floats, given: Bools | None = None) -> Floats:
    """Compute Pr(a pair's percepts tell anything), (P,E).

    Of percepts (P,E,2,K) as they were counted, and what these are worth, of objects that differ.
    Pairs that are given (P,E), as a detector's, have a prior of their own: theirs is 1, and they
    say nothing of the others.
    """
    j = youden(counts)
    error = null_spread(j, effective, given) * standard_error(effective)
    candidate = j > 0
    if given is not None:
        candidate &= ~given
    # The density of J among those that tell, and among those that do not, above 0.
    tells = ndtr((1 - j) / error) - ndtr(-j / error)
    null = np.sqrt(2 / np.pi) * np.exp(-0.5 * (j / error) ** 2) / error
    share = 0.5
    for _ in range(_ROUNDS):
        weight = np.where(candidate, share * tells / (share * tells + (1 - share) * null), 0.0)
        updated = (weight.sum() + 1) / (candidate.sum() + 2)
        if abs(updated - share) < _SAME:
            break
        share = updated
    return weight if given is None else np.where(given, 1.0, weight)


def null_spread(j: Floats, effective: Floats, given: Bools | None = None) -> float:
    """Return kappa, by how much J of pairs that tell nothing strays more than percepts' number."""
    below = j < 0
    if given is not None:
        below &= ~given
    z = (j / standard_error(effective))[below]
    return float(np.sqrt(((z**2).sum() + _AT_ONE) / (len(z) + _AT_ONE)))


def standard_error(effective: Floats) -> Floats:
    """Return the standard error (...) of J by independent percepts (...,2,K)."""
    by_answer = no_and_yes_of(effective)  # (...,2,2)
    n = by_answer.sum(axis=-1)
    yes = (by_answer[..., 1] + 0.5) / (n + 1)
    return np.asarray(np.sqrt((yes * (1 - yes) / (n + 1)).sum(axis=-1)))
