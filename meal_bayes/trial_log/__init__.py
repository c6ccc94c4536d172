"""The record: trials to MCAP and back, the only store.

In: `Trial`s and a header that describes the run. Out: one file a unit of work, equal for equal
trials, readable by any MCAP tool; and from the file the equal `Trial`s, every byte checked. Where
there are millions of trials, a compact log holds their outcomes alone, as columns.
"""

from meal_bayes.trial_log.feedback import Feedback
from meal_bayes.trial_log.logs import Follower, Group, Logs
from meal_bayes.trial_log.names import log_files, remove_drafts
from meal_bayes.trial_log.reader import (
    LogInfo,
    check_log,
    log_info,
    read_feedback,
    read_header,
    read_outcomes,
    read_trials,
    recover_log,
    salvage,
)
from meal_bayes.trial_log.schema import ACTIVE, FORMAT_VERSION
from meal_bayes.trial_log.writer import TrialWriter, read_seconds, write_trials

__all__ = [
    "ACTIVE", "FORMAT_VERSION", "Feedback", "Follower", "Group", "LogInfo", "Logs", "TrialWriter",
    "check_log", "log_files", "log_info", "read_feedback", "read_header", "read_outcomes",
    "read_seconds", "read_trials", "recover_log", "remove_drafts", "salvage",
    "write_trials",
]  # fmt: skip
