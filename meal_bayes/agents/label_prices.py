"""What a robot should pay at most for one more labeled object: prices of learning a table.

A learner's problem is Bayes-adaptive: a behavior's rates are unknown, and knowing them better is
worth something to every question to come. It is solved here for one (attribute, behavior) at a
time, as a problem of optimal stopping. After m more labeled objects the mean rates have moved by
part of what they can move, and N(m) questions gain V(rates) - V(now) each; a robot may stop at any
of the numbers m. The price of one object is the highest at which it still buys:

    price = max over stopping times tau of  E[N(tau) (V(rates after tau) - V(now))] / E[tau],

the index of Gittins and Whittle; with tau a fixed number it is KG(*) [Frazier2010].

The rates move along one line, that of the difference J = Pr(yes | true) - Pr(yes | false), which
decides what they are worth; each rate takes its regression on J, with J as Normal, up to 2.2
standard deviations, for its true tails are lighter. Knowledge grows as the posterior variance
falls: m objects of a rate of which weight n is known explain m / (m + n) of it.

Behaviors are substitutes. The one whose learning brings most, after its costs, will be learned; the
others are worth what they add to that: E max(their gain, its gain) less E of its gain.
"""

import numpy as np

from meal_bayes.arrays import Floats

# m, labeled objects after which a robot may stop
AHEAD: Floats = np.array([1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0])
_Z = np.linspace(-2.2, 2.2, 9)  # of J, standard deviations from its mean
_MIDDLE = len(_Z) // 2
_LEAST = 0.01  # rates that may be found are at least this far from 0 and 1
_ROUNDS = 6  # of the search for a price, which grows in each

_NORMAL = np.exp(-(_Z**2) / 2) / np.exp(-(_Z**2) / 2).sum()


def rate_moments(alpha: Floats) -> tuple[Floats, Floats]:
    """Return mean and variance (...) of rates of yes, from Beta parameters (...,2), no and yes."""
    total = alpha.sum(axis=-1)
    mean = alpha[..., 1] / total
    return mean, mean * (1 - mean) / (total + 1)


def uncertain(rates: Floats) -> Floats:
    """Return rates that are neither 0 nor 1, as none that may be found is."""
    return np.asarray(np.clip(rates, _LEAST, 1 - _LEAST))


def rates_ahead(alpha: Floats) -> Floats:
    """Return rates (...,Z,2) that may be found true, from Beta parameters (...,2,2), no and yes."""
    mean, variance = rate_moments(alpha)
    deviation = np.sqrt(variance)  # (...,2)
    direction = deviation / np.sqrt((deviation**2).sum(axis=-1, keepdims=True))
    moved = deviation * direction * np.array([-1.0, 1.0])
    rates = mean[..., None, :] + _Z[:, None] * moved[..., None, :]  # (...,Z,2)
    return uncertain(rates)


def explained(alpha: Floats, base_rates: Floats) -> Floats:
    """Return the part (...,M) of the variance of J that `AHEAD` more labeled objects explain."""
    total = alpha.sum(axis=-1)
    variance = rate_moments(alpha)[1][..., None]  # (...,2,1)
    objects = np.stack([1 - base_rates, base_rates], axis=-1)[..., None] * AHEAD  # (...,2,M)
    reduction = variance * objects / (objects + total[..., None])
    return np.asarray(reduction.sum(axis=-2) / variance.sum(axis=-2))


