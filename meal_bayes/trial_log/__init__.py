"""Logs: write trials to MCAP files and read them back.

This package writes trials, with a header that describes the run, into one file for each unit of
work. Equal trials give equal files, and any MCAP tool can read them. Reading checks every byte and
returns trials that equal those that were written. For millions of trials, a compact log contains
their outcomes as columns, and the steps of some of them.
"""

from meal_bayes.trial_log.feedback import Change, Feedback
from meal_bayes.trial_log.file import (
    ACTIVE,
    LogInfo,
    TrialWriter,
    check_log,
    log_info,
    read_header,
    read_outcomes,
    read_seconds,
    recover_log,
    remove_drafts,
    salvage,
    write_trials,
)
from meal_bayes.trial_log.folder import (
    Follower,
    Group,
    Logs,
    log_files,
    read_feedback,
    read_trials,
    write_feedback,
)
from meal_bayes.trial_log.messages import FORMAT_VERSION

__all__ = [
    "ACTIVE", "FORMAT_VERSION", "Change", "Feedback", "Follower", "Group", "LogInfo", "Logs",
    "TrialWriter", "check_log", "log_files", "log_info", "read_feedback", "read_header",
    "read_outcomes", "read_seconds", "read_trials", "recover_log", "remove_drafts", "salvage",
    "write_feedback", "write_trials",
]  # fmt: skip
