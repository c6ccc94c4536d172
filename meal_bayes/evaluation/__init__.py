"""Statistics of many trials.

The input is trials. The output is a row of measures for each agent (accuracy, cost, reward,
calibration), with standard errors that treat objects as clusters, and paired comparisons.
"""

from meal_bayes.evaluation.calibration import (
    brier,
    calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
)
from meal_bayes.evaluation.statistics import (
    Estimate,
    Interval,
    clustered,
    paired_fractions,
    resampled,
)
from meal_bayes.evaluation.summary import (
    AnswerRates,
    Comparison,
    SummaryRow,
    answer_rates,
    compare,
    comparisons,
    difference,
    estimate_mean,
    summarize,
)

__all__ = [
    "AnswerRates",
    "Comparison",
    "Estimate",
    "Interval",
    "SummaryRow",
    "answer_rates",
    "brier",
    "calibration_error",
    "clustered",
    "compare",
    "comparisons",
    "difference",
    "estimate_mean",
    "expected_calibration_error",
    "negative_log_likelihood",
    "paired_fractions",
    "resampled",
    "summarize",
]
