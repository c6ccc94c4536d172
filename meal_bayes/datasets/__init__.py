"""Data sets: recordings and labels, the training set D, splits, percept tables, synthetic data.

The input is the public recordings (downloaded once, with verified checksums), a folder of CSV
files, or a generator. The output is a `Dataset`, `Instance`, `TrainingSet` or `PerceptTable`.
"""

from meal_bayes.datasets.csv_files import save_csv_folder
from meal_bayes.datasets.dataset import Dataset, Instance, TrainingSet, object_index
from meal_bayes.datasets.feature_checks import checked_features
from meal_bayes.datasets.percepts import PerceptTable, load_percepts, save_percepts
from meal_bayes.datasets.sources import cache_folder, fetch, load_dataset, registry, verify
from meal_bayes.datasets.synthetic import make_synthetic

__all__ = [
    "Dataset", "Instance", "PerceptTable", "TrainingSet", "cache_folder", "checked_features",
    "fetch", "load_dataset", "load_percepts", "make_synthetic", "object_index", "registry",
    "save_csv_folder", "save_percepts", "verify",
]  # fmt: skip
