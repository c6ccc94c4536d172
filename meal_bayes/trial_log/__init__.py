"""The record: trials to MCAP and back, the only store.

In: `Trial`s and a header that describes the run. Out: one file a unit of work, equal for equal
trials, readable by any MCAP tool; and from the file the equal `Trial`s, every byte checked. Where
there are millions of trials, a compact log holds their outcomes as columns, and steps of some.
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
