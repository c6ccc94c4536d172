"""`ask`: one question about one recorded object; `recall`: experience from logs."""

from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path

from meal_bayes.datasets import PerceptTable, load_percepts
from meal_bayes.learner import views
from meal_bayes.learner.columns import told
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.learner import Learner
from meal_bayes.trial_log import Feedback, Logs
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
    logs: str | Path | None = "logs",
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
    """
    table = dataset if isinstance(dataset, PerceptTable) else load_percepts(dataset)
    learner = Learner(
        table.domain, agent=agent, seed=seed, reward=reward, percepts=percepts, logs=logs
    ).fit(table)
    return learner.ask(question, object, answer=answer, payoffs=payoffs, on_step=on_step, log=log)


def recall(learner: Learner, *logs: str | Path) -> list[Trial]:
    """Rebuild the experience of a learner from the logs of its robot's trials.

    What was executed, whether it succeeded, what the robot sensed, and the labels that people told
    of it are in the logs. Trials that the learner has had to their end, tests, and trials with
    other levels than its agent's are passed over, but for what people have told of them, or taken
    back, since. A replay shows recordings of its object that the learner was given, if it was.

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
    """
    files = Logs(*logs)
    experience = learner.experience
    recalled = list[Trial]()
    told_of = dict[Path, list[Feedback]]()  # trials of a folder
    for group in files.groups():
        told_of[group.file.parent] = files.feedback_in(group.file.parent).entries
        for trial in group.trials:
            task = trial.task
            fits = trial.momdp.levels == learner.agent.levels
            if (
                task.learn
                and fits
                and (task.key not in experience.trials or views.unrecorded(experience, trial))
            ):
                recalled.append(trial)
    for trial in recalled:
        learner.record(trial)
    for feedback in chain.from_iterable(told_of.values()):
        _tell_again(experience, feedback)
    learner.refit()
    return recalled


def _tell_again(experience: Experience, feedback: Feedback) -> None:
    """Let what was told, or taken back, of a trial that is known or of an object hold again.

    In the order of all that was told this ends with the same labels, whatever was known before.
    """
    key = feedback.key or told(feedback.object_name)
    if feedback.key is not None and key not in experience.trials:
        return
    labels = experience.nothing
    for name, label in feedback.labels.items():
        if name in experience.domain.attributes:
            labels[experience.domain.columns([name])] = label
    # What was told before in the same trial is not told again: it may have been replaced since.
    if (labels >= 0).any():
        experience.label(key, feedback.object_name, labels)
    elif (experience.told_in(key) >= 0).any():
        experience.forget(key)
