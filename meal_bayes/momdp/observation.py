"""The observation model: percepts of one object, given its latent class.

An object of latent class c has a row of its own for every behavior and attribute, drawn from
Dirichlet(precision * mean). Percepts follow the row, so that in a trial their levels are
Dirichlet-multinomial: a percept makes its own level likelier next time. Infinite precision gives
percepts independent given the class, which is Eq. 8 where the class is the truth.

`predictive` is the one definition of this, for arrays and, compiled, for the planning kernels:
belief, search tree, error tables and everything else that asks what comes next call it.
`sample_rows` draws what `predictive` averages over.

Another observation model is a function that makes latent classes, mean rows and precisions from a
confusion posterior (`posterior.trait` is one), named in an agent.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def predictive(mean: Any, precision: Any, count: Any, total: Any) -> Any:
    """Return Pr(level | latent class, percepts so far) = (s c + n_z) / (s + n).

    Here c is the mean probability of the level in the class, s > 0 the precision of the row (inf if
    it is known exactly), n_z the number of percepts of this level, and n the number of all percepts
    of the behavior. The function computes this as c + (n_z - n c) / (s + n), which is c for
    infinite s.

    >>> predictive(0.6, 5.0, 6, 6)
    0.8181818181818182
    >>> predictive(0.6, float("inf"), 6, 6)
    0.6
    """
    return mean + (count - total * mean) / (precision + total)


def sample_rows(
    mean: ArrayLike, precision: ArrayLike, counts: ArrayLike, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Sample an object's rows (...,K) from Dirichlet(precision * mean + counts).

    The rows `mean` (...,K) are those of its latent class, `precision` (...) their weight (inf: the
    mean itself), `counts` (...,K) the percepts that the object has shown.
    """
    rows = np.asarray(mean, dtype=float)
    weight = np.asarray(precision, dtype=float)[..., None]
    exact = np.isinf(weight)
    gamma = rng.standard_gamma(np.where(exact, 1.0, weight) * rows + counts) + 1e-300
    return np.where(exact, rows, gamma / gamma.sum(axis=-1, keepdims=True))
