"""The numbers of a MOMDP: which axes its arrays have, and what each may hold."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import Query
from meal_bayes.errors import SettingsError

_TINY = np.nextafter(0.0, 1.0)
_HUGE = np.finfo(float).max

ARRAYS = {  # of a MOMDP: N attributes, E behaviors, X states, C latent classes, K levels
    "transition": "exx", "observation_probability": "exx", "legal": "xe", "confusion": "neck",
    "precision": "nec", "prior": "n", "latent_classes": "n2c", "cost": "e", "bonus": "ne2",
    "bonus_limit": "e", "limit": "e",
}  # fmt: skip

RANGES = {  # least, most, and these in words; NaN lies in none
    "prior": (0.0, 1.0, "lie in [0, 1]"),
    "observation_probability": (0.0, 1.0, "lie in [0, 1]"),
    "precision": (_TINY, np.inf, "be above 0 (inf = rows known exactly)"),
    "limit": (0.0, np.inf, "be 0 or more"),
    "bonus_limit": (0.0, np.inf, "be 0 or more"),
    "cost": (0.0, _HUGE, "be finite, and 0 or more"),
    "bonus": (-_HUGE, _HUGE, "be finite"),
    "correct": (-_HUGE, _HUGE, "be finite"),
    "incorrect": (-_HUGE, _HUGE, "be finite"),
    "discount": (_TINY, 1.0, "be above 0, and 1 at most"),
}


def check_shapes(arrays: Mapping[str, NDArray[Any]], *, n: int, e: int, x: int) -> None:
    """Check the axes of `ARRAYS`, of N attributes, E behaviors and X states."""
    levels = arrays["confusion"].shape[-1]
    # The lower half of the levels speaks for "false", the upper half for "true".
    if levels % 2:
        raise SettingsError(f"Percepts have {levels} levels; expected an even number.")
    classes = arrays["latent_classes"].size // (2 * n)
    sizes = {"n": n, "e": e, "x": x, "2": 2, "c": classes, "k": levels}
    for name, axes in ARRAYS.items():
        shape = arrays[name].shape
        expected = tuple(sizes[axis] for axis in axes)
        if shape != expected:
            raise SettingsError(f"MOMDP.{name} has shape {shape}; expected {expected}.")


def check_probabilities(arrays: Mapping[str, NDArray[Any]]) -> None:
    """Check that what can come of one thing sums to 1."""
    for name in ("transition", "confusion", "latent_classes"):
        rows = arrays[name]
        if (rows < 0).any() or not np.allclose(rows.sum(axis=-1), 1.0, atol=1e-6):
            raise SettingsError(f"Rows of MOMDP.{name} must be >= 0 and sum to 1.")


def check_prior(
    query: Query, prior: NDArray[np.float64], joint: NDArray[np.float64] | None
) -> None:
    """Check the prior (N,) of groups, and that it has the margins of a joint one, (Y,)."""
    for group in query.groups:
        if not np.isclose(prior[list(group)].sum(), 1.0):
            raise SettingsError(f"MOMDP.prior of a group must sum to 1, found {prior}.")
    if joint is None:
        return
    if joint.shape != (query.n_values,):
        expected = f"({query.n_values},)"
        raise SettingsError(f"MOMDP.joint has shape {joint.shape}; expected {expected}.")
    if not (joint >= 0.0).all() or not np.isclose(joint.sum(), 1.0):
        raise SettingsError("MOMDP.joint must be >= 0 and sum to 1.")
    if not np.allclose(joint @ query.values, prior, atol=1e-6):
        raise SettingsError("MOMDP.prior must be the margins of MOMDP.joint.")


def check_ranges(values: Mapping[str, NDArray[Any] | float]) -> None:
    """Check that all numbers lie in their `RANGES`."""
    for name, (least, most, expected) in RANGES.items():
        numbers = np.asarray(values[name])
        if not ((numbers >= least) & (numbers <= most)).all():
            raise SettingsError(f"MOMDP.{name} must {expected}; found {numbers}.")
