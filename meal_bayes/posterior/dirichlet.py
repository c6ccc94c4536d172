"""The posterior of the confusion matrices Theta: one conjugate Dirichlet distribution per row."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import ByValue, freeze, freeze_arrays, tiny_is_zero
from meal_bayes.errors import SettingsError
from meal_bayes.look import short_repr
from meal_bayes.perception.confusion import informative, youden
from meal_bayes.posterior.given import first_dispersion, generic_prior, given_rows
from meal_bayes.posterior.graded_prior import GradedPrior
from meal_bayes.posterior.grid import PRIOR_WEIGHT, grid_posterior
from meal_bayes.posterior.spike import probability_of_telling

_DIMENSIONS = 4  # (P,E,2,K)
_LEFT = 0.02  # fraction of a level's weight that remains if an object's percepts are removed


@dataclass(frozen=True, slots=True)
class ConfusionPosterior(ByValue):
    """Posterior of the confusion matrices: one Dirichlet for each attribute, behavior and truth.

    Row t of a confusion matrix holds the probabilities of the percept levels (classifier outputs
    from no to yes) if the attribute's truth is t. `from_counts` treats all percepts as independent,
    as the paper does. `from_objects` models that each object has its own confusion matrix, so that
    repeated percepts of one object are less informative. A "pair" is an attribute and a behavior.

    Attributes
    ----------
    counts : NDArray[np.float64]
        (P,E,2,K) number of percepts of labeled executions, by attribute, behavior, truth and level.
    concentration : NDArray[np.float64]
        (P,E,2,K) Dirichlet parameters of the mean row: its mean times its weight A.
    dispersion : NDArray[np.float64]
        (P,E,2) Dirichlet precision s of the objects' own rows; inf if all objects have the same
        row.
    given_prior : NDArray[np.float64] | None
        (P,E,2,K) Dirichlet parameters of the prior for pairs whose percepts come from the robot's
        own detector, and zero for all other pairs; see `posterior.given`. None if no pair has a
        detector.
    telling : NDArray[np.float64] | None
        (P,E) probability that percepts of the pair carry information about the attribute; see
        `posterior.spike`. A pair without information has the same row for both truths. None if all
        pairs are treated as informative.

    Examples
    --------
    >>> ConfusionPosterior.from_counts([[[[8, 2], [1, 9]]]]).mean[0, 0].round(3).tolist()
    [[0.75, 0.25], [0.167, 0.833]]
    """

    counts: NDArray[np.float64]
    concentration: NDArray[np.float64]
    dispersion: NDArray[np.float64]
    given_prior: NDArray[np.float64] | None = None
    telling: NDArray[np.float64] | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        freeze_arrays(self)
        shape = self.counts.shape
        if len(shape) != _DIMENSIONS or shape[2] != 2 or not (self.counts >= 0).all():
            raise SettingsError(
                f"Confusion counts have shape {shape}; expected numbers >= 0 of shape (attributes, "
                "behaviors, 2, levels)."
            )
        if self.given_prior is not None and self.given_prior.shape != shape:
            raise SettingsError(
                f"given_prior must be of shape {shape}, as the counts have; found shape "
                f"{self.given_prior.shape}."
            )
        telling = self.telling
        if telling is not None and not (
            telling.shape == shape[:2] and (telling >= 0).all() and (telling <= 1).all()
        ):
            raise SettingsError(
                f"telling must be probabilities of shape {shape[:2]} (attributes, behaviors); "
                f"found shape {telling.shape}."
            )
        for name in ("concentration", "dispersion"):
            values = getattr(self, name)
            expected = shape[:3] if name == "dispersion" else shape
            if values.shape != expected or not (values > 0).all():
                raise SettingsError(
                    f"{name} must be above 0 and of shape {expected}, as the counts have; found "
                    f"shape {values.shape}."
                )

    @classmethod
    def from_counts(cls, counts: ArrayLike, *, prior: ArrayLike = PRIOR_WEIGHT) -> Self:
        """Build the paper's posterior, in which percepts are independent given the truth.

        Parameters
        ----------
        counts : ArrayLike
            (P,E,2,K) counts of percepts, or (O,P,E,2,K) counts of the percepts of each object.
            Counts of objects are summed.
        prior : ArrayLike
            Total weight of a flat prior for each row, or (P,E,2,K) Dirichlet parameters of the
            prior.
        """
        array = np.asarray(counts)
        total = freeze(array.sum(axis=0) if array.ndim > _DIMENSIONS else array)
        concentration = total + _prior(prior, total.shape)
        return cls(total, concentration, np.full(total.shape[:3], np.inf))

    @classmethod
    @tiny_is_zero
    def from_objects(
        cls,
        counts: ArrayLike,
        *,
        prior: ArrayLike | None = None,
        given: NDArray[np.bool_] | None = None,
    ) -> Self:
        """Build the posterior in which each object has its own confusion matrices.

        Parameters
        ----------
        counts : ArrayLike
            (O,P,E,2,K) counts of the percepts of each object.
        prior : ArrayLike, optional
            Prior as in `from_counts`; then all pairs are treated as informative. By default, a
            prior for each behavior and truth is learned from the counts of all attributes, together
            with the probability that each pair is informative.
        given : NDArray[np.bool_], optional
            (P,E) whether percepts of the pair come from the robot's own detector. Pairs with a
            detector are treated as informative, whatever `prior` is.
        """
        total = np.asarray(counts).sum(axis=0)
        alpha = None if prior is None else _prior(prior, total.shape)
        rows, alpha, _, mean, s = grid_posterior(counts, alpha)
        weight = (alpha + rows.effective(s)).sum(axis=-1, keepdims=True)
        concentration = weight * mean
        concentration = concentration.reshape(total.shape)
        dispersion = s.reshape(total.shape[:3])
        if prior is None:
            effective = rows.effective(s).reshape(total.shape)
            telling = probability_of_telling(total, effective, given)
        else:
            telling = None
        if given is None or not given.any():
            return cls(total, concentration, dispersion, telling=telling)
        of_given = given_rows(counts, given)
        concentration[given] = of_given.concentration
        dispersion[given] = of_given.dispersion
        given_prior = np.zeros(total.shape)
        given_prior[given] = of_given.prior
        return cls(total, concentration, dispersion, given_prior, telling)

    def believe(self, given: NDArray[np.bool_]) -> Self:
        """Return the posterior in which the pairs `given` (P,E) have the prior of a detector.

        Pairs that already have counts or this prior do not change until the next fit.
        """
        new = given & ~self.given & ~self.counts.any(axis=(2, 3))
        if not new.any():
            return self
        generic = np.where(new[..., None, None], generic_prior(self.counts.shape[-1]), 0.0)
        given_prior = generic if self.given_prior is None else self.given_prior + generic
        concentration = np.where(new[..., None, None], generic, self.concentration)
        telling = None if self.telling is None else np.where(new, 1.0, self.telling)
        return replace(
            self,
            concentration=concentration,
            dispersion=np.where(new[..., None], first_dispersion(), self.dispersion),
            given_prior=given_prior,
            telling=telling,
        )

    @property
    def given(self) -> NDArray[np.bool_]:
        """Whether percepts of each pair come from the robot's own detector, (P,E)."""
        if self.given_prior is None:
            return np.zeros(self.counts.shape[:2], np.bool_)
        return freeze(self.given_prior.any(axis=(2, 3)), np.bool_)

    @property
    def mean(self) -> NDArray[np.float64]:
        """Posterior mean of the confusion matrices, (P,E,2,K)."""
        return freeze(_mean(self.concentration, self.telling))

    @property
    def precision(self) -> NDArray[np.float64]:
        """Dirichlet precision (P,E,2) of the row of a new object, s A / (s + A + 1).

        This precision gives the variance of the row, which has two sources: objects differ
        (dispersion s), and the mean row is estimated (weight A). The precision is A if s is
        infinite, and s if A is infinite.
        """
        return freeze(_precision(self.concentration, self.dispersion))

    @property
    def youden(self) -> NDArray[np.float64]:
        """Youden's J of the mean, TPR - FPR, (P,E); -inf for pairs without percepts."""
        known = self.counts.any(axis=(2, 3)) | self.given
        return np.where(known, youden(self.mean), -np.inf)

    @property
    def informative(self) -> NDArray[np.bool_]:
        """Whether Youden's J of a pair is positive for both its mean and its counts, (P,E).

        For percepts of the robot's own detector, the mean alone decides. Classifiers trained on few
        objects look better than they are, so their counts are checked too.
        """
        counted = informative(self.counts) | self.given
        return freeze(counted & informative(self.mean), np.bool_)

    @tiny_is_zero
    def update(self, counts: ArrayLike, before: ArrayLike | None = None) -> Self:
        """Add the percepts of one object, where n percepts of a row have the weight n(s+1)/(n+s).

        The prior and the dispersion s do not change, so the result does not depend on the order of
        the objects. If you add the percepts of one object in two updates, pass the earlier counts
        as `before`; otherwise the percepts are treated as those of two objects.

        Parameters
        ----------
        counts : ArrayLike
            (P,E,2,K) counts of all percepts of the object.
        before : ArrayLike, optional
            (P,E,2,K) counts of the same object that were added before; leave it out for a new
            object.
        """
        # Subtract the weight of the object's earlier percepts, add that of all its percepts.
        final = np.asarray(counts, dtype=float)
        counted = np.zeros(self.counts.shape) if before is None else np.asarray(before, dtype=float)
        gained = _effective(final, self.dispersion) - _effective(counted, self.dispersion)
        concentration = self.concentration + gained
        return replace(self, counts=self.counts + (final - counted), concentration=concentration)

    def without(
        self,
        attribute: NDArray[np.intp],
        behavior: NDArray[np.intp],
        counts: NDArray[Any],
        prior: GradedPrior | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return rows (U,2,K) and precision of U pairs without the percepts of one object.

        The dispersion and the probability that a pair is informative do not change. The prior
        changes only if you pass `prior`. The prior contributes to the weight of each level, so at
        least 2 % of the weight remain.

        Parameters
        ----------
        attribute, behavior : NDArray[np.intp]
            (U,) positions of the pairs' attributes and behaviors.
        counts : NDArray[Any]
            (U,2,K) counts of the object's percepts, which were added before.
        prior : GradedPrior, optional
            Learned prior of the rows, for all pairs whose percepts do not come from the robot's own
            detector.
        """
        dispersion = self.dispersion[attribute, behavior]
        counted = self.concentration[attribute, behavior]
        worth = _effective(counts, dispersion)
        taken_out = counted - worth
        if prior is not None:
            learned = ~self.given[attribute, behavior]
            taken_out += prior.change_without(attribute, behavior, worth) * learned[:, None, None]
        alpha = np.maximum(taken_out, _LEFT * counted)
        telling = None if self.telling is None else self.telling[attribute, behavior]
        return _mean(alpha, telling), _precision(alpha, dispersion)

    def select(
        self, columns: Sequence[int], *, exact: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the confusion matrices (N,E,2,K) and their precision (N,E,2) for a query.

        A pair that is not `informative` gets the same row for both truths, so its percepts do not
        change the belief.

        Parameters
        ----------
        columns : Sequence[int]
            Positions of the N queried attributes among the domain's P attributes.
        exact : bool
            Whether to treat the mean as known exactly (infinite precision), as the paper's Eq. 8
            does.
        """
        picked = np.asarray(columns, dtype=np.intp)
        precision = self.precision[picked]
        informative = self.informative[picked]
        telling = np.where(informative, 1.0 if self.telling is None else self.telling[picked], 0.0)
        mean = _mean(self.concentration[picked], telling)
        # With unequal precisions, the agreement of repeated percepts would be informative.
        shared = precision.min(axis=2, keepdims=True)
        precision = np.where(informative[..., None], precision, shared)
        if exact:
            precision = np.full_like(precision, np.inf)
        return freeze(mean), freeze(precision)


def _effective(counts: NDArray[Any], dispersion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return numbers of independent percepts with the same information as those of one object.

    This is the rule of `grid.worth_of_percept`, in a form that allows an infinite s.
    """
    per_percept = 1 / dispersion[..., None]
    weight = (1 + per_percept) / (1 + counts.sum(axis=-1, keepdims=True) * per_percept)
    return np.asarray(weight * counts)


def _mean(
    concentration: NDArray[np.float64], telling: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Return mean rows (...,2,K), mixed with the row of both truths by `telling` (...)."""
    rows = concentration / concentration.sum(axis=-1, keepdims=True)
    if telling is None:
        return np.asarray(rows)
    pooled = concentration.sum(axis=-2, keepdims=True)
    pooled = pooled / pooled.sum(axis=-1, keepdims=True)
    weight = telling[..., None, None]
    return np.asarray(weight * rows + (1 - weight) * pooled)


def _precision(
    concentration: NDArray[np.float64], dispersion: NDArray[np.float64]
) -> NDArray[np.float64]:
    a = concentration.sum(axis=-1)
    with np.errstate(invalid="ignore"):
        combined = dispersion * a / (dispersion + a + 1)
    return np.asarray(np.where(np.isnan(combined), np.minimum(dispersion, a), combined))


def _prior(prior: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    alpha = np.asarray(prior, dtype=float)
    return np.broadcast_to(alpha if alpha.ndim else alpha / shape[-1], shape)
