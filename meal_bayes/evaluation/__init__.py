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
from meal_bayes.evaluation.outcome_model import compare_outcomes
from meal_bayes.evaluation.statistics import (
    Estimate,
    Interval,
    clustered,
    paired_fractions,
    resampled,
)
from meal_bayes.evaluation.summary import (
    AnswerRates,
    SummaryRow,
    answer_rates,
    compare,
    difference,
    estimate_mean,
    summarize,
)

__all__ = [
    "AnswerRates",
    "Estimate",
    "Interval",
    "SummaryRow",
    "answer_rates",
    "brier",
    "calibration_error",
    "clustered",
    "compare",
    "compare_outcomes",
    "difference",
    "estimate_mean",
    "expected_calibration_error",
    "negative_log_likelihood",
    "paired_fractions",
    "resampled",
    "summarize",
]
