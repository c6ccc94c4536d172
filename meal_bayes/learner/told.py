"""Labels that people give to a learner: rows of its experience, and messages in its logs."""

import difflib
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import unknown
from meal_bayes.domain.words import fold
from meal_bayes.errors import LogError, SettingsError
from meal_bayes.learner import views
from meal_bayes.learner.experience import Experience, Labels, key_of_name
from meal_bayes.look import listed, warn_user
from meal_bayes.seeds import Key
from meal_bayes.trial_log.feedback import Change, Feedback
from meal_bayes.trial_log.folder import write_feedback

_SHOWN = 5  # largest number of objects that a warning names
_ALIKE = 0.8  # smallest similarity of two names of which one may be a typing error


class Telling(NamedTuple):
    """Labels that a person gives for a trial or an object, or removes.

    Attributes
    ----------
    name : str
        Name of the object.
    key : Key
        Key of the trial, or `key_of_name(name)` if the object was named.
    labels_before : Labels
        Result of `views.labels_touched` before the change.
    recordings : bool
        Whether the recordings of the trial are forgotten too.
    under_way : Mapping[Key, int]
        As in `Feedback`.
    """

    name: str
    key: Key
    labels_before: Labels
    recordings: bool
    under_way: Mapping[Key, int]

    def feedback(self, experience: Experience) -> Feedback | None:
        """Return the labels of the object that changed since then; None if none did.

        They have not been learned from yet.
        """
        after = views.labels_touched(experience, self.key, self.name)
        said = (self.labels_before[0] >= 0) | (after[0] >= 0)
        changed = np.flatnonzero(said & (after != self.labels_before).any(axis=0))
        labels = {experience.domain.attributes[p]: int(after[0, p]) for p in changed}
        if not labels and not self.recordings:
            return None
        key = None if self.key == key_of_name(self.name) else self.key
        return Feedback(self.name, labels, key, self.recordings, self.under_way)


def log_told(experience: Experience, folder: Path, entry: Feedback | Change | None) -> None:
    """Log labels or changes; those that could not be logged before are logged first.

    Raises
    ------
    LogError
        The message cannot be written, for example because the disk is full. It is kept, and logged
        together with the next one.
    """
    if entry is not None:
        experience.unlogged.append((folder, entry))
    header = {"config": {"command": "Learner.tell"}, "data": experience.domain.data}
    for log_folder, feedback in tuple(experience.unlogged):
        try:
            log = write_feedback(log_folder or folder, feedback, header=header)
        except LogError as fault:
            raise LogError(
                f"{fault} The label or change was learned, but not logged. Repair this, and call "
                f"tell() again, which logs it."
            ) from fault
        experience.feedback_logs[log.name] = None
        experience.unlogged.pop(0)


def tell_again(
    experience: Experience,
    entries: Iterable[tuple[str, Feedback]],
    on_moved: Callable[[NDArray[np.intp], bool], object] | None = None,
) -> None:
    """Add logged labels of trials and objects to an experience, or remove them.

    Parameters
    ----------
    entries : Iterable[tuple[str, Feedback]]
        Feedback with the names of its logs, in the order of time. Feedback that the experience
        already contains is repeated only if there is new feedback about the same object before it.
    on_moved : Callable[[NDArray[np.intp], bool], object] | None
        Function that is called after each change with the instances (k,) whose labels changed, and
        whether recordings were forgotten.
    """
    unheard = set[str]()  # objects with new feedback
    for file, feedback in entries:
        key = feedback.key or key_of_name(feedback.object_name)
        if feedback.key is not None and key not in experience.trials:
            continue
        if file not in experience.feedback_logs:
            unheard.add(feedback.object_name)
        if feedback.object_name not in unheard:
            continue
        experience.feedback_logs[file] = None
        domain = experience.domain  # attributes may be added on the way
        labels = experience.no_labels
        for name, label in feedback.labels.items():
            if name in domain.attributes:
                labels[domain.columns([name])] = label
        # Earlier labels of the same trial are not repeated, because they may have been replaced.
        if feedback.recordings:
            moved = experience.forget(key, recordings=True)
        elif (labels >= 0).any():
            moved = experience.add_labels(key, feedback.object_name, labels)
        elif (experience.labels_of_trial(key) >= 0).any():
            moved = experience.forget(key)
        else:
            continue
        if on_moved is not None:
            on_moved(moved, feedback.recordings)


def warn_of_typo(experience: Experience, name: str) -> None:
    """Warn of a label for an unknown name, and suggest the most similar known name.

    If the robot has not met any object yet, there is no warning, because labels may come first.
    Names that differ by a number, such as "cup 1" and "cup 2", are different on purpose.
    """
    names = [*experience.met]
    if name in names:
        return
    alike = {
        fold(other): other
        for other in names
        if re.findall(r"\d+", other) == re.findall(r"\d+", name)
    }
    near = difflib.get_close_matches(fold(name), alike, 1, _ALIKE)
    met = names and (len(experience.instances) or len(experience.executions))
    if near:
        warn_user(
            f"There is no recording of {name!r}; did you mean {alike[near[0]]!r}? It counts "
            f"as another object; forget({name!r}) removes its labels."
        )
    elif met and not _numbered_alike(name, names):
        warn_user(
            f"There is no recording of {name!r}; it counts as a new object, beside "
            f"{listed(names, _SHOWN)}. forget({name!r}) removes its labels."
        )


def _numbered_alike(name: str, names: Iterable[str]) -> bool:
    """Return whether a name differs from another by its numbers alone."""
    bare = re.sub(r"\d+", "", name)
    return bare != name and any(re.sub(r"\d+", "", other) == bare for other in names)


def nothing_told(experience: Experience, name: str, key: Key, *, recordings: bool) -> SettingsError:
    """Return the error for nothing to forget, which lists what can be forgotten."""
    what = "labels or recordings" if recordings else "labels"
    if key != key_of_name(name):
        return SettingsError(f"The trial of {name!r} has no {what}.")
    if name not in experience.met:
        return SettingsError(unknown("object", name, experience.met))
    in_trials = int((experience.labels_by_trial(experience.objects[name]) >= 0).sum())
    if not in_trials:
        return SettingsError(f"The object {name!r} has no {what}.")
    return SettingsError(
        f"The object {name!r} has no labels that were given by its name. {in_trials} of its trials "
        "have labels: forget(trial) removes those of one trial, which may come from a log, "
        "next(meal_bayes.read_trials(log))."
    )
