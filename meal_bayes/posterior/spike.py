"""Probability that a pair of attribute and behavior is informative.

Youden's J of a pair is counted on objects on which its classifiers were not trained. If a pair is
uninformative, J is positive by chance with probability one half. The pairs with J < 0 show how much
J varies by chance, because all of them are below 0 by chance. With se the standard error of J for
independent percepts,

    kappa^2 = (sum over pairs with J < 0 of (J / se)^2 + 10) / (their number + 10),

and J ~ Normal(0, kappa se) for an uninformative pair. For an informative pair, the true J is
uniform on (0, 1), and the counted J varies around it by the same amount. A fraction pi of the pairs
with J > 0 is informative. Expectation maximization estimates pi and the probability w that each of
these pairs is informative:

    w = pi S / (pi S + (1 - pi) N),   pi = (sum w + 1) / (their number + 2),
    S = Phi((1 - J) / (kappa se)) - Phi(-J / (kappa se)),   N = 2 phi(J / (kappa se)) / (kappa se).

Pairs with J <= 0 are treated as uninformative (w = 0).
"""

import numpy as np
from scipy.special import ndtr

from meal_bayes.arrays import Bools, Floats, no_and_yes_of, tiny_is_zero
from meal_bayes.perception.confusion import youden

_AT_ONE = 10.0  # weight of kappa = 1, in pairs below chance
_ROUNDS = 200  # of expectation maximization, at most
_SAME = 1e-6  # change of pi below which the iteration ends


@tiny_is_zero
def probability_of_telling(counts: Floats, effective: Floats, given: Bools | None = None) -> Floats:
    """Compute the probability that each pair is informative, (P,E).

    Parameters
    ----------
    counts : Floats
        (P,E,2,K) counts of percepts.
    effective : Floats
        (P,E,2,K) numbers of independent percepts with the same information.
    given : Bools, optional
        (P,E) pairs with percepts of the robot's own detector. Their probability is 1, and they are
        not used to estimate kappa and pi.
    """
    j = youden(counts)
    error = null_spread(j, effective, given) * standard_error(effective)
    candidate = j > 0
    if given is not None:
        candidate &= ~given
    # The density of J > 0 for informative and for uninformative pairs.
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
    """Return kappa: the spread of J of uninformative pairs, divided by its standard error."""
    below = j < 0
    if given is not None:
        below &= ~given
    z = (j / standard_error(effective))[below]
    return float(np.sqrt(((z**2).sum() + _AT_ONE) / (len(z) + _AT_ONE)))


def standard_error(effective: Floats) -> Floats:
    """Return the standard error (...) of J for counts (...,2,K) of independent percepts."""
    by_answer = no_and_yes_of(effective)  # (...,2,2)
    n = by_answer.sum(axis=-1)
    yes = (by_answer[..., 1] + 0.5) / (n + 1)
    return np.asarray(np.sqrt((yes * (1 - yes) / (n + 1)).sum(axis=-1)))
