"""Numbers of many trials.

In: trials. Out: rows of measures (accuracy, cost, reward, calibration) with standard errors
clustered by object, and paired comparisons.
"""

from meal_bayes.evaluation.calibration import (
    brier,
    calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
)
from meal_bayes.evaluation.learning import (
    LearningRow,
    LearningSummary,
    curves_of,
    hours_to,
    learning_rows,
    pooled_ece,
    summarize_learning,
)
from meal_bayes.evaluation.statistics import (
    Interval,
    bootstrap_interval,
    clustered_se,
    paired_difference,
    wilson_interval,
)
from meal_bayes.evaluation.summary import Summary, SummaryRow, compare, mean, summarize

__all__ = [
    "Interval",
    "LearningRow",
    "LearningSummary",
    "Summary",
    "SummaryRow",
    "bootstrap_interval",
    "brier",
    "calibration_error",
    "clustered_se",
    "compare",
    "curves_of",
    "expected_calibration_error",
    "hours_to",
    "learning_rows",
    "mean",
    "negative_log_likelihood",
    "paired_difference",
    "pooled_ece",
    "summarize",
    "summarize_learning",
    "wilson_interval",
]
