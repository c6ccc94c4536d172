"""Trials: tasks, sessions that run them, and their outcomes, pictures and texts.

The input is a MOMDP, a policy, a robot and a perceiver. The output is a `Trial` with every belief
and decision.
"""

from meal_bayes.trials.faults import FaultTolerant
from meal_bayes.trials.outcomes import BatchOutcomes, TrialOutcomes, Trials, task_key
from meal_bayes.trials.record import Step, Task, TrialRecord, truth_of
from meal_bayes.trials.session import Recorder, Session, run_trial
from meal_bayes.trials.text import percept_labels, trials_frame, truth_text
from meal_bayes.trials.trial import Trial

__all__ = [
    "BatchOutcomes", "FaultTolerant", "Recorder", "Session", "Step", "Task", "Trial",
    "TrialOutcomes", "TrialRecord", "Trials", "percept_labels", "run_trial", "task_key",
    "trials_frame", "truth_of", "truth_text",
]  # fmt: skip
