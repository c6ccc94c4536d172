"""Draws that ArviZ or PyMC hold, back to what agents use."""

from typing import Any

import numpy as np

from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.posterior.draws import Draws

_DIMS = ("object", "attribute", "behavior", "truth", "level")


def posterior_from(idata: Any, domain: Domain) -> ConfusionPosterior:
    """Lay a posterior out for a domain; see `ConfusionPosterior.from_idata`."""
    draws = Draws.from_idata(idata)
    try:
        observed = idata["observed_data"]["counts"].transpose(*_DIMS)
    except (KeyError, ValueError, AttributeError) as fault:
        raise DataError(
            f"The posterior comes without the percepts it was drawn from ({fault}); give "
            "to_idata the counts (object, attribute, behavior, truth, level) as observed."
        ) from None
    for name in domain.attributes:
        if name not in draws.attributes:
            raise DataError(f"The posterior: {unknown('attribute', name, draws.attributes)}")
    for name in draws.behaviors:
        if name not in domain.behavior_names:
            raise DataError(f"The domain: {unknown('behavior', name, domain.behavior_names)}")
    behaviors = [name for name in domain.behavior_names if name in draws.behaviors]
    found = observed.sel(attribute=list(domain.attributes), behavior=behaviors).values
    shape = (len(found), len(domain.attributes), len(domain.behaviors), *found.shape[3:])
    counts = np.zeros(shape, np.int64)
    counts[:, :, [domain.behavior_index(name) for name in behaviors]] = found
    shown = [
        name for name, any_ in zip(behaviors, found.any(axis=(0, 1, 3, 4)), strict=True) if any_
    ]
    return draws.select(domain.attributes, shown).posterior(counts)
