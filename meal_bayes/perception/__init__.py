"""ACAC: recordings to percepts, percepts to confusion counts (Sect. 4).

In: `Dataset` and the training set D, or a `PerceptTable`. Out: a `Perceiver` (what a behavior
says of the queried attributes) and confusion counts (what such percepts were worth, by object).
"""

from meal_bayes.perception.confusion import table_counts
from meal_bayes.perception.feature_spaces import fit_spaces
from meal_bayes.perception.fitting import build_percept_table, fit_and_validate
from meal_bayes.perception.perceiver import Perceiver, Perception, RecordedPercepts, SampledPercepts
from meal_bayes.perception.settings import DEFAULT, PAPER, PerceptionSettings, with_classifier
from meal_bayes.perception.table_source import TableSource

__all__ = [
    "DEFAULT", "PAPER", "Perceiver", "Perception", "PerceptionSettings", "RecordedPercepts",
    "SampledPercepts", "TableSource", "build_percept_table", "fit_and_validate", "fit_spaces",
    "table_counts", "with_classifier",
]  # fmt: skip
