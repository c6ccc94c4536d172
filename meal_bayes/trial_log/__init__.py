"""The record: trials to MCAP and back, the only store.

In: `Trial`s and a header that says what the run was. Out: one file a unit of work, equal for equal
runs, readable by any MCAP tool; and from the file the equal `Trial`s, every byte checked.
"""

from meal_bayes.trial_log.follow import Follower
from meal_bayes.trial_log.logs import Logs, log_files
from meal_bayes.trial_log.marks import BatchMarks, Marks
from meal_bayes.trial_log.memory import Told, forget, read_memory, write_told
from meal_bayes.trial_log.reader import LogInfo, log_info, read_header, read_trials
from meal_bayes.trial_log.salvage import LogReport, check_log, recover_log, salvage
from meal_bayes.trial_log.schema import ACTIVE, FORMAT_VERSION
from meal_bayes.trial_log.writer import TrialWriter, write_trials

__all__ = [
    "ACTIVE",
    "FORMAT_VERSION",
    "BatchMarks",
    "Follower",
    "LogInfo",
    "LogReport",
    "Logs",
    "Marks",
    "Told",
    "TrialWriter",
    "check_log",
    "forget",
    "log_files",
    "log_info",
    "read_header",
    "read_memory",
    "read_trials",
    "recover_log",
    "salvage",
    "write_told",
    "write_trials",
]
