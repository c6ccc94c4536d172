"""Information-theoretic reward shaping (ITRS): the paper's Eqs 9 to 11.

Reward is added where percepts have high entropy, and subtracted where experience is large. With
Eq. 8 the entropy of a state is the sum over the queried attributes, and the experience of a query
is the mean over them, so the shaping factors into `MOMDP.bonus` (N,E,2).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import freeze
from meal_bayes.domain import Domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp.model import MOMDP


@dataclass(frozen=True, slots=True)
class ITRS:
    """Weights of the shaping, fixed over a run; the published code uses alpha 6, beta 30.

    Attributes
    ----------
    alpha : float
        Reward for a bit of percept entropy.
    beta : float
        Reward subtracted for a unit of experience.
    delta : float
        Labelled instances that make one unit of experience (Eq. 10).
    """

    alpha: float
    beta: float
    delta: float

    def __post_init__(self) -> None:
        if not (self.alpha >= 0 and self.beta >= 0 and self.delta > 0):
            raise SettingsError(f"Need alpha >= 0, beta >= 0 and delta > 0; found {self}.")


def observation_entropy(momdp: MOMDP) -> NDArray[np.float64]:
    """Compute the entropy (N,E,2), bits, of a percept given the attribute's value (Eq. 9).

    More levels than two are summed to yes/no, so that alpha keeps its meaning. Behaviors that
    never give a percept have entropy 0.
    """
    yes = momdp.rows[..., momdp.levels // 2 :].sum(axis=-1)
    rows = np.clip(np.stack([1 - yes, yes]), np.finfo(float).tiny, 1.0)
    entropy = -(rows * np.log2(rows)).sum(axis=0)
    senses = momdp.observation_probability.max(axis=(1, 2), keepdims=True)[:, 0] > 0  # (E,1)
    return freeze(np.where(senses, entropy, 0.0))


def shape_reward(momdp: MOMDP, experience: ArrayLike, itrs: ITRS, *, domain: Domain) -> MOMDP:
    """Add alpha Ent - beta IE to the reward of exploring (Eq. 11).

    Only behaviors with modalities are shaped, as the domain lists them: `ask` answers but gives no
    instance to learn from, `reinit` perceives nothing. Planners pay the bonus for legal executions
    within `limit`; what a trial reports as its reward is never shaped.

    Parameters
    ----------
    momdp : MOMDP
        The unshaped MOMDP of the query.
    experience : ArrayLike
        (N,E) IE of Eq. 10, instances over `itrs.delta`.
    itrs : ITRS
        The weights.
    domain : Domain
        The domain the MOMDP was built from.
    """
    shape = (len(momdp.query), momdp.n_behaviors)
    ie = np.asarray(experience, dtype=float)
    if ie.shape != shape or not (ie >= 0).all():
        raise SettingsError(
            f"experience has shape {ie.shape}; expected numbers >= 0 of shape {shape} "
            "(queried attributes, behaviors)."
        )
    if domain.behavior_names != momdp.behavior_names:
        raise SettingsError(
            f"The MOMDP was not built from the domain {domain.name!r}; pass its own."
        )
    bonus = itrs.alpha * observation_entropy(momdp) - itrs.beta * ie[..., None] / len(momdp.query)
    explores = np.array([bool(behavior.modalities) for behavior in domain.behaviors])
    return replace(momdp, bonus=np.where(explores[:, None], bonus, 0.0))
