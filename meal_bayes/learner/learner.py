"""The `Learner`: an agent and its experience; asked questions, updated by feedback, and saved."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any, Self

from meal_bayes.agents import as_agent
from meal_bayes.datasets import Dataset, PerceptTable, object_index
from meal_bayes.domain import Domain, Query, load_domain
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.files import LOGS, checked_path, file_name
from meal_bayes.learner import views
from meal_bayes.learner.answering import Answerer
from meal_bayes.learner.card import JoinedRecordings, learned_html, next_html, table_knowledge
from meal_bayes.learner.columns import key_of_name
from meal_bayes.learner.find import Found, checked_objects, prior_of_yes, read_claim
from meal_bayes.learner.fit import problem_of
from meal_bayes.learner.fit_cache import FitCache
from meal_bayes.learner.recording import check_domain, record_steps
from meal_bayes.learner.saved import SavedLearner, read_learner, write_learner
from meal_bayes.learner.settings import (
    REFIT_EVERY,
    LearnerSettings,
    check_data,
    check_object_name,
    checked_labels,
    settings_of,
)
from meal_bayes.learner.telling import Telling, log_told, nothing_told, warn_of_typo
from meal_bayes.learner.trial import TrialOptions
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.robots import Robot
from meal_bayes.seeds import Key
from meal_bayes.trial_log.file import SUFFIX
from meal_bayes.trials import Step, Trial


class Learner(Answerer):
    """Answers questions about objects, and learns from what it does and is told.

    It works with any robot, from nothing or from recordings; with a percept table it replays its
    objects, each left out of what was learned.

    Parameters
    ----------
    domain : str, path, mapping or Domain
        A shipped domain, the path of a TOML file, its table, or a domain.
    agent : str | Agent | Solver
        Who decides: see `meal_bayes.agents.as_agent`.
    seed : int
        Of planning, and of what is drawn in replays.
    classifier : object
        Of scikit-learn, in place of ours: see `meal_bayes.perception.with_classifier`.
    posterior : str, Path, InferenceData, DataTree or ConfusionPosterior, optional
        Of the confusion matrices, learned elsewhere (see `posterior.reading.posterior_from`)
        without the objects that are asked about, in place of the one that `fit` would learn.
    reward : float, optional
        r+ = -r- of a report; the domain's by default.
    payoffs : Sequence[float], optional
        Four: what a right yes, a wrong yes, a right no and a wrong no earn in questions of yes or
        no that do not say it; the domain's by default.
    percepts : str
        In replays: "recorded", or "model", drawn from the learned confusion matrices.
    refit_every : float, optional
        Refit once labeled instances have grown by such a fraction; None: only by `refit`.
    learn_success : bool
        Learn how often behaviors succeed, at every refit, or take it from the domain.
    horizon : float, optional
        Questions to come, for which exploring is valued; by default as many as were asked so far in
        trials that taught it, and 20 more.
    logs : str or path, optional
        Folder of the logs of trials with a robot; None logs nothing.
    settings : LearnerSettings, optional
        All of these but agent and logs, and rarer ones, in one value; then none of them is given
        by name.

    Examples
    --------
    >>> from meal_bayes import Learner, load_percepts
    >>> learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    >>> trial = learner.ask("Is it heavy?", "heavy_blue_beans")
    >>> trial.task.query.report_name(trial.report), trial.success
    ('heavy', True)
    """

    def __init__(
        self,
        domain: str | Path | Mapping[str, Any] | Domain,
        *,
        agent: object = "bayes",
        classifier: object = None,
        posterior: object = None,
        seed: int = 0,
        reward: float | None = None,
        payoffs: Sequence[float] | None = None,
        percepts: str = "recorded",
        refit_every: float | None = REFIT_EVERY,
        learn_success: bool = True,
        horizon: float | None = None,
        logs: str | Path | None = LOGS,
        settings: LearnerSettings | None = None,
    ) -> None:
        domain = load_domain(domain)
        chosen = as_agent(agent)
        by_name = {
            "seed": seed,
            "horizon": horizon,
            "refit_every": refit_every,
            "learn_success": learn_success,
            "reward": reward,
            "percepts": percepts,
            "classifier": classifier,
            "payoffs": payoffs,
            "posterior": posterior,
        }
        settings = settings_of(settings, by_name, domain, chosen)
        super().__init__(domain, chosen, settings, logs)
        self._joined = JoinedRecordings()
        self._file = ""  # id of the file that was read or written last

    def __repr__(self) -> str:
        data = "a percept table"
        if self.table is None:
            data = f"{self.experience!r}{self._joined.text(self.experience)}"
        return f"Learner({self.domain.name}, agent {self.agent.name}, {data})"

    def _repr_html_(self) -> str:
        """Return what was learned of each attribute, or what to do next, as HTML."""
        head = f"<p>{escape(repr(self))}</p>"
        table = None if self.table is None else views.labeled_table(self.experience, self.table)
        labels = self.experience.object_labels.values if table is None else table.labels
        if not (labels >= 0).any():
            return head + next_html(self.domain.attributes[0], len(self.experience.instances))
        if table is None:
            return head + learned_html(self.knowledge(), labels)
        knowledge = table_knowledge(table, self.agent, self.settings)
        return f"{head}{learned_html(knowledge, labels)}"

    def find(
        self,
        question: str | Sequence[str] | Query,
        objects: Sequence[str] | Mapping[str, Robot],
        *,
        truth: Mapping[str, Mapping[str, bool]] | None = None,
        payoffs: Sequence[float] | None = None,
        learn: bool = True,
        log: str | Path | None = None,
        max_steps: int = MAX_STEPS,
        max_cost: float | None = None,
        on_step: Callable[[Step], None] | None = None,
    ) -> Found:
        """Ask about one object after another, the most probable first, until one answer is yes.

        Each question is an ordinary trial, with a log of its own. Where one arm handles all
        objects, `start` of each robot puts down what the arm holds and turns to its object; the
        trial begins in the state that it returns.

        Parameters
        ----------
        question : str | Sequence[str] | Query
            A question of yes or no about each object ("Which one is full and red?").
        objects : Sequence[str] | Mapping[str, Robot]
            Names of objects of the percept table, which are replayed; or the robot of each object
            by the object's name. Nothing is learned from the labels of the named objects of a
            table.
        truth : mapping, optional
            {object: {attribute: True or False}} of what is known; compared with the answers only.
        payoffs : Sequence[float], optional
            Four numbers, as for `ask`; by default a yes earns what it does in other questions, and
            "no" earns 0.
        learn, max_steps, max_cost, on_step : Any
            As for `ask`, of each trial.
        log : str or Path, optional
            Folder of the logs of the trials, numbered in their order; a new one in the folder of
            logs by default.

        Returns
        -------
        found : Found
            The object, how probable it is, the total cost, and the trials.

        Raises
        ------
        QueryError
            A question that cannot be understood, or payoffs that are none.
        SettingsError
            No objects, or one twice; no data of the kind that the robots need.
        RobotError
            A robot came to a state that it cannot be in.

        Examples
        --------
        >>> from meal_bayes import Learner, load_percepts
        >>> learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
        >>> boxes = ["light_blue_beans", "medium_brown_rice", "heavy_green_glass"]
        >>> learner.find("Which one is heavy?", boxes).object_name
        'heavy_green_glass'
        """
        robots = checked_objects(objects)
        query = read_claim(question, self.domain, payoffs, self.settings)
        folder = self._logs.folder_of_find(log)
        options = TrialOptions(learn=learn, max_steps=max_steps, max_cost=max_cost, on_step=on_step)
        if self.table is not None:
            options = replace(
                options, beside=tuple(object_index(self.table.objects, name) for name in robots)
            )
        prior = dict[str, float]()
        for name in robots:
            task = self.task(query, name)
            with self._lock:
                prior[name] = prior_of_yes(
                    problem_of(self._fit(task, learn=False, beside=options.beside), task)
                )
        trials = dict[str, Trial]()
        for name in sorted(robots, key=lambda name: -prior[name]):
            trials[name] = self._ask(
                query,
                robots[name],
                name,
                replace(options, truth=(truth or {}).get(name)),
                key=None,
                log=folder and folder / f"{len(trials) + 1:02d}-{file_name(name)}{SUFFIX}",
            )
            report = trials[name].report
            if report is not None and report[0]:
                return Found(name, trials)
        return Found(None, trials)

    def fit(self, data: Dataset | PerceptTable) -> Self:
        """Learn from recordings, which join the experience, or replay a percept table.

        Raises
        ------
        SettingsError
            Data of another domain.
        DataError
            Features of another size than those that were learned from.
        """
        check_data(data, self.domain)
        with self._lock:
            self.table = data if isinstance(data, PerceptTable) else None
            if isinstance(data, Dataset):
                joined = self.experience.add_dataset(data)
                offered = int(data.recording_counts[:, data.domain.recorded].sum())
                self._joined = JoinedRecordings(joined, offered, views.rows(self.experience))
            return self.refit()

    def refit(self) -> Self:
        """Learn everything anew from the experience."""
        with self._lock:
            self._fits.clear()
            if self.table is None:
                self._fits.of(self.agent)
                self.agent.warm_up(self.domain, Query(self.domain.attributes[:1]))
        return self

    def tell(self, trial: Trial | str, values: Mapping[str, bool | None]) -> None:
        """Learn from labels of a trial's object; the posterior is updated at once.

        How much objects differ, and how their percepts err together, hold until the next refit.
        Labels are logged, as far as trials are: of a trial beside its log.

        Parameters
        ----------
        trial : Trial or str
            An answer (of another learner's the percepts are learned from), or an object's name.
        values : mapping
            True, False or None by attribute, asked or not. In one trial, or by name, a later label
            replaces an earlier one; other trials contradict it, and of the object the latest holds.

        Raises
        ------
        QueryError
            An attribute that the domain does not have, or what cannot be an object's name.
        SettingsError
            A value that is no label; a trial with other levels than the agent's.
        """
        labels = checked_labels(values, self.domain)
        if not (labels >= 0).any():
            return
        name = trial.task.object_name if isinstance(trial, Trial) else trial
        check_object_name(name, self.experience.met)
        with self._lock:
            if isinstance(trial, str) and self.table is None:
                warn_of_typo(self.experience, name)
            # A test is no experience: what is told of it is told of its object by name.
            key = key_of_name(name)
            if isinstance(trial, Trial) and trial.task.learn:
                key = trial.task.key
            if self.table is not None:
                object_index(self.table.objects, name)
            elif isinstance(trial, Trial) and key != key_of_name(name):
                new = views.unrecorded(self.experience, trial)
                perceived = any(step.observation is not None for step in new)
                if perceived and trial.momdp.levels != self.agent.levels:
                    raise SettingsError("The trial has other levels; give one of this learner's.")
                self.record(trial)
            try:
                self.domain.replace(views.labels_for(self.experience, [name])[0], labels)
            except QueryError as fault:
                raise QueryError(f"Then {name!r} would be {fault}.") from None
            self._fit_agents()
            before = views.labels_touched(self.experience, key, name)
            self._fits.update(self.experience.add_labels(key, name, labels), refit=True)
            self._log_told(trial, Telling(name, key, before))

    def forget(self, trial: Trial | str, *, recordings: bool = False) -> None:
        """Forget the labels of a trial; refit without them if the last refit has used them.

        Parameters
        ----------
        trial : Trial or str
            Or the name of an object: labels that were told of it by name, as those of data are.
        recordings : bool
            Forget what the trial recorded, and what failed, too; then all is learned anew, as if it
            had never been.

        Raises
        ------
        SettingsError
            There is nothing to forget.
        """
        name = trial if isinstance(trial, str) else trial.task.object_name
        key = (
            key_of_name(name) if isinstance(trial, str) or not trial.task.learn else trial.task.key
        )
        with self._lock:
            whole = recordings and views.has_taught(self.experience, key)
            if not whole and not (self.experience.labels_of_trial(key) >= 0).any():
                raise nothing_told(self.experience, name, key, recordings=recordings)
            self._fit_agents()
            before = views.labels_touched(self.experience, key, name)
            moved = self.experience.forget(key, recordings=whole)
            self._fits.update(moved, refit=True, anew=whole)
            self._log_told(trial, Telling(name, key, before, whole))

    def note_folders(self, folders: Mapping[Key, Path]) -> None:
        """Note in which folders the logs of trials lie: beside them labels are logged."""
        if self._logs.log_path(None) is not None:
            self._logs.note(folders)

    def _log_told(self, trial: Trial | str, telling: Telling) -> None:
        """Log what was told, beside the log of its trial where that can be written."""
        folder = self._logs.told_folder(trial)
        if folder is not None:
            log_told(self.experience, folder, telling)

    def record(self, trial: Trial) -> None:
        """Record a trial of another learner's, or of a log, as experience.

        What its steps sensed is perceived by this learner's classifiers; of steps that do not say
        it, percepts are those of the attributes asked. Steps that are recorded already are not
        recorded again. Labels can be told of it.

        Parameters
        ----------
        trial : Trial
            Of the same behaviors.

        Raises
        ------
        SettingsError
            A trial of other behaviors.
        """
        check_domain(self.experience, trial)
        with self._lock:
            self._fit_agents()
            self.experience.trial_number(trial.task.key)
            record_steps(self.experience, trial, views.unrecorded(self.experience, trial))

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write everything into one file, for `load`; the file is there whole or not at all.

        Parameters
        ----------
        path : str or Path
            Of a new file, or the one that this learner read or wrote last.
        overwrite : bool
            Write over any other file, too.

        Raises
        ------
        OutputError
            A file that somebody else wrote; a place where nothing can be written.
        """
        target = checked_path("The file", path)
        with self._lock:
            self._file = write_learner(self._saved(), target, overwrite=overwrite)

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        agent: object = None,
        classifier: object = None,
        logs: str | Path | None = LOGS,
    ) -> Self:
        """Read a learner from a file; only classifiers of one's own are fitted again.

        Parameters
        ----------
        path : str or Path
            Of a file that `save` wrote.
        agent, classifier : object, optional
            One's own are given again; shipped agents are found by name.
        logs : str or Path, optional
            Folder of the logs to come, and of those where `resume` looks. The file does not keep
            it, as it may be loaded on another machine; labels of a trial of before are logged
            beside its log once `recall(learner, folder)` has seen that.

        Raises
        ------
        DataError
            A file that is not a learner, is torn, or of another version.
        SettingsError
            An agent or a classifier of one's own is not given again.
        """
        saved = read_learner(checked_path("The file", path), agent=agent, classifier=classifier)
        domain = saved.experience.domain
        learner = cls(domain, agent=saved.agent, settings=saved.settings, logs=logs)
        learner.experience = saved.experience
        learner.table = saved.table
        learner._questions = saved.questions
        learner._file = saved.file
        learner._fits = FitCache(saved.experience, saved.settings)
        learner._fits.online = saved.fitted
        return learner

    def _saved(self) -> SavedLearner:
        """Return all that this learner is."""
        return SavedLearner(
            agent=self.agent,
            settings=self.settings,
            experience=self.experience,
            table=self.table,
            fitted=self._fits.online,
            questions=self._questions,
            file=self._file,
        )
