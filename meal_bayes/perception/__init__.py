"""Classification of recordings into percepts, and confusion counts of percepts (Sect. 4).

The input is a `Dataset` and the training set D, or a `PerceptTable`. The output is a `Perceiver`,
which returns the percepts of a behavior for the queried attributes, and confusion counts, which
show how often such percepts were right on each object.
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
