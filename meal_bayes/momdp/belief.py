"""The exact belief filter: N log-odds and percept counts, never 2^N numbers."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.errors import ImpossibleObservation
from meal_bayes.momdp.model import MOMDP


class Transition(NamedTuple):
    """One (a, x', z) of the history."""

    action: int
    next_x: int
    observation: NDArray[np.int8] | None  # (N,) percept levels, None = "none"


@dataclass(frozen=True, slots=True)
class Belief:
    """The information state: x, the evidence on each attribute, and the percepts of this trial.

    Evidence stands in two log-odds, as percepts may share an error: `told` is of the truth (the
    prior, a person's answers, and all percepts where misperception is 0), `felt` of the value that
    the object seems to have.
    """

    x: int
    told: NDArray[np.float64]  # (N,) ln Pr(true) / Pr(false)
    seen: NDArray[np.int64]  # (N,E,K) percepts of this object so far
    felt: NDArray[np.float64] = None  # type: ignore[assignment]  # (N,) zeros by default
    misperception: NDArray[np.float64] = None  # type: ignore[assignment]  # (N,) zeros by default

    def __post_init__(self) -> None:
        nothing = np.zeros(np.shape(self.told))
        felt = nothing if self.felt is None else self.felt
        share = nothing if self.misperception is None else self.misperception
        set_frozen(self, told=freeze(self.told), seen=freeze(self.seen, np.int64))
        set_frozen(self, felt=freeze(felt), misperception=freeze(share))

    def at(self, x: int) -> "Belief":
        """Move to another x, believing the same."""
        return Belief(x, self.told, self.seen, self.felt, self.misperception)

    @property
    def log_odds(self) -> NDArray[np.float64]:
        """Log-odds of the truth, (N,)."""
        return freeze(self.told + soften(self.felt, self.misperception))

    @property
    def positive(self) -> NDArray[np.float64]:
        """Pr(attribute is true), (N,)."""
        with np.errstate(over="ignore"):
            return freeze(1.0 / (1.0 + np.exp(-self.log_odds)))

    @property
    def seeming(self) -> NDArray[np.float64]:
        """Pr(the object seems to have the attribute), (N,): what percepts depend on."""
        with np.errstate(over="ignore"):
            log_odds = self.felt + soften(self.told, self.misperception)
            return freeze(1.0 / (1.0 + np.exp(-log_odds)))

    @property
    def joint(self) -> NDArray[np.float64]:
        """Pr(y) of every value vector, (Y,); small N only."""
        joint = np.ones(1)
        for p in self.positive:
            joint = np.concatenate([joint[:, None] * (1 - p), joint[:, None] * p], 1).ravel()
        return freeze(joint)

    @property
    def best_report(self) -> NDArray[np.bool_]:
        """The most probable value vector, (N,)."""
        return freeze(self.log_odds > 0, np.bool_)

    @property
    def certainty(self) -> float:
        """Pr(the most probable value vector)."""
        return float(np.prod(1.0 / (1.0 + np.exp(-np.abs(self.log_odds)))))

    @property
    def entropy(self) -> float:
        """Entropy of the belief, bits."""
        p = np.clip(self.positive, 1e-300, 1.0)
        q = np.clip(1.0 - self.positive, 1e-300, 1.0)
        return float(-(p * np.log2(p) + q * np.log2(q)).sum())


def soften(log_odds: NDArray[np.float64], error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pass log-odds through a symmetric channel: what they tell of its other end.

    ln [(1 - error) e^L + error] / [error e^L + 1 - error], which stays within logit(1 - error).
    """
    small = np.exp(-np.abs(log_odds))  # 0 at infinite log-odds, which a channel makes finite
    wrong = np.where(error > 0, error, 0.5)  # a stand-in where there is no error
    ratio = np.log((1 - wrong + wrong * small) / (wrong + (1 - wrong) * small))
    return np.where(error > 0, np.sign(log_odds) * ratio, log_odds)


def initial_belief(momdp: MOMDP) -> Belief:
    """Belief at the start of a trial: x0, the prior, nothing seen."""
    with np.errstate(divide="ignore"):
        log_odds = np.log(momdp.prior) - np.log1p(-momdp.prior)
    seen = np.zeros((len(momdp.query), momdp.n_behaviors, momdp.levels), dtype=np.int64)
    return Belief(momdp.start, log_odds, seen, misperception=momdp.misperception)


def update_belief(belief: Belief, momdp: MOMDP, transition: Transition) -> Belief:
    """Condition the belief on one executed action (Alg. 1, l. 10).

    The factor of each queried attribute is its Dirichlet-multinomial predictive given the percepts
    already seen in this trial, (s c + n_z) / (s + n); with infinite precision s this is Eq. 8.
    Where percepts share an error, they condition the value that the object seems to have.

    Parameters
    ----------
    belief : the belief before the action.
    momdp : the query's MOMDP.
    transition : the action, the next x, and the percept levels; "none" changes x only.

    Raises
    ------
    ImpossibleObservation : the percept has probability zero under every value still believed in.
    """
    if transition.observation is None or transition.action >= momdp.n_behaviors:
        return belief.at(transition.next_x)
    e, levels = transition.action, np.asarray(transition.observation, dtype=np.intp)
    attributes = np.arange(len(momdp.query))
    seen = belief.seen[:, e]
    total = seen.sum(axis=1)
    weight = total[:, None] / (momdp.precision[:, e] + total[:, None])  # (N,2), 0 at inf
    share = seen[attributes, levels] / np.maximum(total, 1)
    mean = momdp.confusion[attributes, e, :, levels]  # (N,2)
    factor = mean + weight * (share[:, None] - mean)
    on_truth = momdp.direct[e] | (belief.misperception == 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(factor[:, 1]) - np.log(factor[:, 0])
        told = np.where(on_truth, belief.told + ratio, belief.told)
        felt = np.where(on_truth, belief.felt, belief.felt + ratio)
    contradicted = np.isnan(told) | np.isnan(felt)
    if contradicted.any():
        bad = momdp.query.attributes[int(np.flatnonzero(contradicted)[0])]
        raise ImpossibleObservation(
            f"Percept of {bad!r} by {momdp.behavior_names[e]!r} has probability zero under every "
            "value still believed in; give the confusion rows a prior without zeros."
        )
    counted = belief.seen.copy()
    counted[attributes, e, levels] += 1
    return Belief(transition.next_x, told, counted, felt, belief.misperception)


def best_report(momdp: MOMDP, belief: Belief) -> int:
    """Give the action index E + y of the most probable report."""
    return momdp.n_behaviors + momdp.query.index_of(belief.best_report)


def report_value(momdp: MOMDP, belief: Belief) -> float:
    """Give the best report's expected reward: r- + (r+ - r-) prod_i max(b_i, 1 - b_i)."""
    return momdp.incorrect + (momdp.correct - momdp.incorrect) * belief.certainty
