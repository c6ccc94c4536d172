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
from meal_bayes.evaluation.outcome_model import AgentEffect, compare_outcomes, plot_effects
from meal_bayes.evaluation.statistics import (
    Effect,
    Interval,
    bootstrap_interval,
    clustered,
    clustered_se,
    holm,
    paired_difference,
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
    "LearningRow",
    "LearningSummary",
    "Summary",
    "SummaryRow",
    "area_difference",
    "bootstrap_interval",
    "brier",
    "calibration_error",
    "clustered",
    "clustered_se",
    "compare",
    "compare_outcomes",
    "curves_of",
    "decided",
    "difference",
    "difference_at",
    "expected_calibration_error",
    "holm",
    "learning_rows",
    "mean",
    "mean_effect",
    "mean_until",
    "negative_log_likelihood",
    "paired_difference",
    "plot_effects",
    "pooled_ece",
    "resampled",
    "spent",
    "success_difference",
    "successes_within",
    "summarize",
    "summarize_learning",
    "wilson_interval",
]
