"""`ask`: one question about one recorded object; `recall`: experience from logs."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from meal_bayes.datasets import PerceptTable, load_percepts
from meal_bayes.files import LOGS, lasting_path
from meal_bayes.learner import views
from meal_bayes.learner.learner import Learner
from meal_bayes.learner.recording import check_domain
from meal_bayes.learner.telling import tell_again
from meal_bayes.seeds import Key
from meal_bayes.trial_log import Logs
from meal_bayes.trials import Step, Trial


def ask(
    question: str | Sequence[str],
    *,
    dataset: str | Path | PerceptTable,
    object: str,
    agent: object = "bayes",
    answer: str = "values",
    payoffs: Sequence[float] | None = None,
    seed: int = 0,
    percepts: str = "recorded",
    reward: float | None = None,
    on_step: Callable[[Step], None] | None = None,
    log: str | Path | None = None,
    logs: str | Path | None = LOGS,
) -> Trial:
    """Answer a question about an object that was left out of everything the agent learned.

    Equal arguments give equal trials.

    Parameters
    ----------
    question : str | Sequence[str]
        A sentence ("Is it heavy?"), a comma list, or a list of attribute names.
    dataset : str | Path | PerceptTable
        A shipped data set (roc36, ispy32, cy101), the path of an .npz of one's own made by
        `save_percepts`, or a percept table.
    object : str
        The object's name.
    agent : object
        A name, an `Agent`, or a planner: see `meal_bayes.agents.as_agent`.
    answer, payoffs : str, Sequence[float] | None
        "values" or "yes or no", and what yes and no earn: as of `Learner.ask`.
    seed : int
        Of failures, of the recordings' order, and of planning.
    percepts : str
        "recorded", or "model": drawn from the learned confusion matrices.
    reward : float | None
        r+ = -r-, the domain's by default.
    on_step : Callable[[Step], None] | None
        Called after every step.
    log : str | Path | None
        Path of the trial's log (.mcap); one in the folder of logs by default.
    logs : str | Path | None
        Folder of logs; None logs nothing, unless `log` names a path.

    Raises
    ------
    SettingsError
        An unknown data set, object or agent.
    QueryError
        A question that names no attribute, an unknown one, or one twice.

    Examples
    --------
    >>> import meal_bayes
    >>> trial = meal_bayes.ask(
    ... "heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", logs=None
    ... )
    >>> trial.report, trial.success
    (array([ True]), True)
    """
    table = dataset if isinstance(dataset, PerceptTable) else load_percepts(dataset)
    learner = Learner(
        table.domain, agent=agent, seed=seed, reward=reward, percepts=percepts, logs=logs
    ).fit(table)
    return learner.ask(question, object, answer=answer, payoffs=payoffs, on_step=on_step, log=log)


def recall(learner: Learner, *logs: str | Path) -> list[Trial]:
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
