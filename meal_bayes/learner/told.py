"""What people tell a learner: a row of its experience, and a message in the folder of its logs.

A learner that is built again, from logs or for the next question of the command line, hears what
the logs say.
"""

import difflib
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from meal_bayes.domain import unknown
from meal_bayes.errors import LogError, SettingsError
from meal_bayes.files import lasting_path
from meal_bayes.learner import views
from meal_bayes.learner.columns import Labels, key_of_name
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.recording import check_domain
from meal_bayes.look import warn_user
from meal_bayes.seeds import Key
from meal_bayes.trial_log import Logs
from meal_bayes.trial_log.feedback import Feedback
from meal_bayes.trial_log.names import feedback_files
from meal_bayes.trial_log.reader import readable_feedback
from meal_bayes.trial_log.writer import write_feedback
from meal_bayes.trials import Trial

if TYPE_CHECKING:
    from meal_bayes.learner.learner import Learner

_ALIKE = 0.8  # of two names, at least where one may be meant by the other


class Telling(NamedTuple):
    """What is told of a trial, or of an object by its name, or taken back.

    Attributes
    ----------
    name : str
        Of the object.
    key : Key
        Of the trial; `key_of_name(name)` where the object was named.
    labels_before : Labels
        What `views.labels_touched` was before.
    recordings : bool
        Whether what the trial recorded is forgotten, too.
    """

    name: str
    key: Key
    labels_before: Labels
    recordings: bool = False


def log_told(experience: Experience, folder: Path, telling: Telling) -> None:
    """Log the labels that moved any of their object, and whether recordings were forgotten.

    What could not be logged before is logged first.

    Raises
    ------
    LogError
        A full disk, for example; what was told is kept, and logged with what is told next.
    """
    name, key, before, recordings = telling
    after = views.labels_touched(experience, key, name)
    said = (before[0] >= 0) | (after[0] >= 0)
    changed = np.flatnonzero(said & (after != before).any(axis=0))
    domain = experience.domain
    labels = {domain.attributes[p]: int(after[0, p]) for p in changed}
    if labels or recordings:
        feedback = Feedback(name, labels, None if key == key_of_name(name) else key, recordings)
        experience.unlogged.append((folder, feedback))
    header = {"config": {"command": "Learner.tell"}, "data": domain.data}
    for log_folder, feedback in tuple(experience.unlogged):
        try:
            log = write_feedback(log_folder, feedback, header=header)
        except LogError as fault:
            raise LogError(
                f"{fault} What was told is learned; mend this, and it is logged when anything is "
                "told, also the same again."
            ) from fault
        experience.feedback_logs[log.name] = None
        experience.unlogged.pop(0)


def tell_again(experience: Experience, entries: Iterable[tuple[str, Feedback]]) -> None:
    """Let an experience hold what was told, or taken back, of trials that it has and of objects.

    Parameters
    ----------
    entries : Iterable[tuple[str, Feedback]]
        With the names of their logs, in the order in which they were told. What was heard before
        is told again only behind what others had told of its object before and is heard now: other
        things may have been told since.
    """
    domain = experience.domain
    unheard = set[str]()  # objects of which something is told that was not heard yet
    for file, feedback in entries:
        key = feedback.key or key_of_name(feedback.object_name)
        if feedback.key is not None and key not in experience.trials:
            continue
        if file not in experience.feedback_logs:
            unheard.add(feedback.object_name)
        if feedback.object_name not in unheard:
            continue
        experience.feedback_logs[file] = None
        labels = experience.no_labels
        for name, label in feedback.labels.items():
            if name in domain.attributes:
                labels[domain.columns([name])] = label
        # What was told before in the same trial is not told again: it may have been replaced.
        if feedback.recordings:
            experience.forget(key, recordings=True)
        elif (labels >= 0).any():
            experience.add_labels(key, feedback.object_name, labels)
        elif (experience.labels_of_trial(key) >= 0).any():
            experience.forget(key)


