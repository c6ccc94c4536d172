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
    LearningSummary,
    decided,
    learning_rows,
    summarize_learning,
)
from meal_bayes.evaluation.outcome_model import AgentEffect, compare_outcomes, plot_effects
from meal_bayes.evaluation.statistics import (
    Effect,
    Interval,
    bootstrap_interval,
    clustered,
    holm,
    resampled,
    spent,
    wilson_interval,
)
from meal_bayes.evaluation.summary import (
    Summary,
    SummaryRow,
    compare,
    difference,
    mean,
    mean_effect,
    summarize,
)

__all__ = [
    "AgentEffect",
    "Effect",
    "Interval",
    "LearningSummary",
    "Summary",
    "SummaryRow",
    "bootstrap_interval",
    "brier",
    "calibration_error",
    "clustered",
    "compare",
    "compare_outcomes",
    "decided",
    "difference",
    "expected_calibration_error",
    "holm",
    "learning_rows",
    "mean",
    "mean_effect",
    "negative_log_likelihood",
    "plot_effects",
    "resampled",
    "spent",
    "summarize",
    "summarize_learning",
    "wilson_interval",
]