def prices(gain: Floats, variance_explained: Floats, questions: Floats, costs: Floats) -> Floats:
    """Return the price (R,E) of a labeled object of each behavior, of R attributes.

    Parameters
    ----------
    gain : Floats
        (R,E,Z) V(rates ahead) - V(now), s a question.
    variance_explained : Floats
        (R,E,M) part of the variance that `AHEAD` more objects explain.
    questions : Floats
        (M,) or (R,M) to come once as many objects are labeled.
    costs : Floats
        (E,) or (R,E) of a percept, s.
    """
    r, e, z = gain.shape
    moves = _transitions(variance_explained.reshape(r * e, -1))
    to_come = np.repeat(np.broadcast_to(questions, (r, len(AHEAD))), e, axis=0)
    alone = _index(gain.reshape(r * e, z), moves, to_come).reshape(r, e)
    if e == 1:
        return alone
    lead = (alone - costs).argmax(axis=1)[:, None]
    leads = np.take_along_axis(alone - costs, lead, axis=1) > 0
    # What the leader's gain will be, once it is learned as far as questions allow.
    explained_in_the_end = np.sqrt(variance_explained[..., -1])[..., None]
    lead_gain = _interpolated(gain, explained_in_the_end * _Z)
    lead_gain = np.take_along_axis(lead_gain, lead[..., None], axis=1)[:, 0]  # (R,Z)
    # E max(gain, the leader's) less E of the leader's: what is added to it.
    best_gain = np.maximum(gain[..., None], lead_gain[:, None, None]) @ _NORMAL  # (R,E,Z)
    added = best_gain - (np.maximum(lead_gain, 0.0) @ _NORMAL)[:, None, None]
    beside = _index(added.reshape(r * e, z), moves, to_come).reshape(r, e)
    return np.where(leads & (np.arange(e) != lead), beside, alone)


def _interpolated(values: Floats, z: Floats) -> Floats:
    """Interpolate values (...,Z) at z (...,J)."""
    position = np.clip((z - _Z[0]) / (_Z[1] - _Z[0]), 0.0, len(_Z) - 1)
    low = np.minimum(position.astype(np.intp), len(_Z) - 2)
    below = np.take_along_axis(values, low, axis=-1)
    above = np.take_along_axis(values, low + 1, axis=-1)
    return np.asarray(below + (position - low) * (above - below))


def _transitions(variance_explained: Floats) -> Floats:
    """Return Pr(z' | z) between stages, (n,M,Z,Z): z is a Brownian motion in what is explained.

    Three points have the mean and the variance of each step, and nearly its fourth moment.
    """
    variance = np.maximum(np.diff(variance_explained, prepend=0.0, axis=1), 0.0)  # (n,M)
    width = _Z[1] - _Z[0]
    far = np.maximum(np.rint(np.sqrt(3 * variance) / width), 1.0)
    chance = variance / (2 * (far * width) ** 2)
    n, m = variance_explained.shape
    moves = np.zeros((n, m, len(_Z), len(_Z)))
    row, stage = np.ogrid[:n, :m]
    for z in range(len(_Z)):
        for sign in (-1, 1):
            to = np.clip(z + sign * far.astype(np.intp), 0, len(_Z) - 1)
            moves[row, stage, z, to] += chance
        moves[:, :, z, z] += 1 - 2 * chance
    return moves


def _index(gain: Floats, moves: Floats, questions: Floats) -> Floats:
    """Return the price (n,) of gains (n,Z): at a price the best stopping time, and again at its.

    Each round's price is the ratio of what the last round's stopping time gains and takes, so it
    rises to the maximum (Dinkelbach).
    """
    price = np.zeros(len(gain))
    for _ in range(_ROUNDS):
        pay = questions[:, -1:] * gain
        taken = np.full(gain.shape, AHEAD[-1])
        for stage in reversed(range(len(AHEAD))):
            pay = np.einsum("nzj,nj->nz", moves[:, stage], pay)
            taken = np.einsum("nzj,nj->nz", moves[:, stage], taken)
            if stage:
                # Going on is worth what it pays less the price of the objects that it takes.
                pay_now = questions[:, stage - 1, None] * gain
                taken_now = AHEAD[stage - 1]
                goes_on = pay - price[:, None] * taken > pay_now - price[:, None] * taken_now
                pay = np.where(goes_on, pay, pay_now)
                taken = np.where(goes_on, taken, taken_now)
        price = np.maximum(price, pay[:, _MIDDLE] / taken[:, _MIDDLE])
    return price