def recall(learner: "Learner", *logs: str | Path) -> list[Trial]:
    """Rebuild the experience of a learner from the logs of its robot's trials.

    What was executed, whether it succeeded, what the robot sensed, and the labels that people told
    of it are in the logs; a trial that was forgotten with its recordings is so again. One that was
    broken off, or is under way, is learned from as far as it went, and later to its end; where it
    is to go on, `resume` it first, as its agent would decide by what it has learned. Trials that
    the learner has had to their end, tests, and trials with other levels than its agent's are
    passed over, but for what people have told of them, or taken back, since: in the order in which
    it was told, whatever the order of the folders. What the learner has told or recalled before is
    not told again. A replay shows recordings of its object that the learner was given, if it was.
    What is damaged is named in a warning.

    Parameters
    ----------
    logs : str or Path
        Files, or folders of them.

    Returns
    -------
    trials : list[Trial]
        That are experience now, in their order.

    Raises
    ------
    LogError
        Logs that cannot be read, or of several data sets; none that is named.
    SettingsError
        Trials of another domain.

    Examples
    --------
    >>> import meal_bayes
    >>> class Still:
    ...     def start(self):
    ...         return "ready"
    ...     def execute(self, behavior):
    ...         return meal_bayes.Outcome("ready")
    >>> learner = meal_bayes.Learner("toy", agent="greedy", logs=None)
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     session = learner.begin("Is it red?", "a cup", log=Path(folder, "1.mcap"))
    ...     trial = meal_bayes.run_trial(session, Still())
    ...     restarted = meal_bayes.Learner("toy", agent="greedy", logs=None)
    ...     len(meal_bayes.recall(restarted, folder))
    1
    """
    files = Logs(*logs)
    experience = learner.experience
    recalled = list[Trial]()
    places = dict[Key, Path]()
    headers = list[Mapping[str, object]]()
    for group in files.begun():
        headers.append(group.header)
        for trial in group.trials:
            task = trial.task
            places[task.key] = lasting_path("The log", group.file.parent)
            fits = trial.momdp.levels == learner.agent.levels
            if (
                task.learn
                and fits
                and (task.key not in experience.trials or views.unrecorded(experience, trial))
            ):
                recalled.append(trial)
    for trial in recalled:  # all of them, before one is experience
        check_domain(experience, trial)
    for trial in recalled:
        learner.record(trial)
    learner.note_folders(places)
    for header in headers:
        learner.note_question(header)
    entries = files.told()
    tell_again(experience, entries)
    learner.refit()
    faults = [fault for fault in dict.fromkeys(files.problems) if fault not in files.unfinished]
    if faults:
        more = f"; and {len(faults) - 1} more" if faults[1:] else ""
        warnings.warn(
            f"Not all of the logs was recalled: {faults[0]}{more}. Labels in a file that is "
            "damaged may have replaced others; tell them again.",
            stacklevel=2,
        )
    forgotten = {feedback.key for _, feedback in entries if feedback.recordings}
    return [trial for trial in recalled if trial.task.key not in forgotten]


def hear(learner: "Learner", folder: Path, on_fault: Callable[[str], object]) -> int:
    """Let a learner hear what the logs of a folder say of objects by their names, or take back.

    Parameters
    ----------
    learner : Learner
        It may replay a percept table.
    folder : Path
        Folder of the logs of trials, beside which feedback lies; it may be missing.
    on_fault : Callable[[str], object]
        Called with what is wrong with each log that cannot be read.

    Returns
    -------
    n : int
        Number of messages in the folder.
    """
    entries = [
        (file.name, feedback)
        for file in feedback_files(folder)
        for feedback in readable_feedback([file], on_fault)
    ]
    tell_again(learner.experience, entries)
    learner.refit()
    return len(entries)


def warn_of_typo(experience: Experience, name: str) -> None:
    """Warn of a name that no object has, where one that is met looks much like it."""
    names = [*experience.met]
    # Names that are told apart by a number, as "cup 1" and "cup 2", are meant so.
    alike = [other for other in names if re.findall(r"\d+", other) == re.findall(r"\d+", name)]
    near = difflib.get_close_matches(name, alike, 1, _ALIKE)
    if name not in names and near:
        warn_user(
            f"There is no trial or recording of {name!r}; did you mean {near[0]!r}? It is taken "
            f"for another object; forget({name!r}) takes its labels back."
        )


def nothing_told(experience: Experience, name: str, key: Key, *, recordings: bool) -> SettingsError:
    """Return what is raised where there is nothing to forget, with what there is."""
    what = "labels or recordings" if recordings else "labels"
    if key != key_of_name(name):
        return SettingsError(f"The trial of {name!r} has no {what}.")
    if name not in experience.met:
        return SettingsError(unknown("object", name, experience.met))
    in_trials = int((experience.labels_by_trial(experience.objects[name]) >= 0).sum())
    if not in_trials:
        return SettingsError(f"The object {name!r} has no {what}.")
    return SettingsError(
        f"The object {name!r} has no labels that were told by its name. Of its trials {in_trials} "
        "were told: forget(trial) takes those of one back, also of a trial from its log, "
        "next(meal_bayes.read_trials(log))."
    )
