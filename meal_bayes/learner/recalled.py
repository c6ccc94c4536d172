"""Experience from logs: the trials of a robot, and the labels that people gave.

The functions add logged trials and labels to a learner, for example after a restart or for the next
question of the command line.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from meal_bayes.domain import Domain, with_attribute
from meal_bayes.files import lasting_path
from meal_bayes.learner import views
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.learner import Learner
from meal_bayes.learner.question import check_domain
from meal_bayes.learner.settings import check_object_names
from meal_bayes.learner.told import tell_again
from meal_bayes.look import listed
from meal_bayes.seeds import Key
from meal_bayes.trial_log import Change, Feedback, Logs
from meal_bayes.trial_log.folder import begun_text, feedback_files, readable_feedback, time_of
from meal_bayes.trials import Trial


def recall(learner: Learner, *logs: str | Path) -> list[Trial]:
    """Rebuild the experience of a learner from the logs of its trials.

    The logs contain the executed behaviors, their success, the features and percepts, and the
    labels that people gave. The learner learns from trials and labels in the order of their times.
    The learner refits at the same points as the learner that wrote the logs, so that both get
    exactly the same result. If the name of a log does not contain a time, the learner refits at the
    end instead.

    A logged change of the agent is repeated if the new agent is one of the package or known to this
    learner. A learner that began with another agent than the logged one keeps its agent. Attributes
    that were added (`Learner.add_attribute`) are added again, and trials that were forgotten with
    their recordings are forgotten again. The steps of an interrupted trial are recorded;
    `Learner.resume` can continue the trial. Afterwards the learner knows in which state the last
    trial left the robot, also if this trial was a test.

    Three kinds of trials are skipped: tests, trials that the learner has already, and trials
    without features whose percepts have other levels than those of the agent. Labels of skipped
    trials are still learned or removed, if the learner has not done so yet. A warning names damaged
    logs.

    Parameters
    ----------
    learner : Learner
        Learner that gets the experience; usually a new one with the same settings.
    logs : str or Path
        A log file or a folder of log files, or several of them.

    Returns
    -------
    trials : list[Trial]
        Trials that were added to the experience, in the order of their times.

    Raises
    ------
    LogError
        Logs cannot be read, belong to several data sets, or do not exist.
    SettingsError
        The trials belong to another domain.
    QueryError
        The names of two objects differ only in invisible ways.

    Examples
    --------
    >>> import meal_bayes
    >>> class Still:
    ...     def start(self):
    ...         return "ready"
    ...     def execute(self, behavior):
    ...         return meal_bayes.Outcome("ready")
    >>> learner = meal_bayes.Learner("toy", agent="prior", logs=None)
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     session = learner.begin("Is it red?", "a cup", log=Path(folder, "1.mcap"))
    ...     trial = meal_bayes.run_trial(session, Still())
    ...     restarted = meal_bayes.Learner("toy", agent="prior", logs=None)
    ...     len(meal_bayes.recall(restarted, folder))
    1
    """
    files = Logs(*logs)
    experience = learner.experience
    recalled = list[Trial]()
    places = dict[Key, Path]()
    names = dict[Key, str]()  # of the logs, which begin with the time
    headers = list[Mapping[str, object]]()
    seen = list[tuple[str, Trial]]()  # tests, too, leave a robot somewhere
    for group in files.begun():
        headers.append(group.header)
        for trial in group.trials:
            task = trial.task
            names[task.key] = group.file.name
            seen.append((time_of(group.file), trial))
            places[task.key] = lasting_path("The log", group.file.parent)
            if (
                task.learn
                and _is_readable(trial, learner.agent.levels)
                and (task.key not in experience.trials or views.unrecorded(experience, trial))
            ):
                recalled.append(trial)
    entries = files.told()
    domain = _domain_with(experience, entries)
    for trial in recalled:  # all of them, before one is experience
        check_domain(domain, trial)
    told = [entry for _, entry in entries if isinstance(entry, Feedback)]
    check_object_names(_names_kept(recalled, told, experience), learner.known_names)
    for time, trial in sorted(seen, key=lambda entry: entry[0]):
        learner.note_state(trial, time)
    learner.note_folders(places)
    for header in headers:
        learner.note_question(header)
    unknown = dict.fromkeys(
        name for entry in told for name in entry.labels if name not in domain.attributes
    )
    if unknown:
        warnings.warn(
            f"Labels of {listed(list(map(repr, unknown)), 5)} in the logs are left out: the domain "
            f"{domain.name!r} has no such attribute. Add it to a new learner (add_attribute) "
            "before it recalls the logs.",
            stacklevel=2,
        )
    in_time = all(map(begun_text, map(Path, names.values())))
    if not in_time:  # a trial may come before what was added before it
        for change in _additions(experience, entries):
            learner.hear_change(change, learner.agent)
    waiting = list(recalled)

    def in_order() -> Iterator[tuple[str, Feedback]]:
        """Yield feedback, after the learner has learned from all earlier trials."""
        for file, entry in entries:
            keys = [trial.task.key for trial in waiting]
            earlier = [names[key] < file for key in keys]
            count = [*earlier, False].index(False)
            if isinstance(entry, Feedback) and entry.key in keys:
                count = max(count, keys.index(entry.key) + 1)
            before = waiting[:count]
            # Later steps of a trial that was in progress are learned after this feedback.
            waiting[:count] = [trial for trial in before if trial.task.key in entry.under_way]
            for trial in before:
                learner.hear_trial(trial, entry.under_way.get(trial.task.key))
            if isinstance(entry, Feedback):
                yield file, entry
            elif file not in experience.feedback_logs:
                experience.feedback_logs[file] = None
                learner.hear_change(entry, own)

    # Learn at the same points as the learner that wrote the logs, so that refits are the same.
    with learner.hearing_changes(_unheard_changes(experience, entries)) as own:
        tell_again(experience, in_order(), None if learner.table else learner.hear_moved)
        for trial in waiting:
            learner.hear_trial(trial)
    if not in_time:  # the order is not known
        learner.hear_refit()
    faults = [fault for fault in dict.fromkeys(files.problems) if fault not in files.unfinished]
    if faults:
        more = f"; and {len(faults) - 1} more" if faults[1:] else ""
        warnings.warn(
            f"Not all logs were recalled: {faults[0]}{more}. Labels in a damaged file may have "
            f"replaced others; give them again.",
            stacklevel=2,
        )
    forgotten = {feedback.key for feedback in told if feedback.recordings}
    return [trial for trial in recalled if trial.task.key not in forgotten]


def _is_readable(trial: Trial, levels: int) -> bool:
    """Return whether a trial has percepts of this number of levels, or its features are known."""
    if trial.momdp.levels == levels:
        return True
    return all(step.sensed is not None for step in trial.steps if step.observation is not None)


def _names_kept(
    trials: Sequence[Trial], told: Sequence[Feedback], experience: Experience
) -> Iterator[str]:
    """Yield the objects of trials and labels that are not forgotten later."""
    forgotten = {entry.key for entry in told if entry.recordings}
    kept = [trial for trial in trials if trial.task.key not in forgotten]
    yield from (trial.task.object_name for trial in kept)
    keys = {None, *experience.trials, *(trial.task.key for trial in kept)}
    labels = dict[tuple[str, Key | None], dict[str, int]]()
    for entry in told:
        labels.setdefault((entry.object_name, entry.key), {}).update(entry.labels)
    for (name, key), of_key in labels.items():
        if key in keys and max(of_key.values(), default=-1) >= 0:
            yield name


def _unheard_changes(
    experience: Experience, entries: Sequence[tuple[str, Feedback | Change]]
) -> list[Change]:
    """Return the changes of the agent that the experience does not contain yet, in order."""
    heard = experience.feedback_logs
    changes = [entry for file, entry in entries if file not in heard and isinstance(entry, Change)]
    return [entry for entry in changes if not (entry.refit or entry.added)]


def _additions(
    experience: Experience, entries: Sequence[tuple[str, Feedback | Change]]
) -> list[Change]:
    """Return the additions to the domain that the experience does not contain yet, in order."""
    heard = experience.feedback_logs
    changes = (entry for file, entry in entries if file not in heard)
    return [entry for entry in changes if isinstance(entry, Change) and entry.added]


def _domain_with(
    experience: Experience, entries: Sequence[tuple[str, Feedback | Change]]
) -> Domain:
    """Return the domain with the attributes that the logs add."""
    domain = experience.domain
    for change in _additions(experience, entries):
        if not {change.added, *change.values} & {*domain.attributes}:
            domain = with_attribute(domain, change.added, change.values)
    return domain


def hear(learner: Learner, folder: Path, on_fault: Callable[[str], object]) -> int:
    """Add the logged labels of objects in a folder to a learner, or remove them.

    Parameters
    ----------
    learner : Learner
        A learner, which may have a percept table.
    folder : Path
        Folder with logs of trials and feedback; it may be missing.
    on_fault : Callable[[str], object]
        Function that is called with a message for each log that cannot be read.

    Returns
    -------
    n : int
        Number of messages in the folder.
    """
    entries = [
        (file.name, feedback)
        for file in feedback_files(folder)
        for feedback in readable_feedback([file], on_fault)
        if isinstance(feedback, Feedback)
    ]
    tell_again(learner.experience, entries)
    learner.hear_refit()
    return len(entries)
