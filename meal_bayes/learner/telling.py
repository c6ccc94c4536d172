"""What people tell a learner, in logs: written once it is told, and told again from there."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from meal_bayes.learner import views
from meal_bayes.learner.columns import Labels, told
from meal_bayes.learner.experience import Experience
from meal_bayes.seeds import Key
from meal_bayes.trial_log.feedback import Feedback
from meal_bayes.trial_log.writer import write_feedback


def log_told(experience: Experience, folder: Path, name: str, key: Key, before: Labels) -> None:
    """Log the labels of a trial, or of an object by its name, that moved any of its object.

    Parameters
    ----------
    before : Labels
        What `views.labels_touched` was before it was told.
    """
    after = views.labels_touched(experience, key, name)
    said = (before[0] >= 0) | (after[0] >= 0)
    changed = np.flatnonzero(said & (after != before).any(axis=0))
    if not len(changed):
        return
    domain = experience.domain
    labels = {domain.attributes[p]: int(after[0, p]) for p in changed}
    feedback = Feedback(name, labels, None if key == told(name) else key)
    header = {"config": {"command": "Learner.tell"}, "data": domain.data}
    experience.heard[write_feedback(folder, feedback, header=header).name] = None


def tell_again(experience: Experience, entries: Iterable[tuple[str, Feedback]]) -> None:
    """Let an experience hold what was told, or taken back, of trials that it has and of objects.

    Parameters
    ----------
    entries : Iterable[tuple[str, Feedback]]
        With the names of their logs, in the order in which they were told. What was heard before
        is not told again: other things may have been told since.
    """
    domain = experience.domain
    for file, feedback in entries:
        key = feedback.key or told(feedback.object_name)
        unknown = feedback.key is not None and key not in experience.trials
        if unknown or file in experience.heard:
            continue
        experience.heard[file] = None
        labels = experience.nothing
        for name, label in feedback.labels.items():
            if name in domain.attributes:
                labels[domain.columns([name])] = label
        # What was told before in the same trial is not told again: it may have been replaced.
        if (labels >= 0).any():
            experience.label(key, feedback.object_name, labels)
        elif (experience.told_in(key) >= 0).any():
            experience.forget(key)
