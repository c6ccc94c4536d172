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
    area_difference,
    curves_of,
    decided,
    difference_at,
    learning_rows,
    mean_until,
    pooled_ece,
    success_difference,
    successes_within,
    summarize_learning,
)
from meal_bayes.evaluation.statistics import (
    Interval,
    bootstrap_interval,
    clustered_se,
    paired_difference,
    wilson_interval,
)
from meal_bayes.evaluation.summary import (
    Summary,
    SummaryRow,
    compare,
    difference,
    mean,
    summarize,
)

__all__ = [
    "Interval",
    "LearningRow",
    "LearningSummary",
    "Summary",
    "SummaryRow",
    "area_difference",
    "bootstrap_interval",
    "brier",
    "calibration_error",
    "clustered_se",
    "compare",
    "curves_of",
    "decided",
    "difference",
    "difference_at",
    "expected_calibration_error",
    "learning_rows",
    "mean",
    "mean_until",
    "negative_log_likelihood",
    "paired_difference",
    "pooled_ece",
    "success_difference",
    "successes_within",
    "summarize",
    "summarize_learning",
    "wilson_interval",
]
