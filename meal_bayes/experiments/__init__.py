"""Experiments: many trials of one configuration, their tasks, logs and processes."""

from meal_bayes.experiments.config import DEFAULT_AGENTS, OfflineConfig, OnlineConfig
from meal_bayes.experiments.offline import OfflineRun, askable, offline_tasks, run_offline
from meal_bayes.experiments.online import OnlineRun, run_online
from meal_bayes.experiments.units import warm_up

__all__ = [
    "DEFAULT_AGENTS", "OfflineConfig", "OfflineRun", "OnlineConfig", "OnlineRun", "askable",
    "offline_tasks", "run_offline", "run_online", "warm_up",
]  # fmt: skip
