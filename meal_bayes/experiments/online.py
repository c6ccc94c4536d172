"""ONLINE-MEAL (Sect. 7.3): agents that learn from their own trials, tested after every batch.

`Protocol` draws the three parts of the objects and the tasks; a robot and a person replay.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import ITRSBonus
from meal_bayes.datasets import Dataset, PerceptTable, load_dataset, load_percepts, object_index
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.logged import TEST, TRAINING, worst_first
from meal_bayes.experiments.config import OnlineConfig
from meal_bayes.experiments.store import agent_folder, is_finished, run_folder
from meal_bayes.experiments.units import Planned, run_units, timed, warm_up
from meal_bayes.files import LOGS
from meal_bayes.learner import Learner, LearnerSettings, implied
from meal_bayes.perception.perceiver import answer
from meal_bayes.perception.table_source import fingerprint
from meal_bayes.robots import OutcomeChecker
from meal_bayes.robots.recorded import Order, RecordedRobot, replayable
from meal_bayes.seeds import stream
from meal_bayes.trial_log import TrialWriter, log_info, read_outcomes, read_trials
from meal_bayes.trial_log.file import COMPACT
from meal_bayes.trials import BatchOutcomes, Task, Trial, TrialOutcomes
from meal_bayes.trials.outcomes import HOUR

ASKED = 10  # attributes of an online run
_TESTS = 340  # test trials a batch, at most
_DRAWN = 10  # of them, whose steps are logged in a compact log beside those of the worst
_POSITIVES = 3  # of every attribute in every part, where a split has them
_TRIES = 10_000  # splits drawn for them


def learnable(table: PerceptTable) -> tuple[str, ...]:
    """Choose the ten attributes that are perceived best, with enough objects of and without each.

    Enough are three in each of three parts. Best: by the largest TPR - FPR over behaviors of
    held-out percepts. The choice is the protocol's; agents do not see these rates.
    """
    truth = table.labels
    # Three in each of three parts, of both values.
    enough = np.minimum((truth == 1).sum(axis=0), (truth == 0).sum(axis=0)) >= 3 * _POSITIVES
    recorded = ~np.isnan(table.log_odds).any(axis=1)
    yes = np.where(recorded, (table.log_odds > 0).mean(axis=1), 0.5)  # (O,E,P) of recordings
    best = np.full(truth.shape[1], -1.0)
    # The best behavior's TPR - FPR.
    for p in np.flatnonzero(enough):
        false, true = (yes[truth[:, p] == value, :, p].mean(axis=0) for value in (0, 1))
        best[p] = (true - false).max()
    columns = np.sort(np.argsort(-best, kind="stable")[:ASKED])
    return tuple(table.domain.attributes[p] for p in columns)


def restricted(dataset: Dataset, attributes: tuple[str, ...]) -> Dataset:
    """Keep some of the attributes."""
    columns = dataset.domain.columns(attributes)
    domain = restricted_domain(dataset.domain, attributes)
    answers = None if dataset.answers is None else dataset.answers[:, columns]
    return Dataset(
        domain,
        dataset.objects,
        dataset.features,
        dataset.labels[:, columns],
        rows_checked=True,
        answers=answers,
    )


def restricted_domain(domain: Domain, attributes: tuple[str, ...]) -> Domain:
    """Keep some of the attributes, and groups and synonyms of these alone."""
    groups = {
        name: members for name, members in domain.groups.items() if set(members) <= set(attributes)
    }
    synonyms = {word: name for word, name in domain.synonyms.items() if name in attributes}
    return replace(domain, attributes=attributes, groups=groups, synonyms=synonyms)


class Recordings:
    """What is left to record of each object in training.

    Recordings of an object are replayed in one random order, each once; after the last they repeat.
    """

    def __init__(self, dataset: Dataset, rng: np.random.Generator) -> None:
        self.counts = replayable(dataset)  # (O,E)
        # Sorting random numbers gives a random order; absent recordings come last, at infinity.
        absent = np.arange(dataset.recordings) >= self.counts[..., None]
        self._order = np.where(absent, np.inf, rng.random(absent.shape)).argsort(axis=-1)
        self._used = np.zeros(self.counts.shape, np.int64)
        self._senses = dataset.domain.recorded

    def supply(self, index: int) -> Order:
        """Return the recordings of an object yet to come, (E,) lists, the next one last."""
        rows = zip(self._order[index], self.counts[index], self._used[index], strict=True)
        return [np.roll(order[:count], -used)[::-1].tolist() for order, count, used in rows]

    def use(self, trial: Trial) -> None:
        """Count the recordings that a trial was shown."""
        for step in trial.steps:
            action = step.decision.action
            if step.observation is not None and action in self._senses:
                self._used[trial.task.object_index, action] += 1


class ObjectSplit(NamedTuple):
    """Obj^pre, Obj^train and Obj^test: disjoint sets of object indices, rising."""

    pre: NDArray[np.intp]
    train: NDArray[np.intp]
    test: NDArray[np.intp]


def _draw_split(dataset: Dataset, shares: NDArray[np.intp], seed: int, repeat: int) -> ObjectSplit:
    """Draw parts of these shares, each with three positives of every attribute, or fewer."""
    count = len(dataset.objects)
    positive = (dataset.labels == 1).astype(np.intp)
    ends = np.round(np.cumsum(shares) / shares.sum() * count).astype(int)
    starts = np.array([0, *ends[:-1]])
    if (starts == ends).any():
        raise SettingsError(
            f"Split sizes {(ends - starts).tolist()} do not fit {count} objects; expected at least "
            "one object in each part: give other shares, or more objects."
        )
    # Draw splits until one has enough positives of every attribute in each part; where none does
    # after many, ask for one fewer. With none asked the first will do.
    minimum = _POSITIVES
    richest = np.sort(positive.sum(axis=1))[-(ends - starts).min() :].sum()  # in the smallest part
    while True:
        rng = stream(seed, "split", dataset.domain.data, repeat, minimum)
        possible = (positive.sum(axis=0) >= 3 * minimum).all()
        possible = possible and richest >= minimum * positive.shape[1]
        for _ in range(_TRIES if possible else 0):
            order = rng.permutation(count)
            if np.add.reduceat(positive[order], starts).min(initial=minimum) >= minimum:
                return ObjectSplit(*map(np.sort, np.split(order, ends[:2])))
        minimum -= 1


@dataclass(frozen=True, slots=True)
class Protocol:
    """The tasks of one repeat, the same for every agent."""

    dataset: Dataset
    split: ObjectSplit  # objects for pretraining, training, tests
    attributes: int  # N, asked at a time
    seed: int
    repeat: int  # names, with the seed, the random streams

    @classmethod
    def of(
        cls,
        dataset: Dataset,
        *,
        attributes: int,
        seed: int,
        repeat: int,
        shares: tuple[int, int, int] | tuple[tuple[str, ...], ...],
    ) -> "Protocol":
        """Split the objects by shares, or by their names.

        By shares three of every attribute come into each part, or as many as can be.
        """
        if not 1 <= attributes <= len(dataset.domain.attributes):
            raise SettingsError(
                f"attributes is {attributes}; {dataset.domain.name} has "
                f"{len(dataset.domain.attributes)}, give a number from 1 to that."
            )
        if isinstance(shares[0], int):
            split = _draw_split(dataset, np.array(shares), seed, repeat)
        else:
            parts = ([object_index(dataset.objects, name) for name in part] for part in shares)
            split = ObjectSplit(*(np.sort(part) for part in parts))
            if len(np.unique(np.concatenate(split))) < sum(map(len, split)):
                raise SettingsError("An object is in two parts of the split; put it in one part.")
        protocol = cls(dataset, split, attributes, seed, repeat)
        for name, part in (("train", split.train), ("test", split.test)):
            if not protocol._pairs(part):
                raise SettingsError(
                    f"No object of the {name} part has labels of {attributes} attributes; add "
                    "labels, or ask about fewer attributes at a time."
                )
        return protocol

    @property
    def pretrained(self) -> list[str]:
        """Names of the objects for pretraining."""
        return [self.dataset.objects[index] for index in self.split.pre]

    def pretraining(self) -> Dataset:
        """Return recording 1 of each behavior, and all labels, of the objects known before."""
        taught = np.zeros(len(self.dataset.objects), np.bool_)
        taught[self.split.pre] = True
        features = {}
        for context, values in self.dataset.features.items():
            features[context] = np.where(taught[:, None, None], values[:, :1], np.float32(np.nan))
        labels = np.where(taught[:, None], self.dataset.labels, -1)
        return Dataset(self.dataset.domain, self.dataset.objects, features, labels, partial=True)

    def tests(self) -> list[Task]:
        """Test tasks, the same after every batch: each (object, query) once, 340 at most."""
        pairs = self._pairs(self.split.test)
        rng = stream(self.seed, "tests", self.dataset.domain.data, self.attributes, self.repeat)
        order = rng.permutation(len(pairs))[:_TESTS].tolist()
        tasks = (self._task("test", 0, i, pairs[j]) for i, j in enumerate(order))
        return [replace(task, learn=False) for task in tasks]

    def training(self, batch: int, trials: int) -> list[Task]:
        """Draw the training tasks of a batch: object and query uniform."""
        pairs = self._pairs(self.split.train)
        data = self.dataset.domain.data
        path = ("training", data, self.attributes, self.repeat, batch)
        rng = stream(self.seed, *path)
        drawn = rng.integers(len(pairs), size=trials).tolist()
        return [self._task("train", batch, i, pairs[j]) for i, j in enumerate(drawn)]

    def _pairs(self, objects: NDArray[np.intp]) -> list[tuple[int, tuple[str, ...]]]:
        names = self.dataset.domain.attributes
        labeled = self.dataset.labels >= 0
        queries = list(itertools.combinations(range(len(names)), self.attributes))
        pairs = list[tuple[int, tuple[str, ...]]]()
        for index in objects.tolist():
            for columns in queries:
                if labeled[index, list(columns)].all():
                    pairs.append((index, tuple(names[column] for column in columns)))
        return pairs

    def _task(self, part: str, batch: int, index: int, pair: tuple[int, tuple[str, ...]]) -> Task:
        index_of_object, attributes = pair
        data = self.dataset.domain.data
        name = self.dataset.objects[index_of_object]
        return Task(
            name=f"{part} {batch:02d} {index:03d} {name}",
            query=Query(attributes),
            object_index=index_of_object,
            object_name=name,
            key=(data, part, self.repeat, batch, index, name, *attributes),
        )


class Environment:
    """The environment of an online run: recordings, and a person who is told and asked."""

    def __init__(self, config: OnlineConfig, protocol: Protocol) -> None:
        self._config = config
        self._data = protocol.dataset
        rng = stream(config.seed, "world", self._data.domain.data, protocol.repeat)
        self._recordings = Recordings(protocol.dataset, rng)

    def ask(self, learner: Learner, task: Task, *, learn: bool) -> Trial:
        """Run a test trial, on all recordings of the object, or a training trial.

        From the feedback of a training trial the learner learns before the next (Alg. 2, l. 5-23).
        """
        columns = self._data.domain.columns(task.query.attributes)
        truth = self._data.labels[task.object_index, columns]
        trial = learner.ask(task, self._robot(task, learn=learn), truth=truth, learn=learn)
        if learn:
            self._tell(learner, trial)
        return trial

    def repeat(self, learner: Learner, trial: Trial) -> None:
        """Let a learner experience a trial that is logged; it perceives when it fits next."""
        task = trial.task
        domain = self._data.domain
        robot = self._robot(task, learn=True)
        checker = OutcomeChecker(domain, object_index=task.object_index)
        robot.start()
        steps = list(trial.steps)
        for number, step in enumerate(steps):
            action = step.decision.action
            if action < trial.momdp.n_behaviors:
                outcome = robot.execute(domain.behavior_names[action])
                steps[number] = replace(step, sensed=checker.execute(action, outcome).instance)
        learner.record(replace(trial, steps=tuple(steps)))
        self._tell(learner, trial)

    def _tell(self, learner: Learner, trial: Trial) -> None:
        """Tell a learner whether its report was right, if there is one."""
        self._recordings.use(trial)
        if trial.report is None or trial.success is None:
            return
        labels = implied(trial.report, right=trial.success)
        if self._config.answers == "joint":
            labels = np.where(labels < 0, labels, labels.min())
        learner.tell(trial, dict(zip(trial.task.query.attributes, labels.tolist(), strict=True)))

    def _robot(self, task: Task, *, learn: bool) -> RecordedRobot:
        seed = self._config.seed
        index = task.object_index
        columns = self._data.domain.columns(task.query.attributes)
        # In training, recordings of an object are used up; a test has all of them.
        order = self._recordings.supply(index) if learn else None
        rng = stream(seed, "percepts", *task.key)

        def person(accuracy: float) -> dict[str, bool]:
            answers = answer(self._data.labels[index, columns], accuracy, 2, rng)
            if self._data.answers is not None and self._config.second_rater:
                said = self._data.answers[index, columns]
                answers = np.where(said >= 0, said, answers)
            return dict(zip(task.query.attributes, (answers == 1).tolist(), strict=True))

        return RecordedRobot.of(
            self._data,
            index,
            seed=seed,
            key=task.key,
            order=order,
            repeats=self._config.percepts == "model",
            person=person,
        )


_REWARD = 300.0  # of the paper (Sect. 7.3)


@dataclass(frozen=True, slots=True)
class OnlineRun:
    """Result of an online experiment: its settings, and the folder of its logs."""

    config: OnlineConfig
    folder: Path

    def results(self) -> Iterator[BatchOutcomes]:
        """Yield the test results of every agent, repeat and batch, in order."""
        for agent in self.config.agents:
            for repeat in range(self.config.repeats):
                unit = _AgentRepeat(
                    dataclasses.replace(self.config, agents=(agent,)), repeat, self.folder
                )
                cost = 0.0
                for batch in range(self.config.batches + 1):
                    if batch:
                        cost += log_info(unit.log(batch, TRAINING)).cost
                    tests = read_outcomes(unit.log(batch, TEST))
                    yield BatchOutcomes(agent.name, repeat, batch, cost / HOUR, tests)


def repeat_folder(folder: Path, agent: str, repeat: int) -> Path:
    """Return the folder of the logs of an agent's repeat, in the folder of a run."""
    return agent_folder(folder, agent) / f"repeat-{repeat:03d}"


def batch_log(folder: Path, batch: int, part: str) -> Path:
    """Return the log of a batch's part, `TRAINING` or `TEST`, in the folder of its repeat."""
    return folder / f"{batch:02d}-{part}.mcap"


@dataclass(frozen=True, slots=True)
class _AgentRepeat:
    """One agent in one repeat."""

    config: OnlineConfig
    repeat: int
    folder: Path
    fresh: bool = False  # run again what is there

    @property
    def path(self) -> Path:
        """Folder of its logs."""
        return repeat_folder(self.folder, self.config.agents[0].name, self.repeat)

    @property
    def size(self) -> int:
        return self.config.batches + 1

    def log(self, batch: int, part: str) -> Path:
        return batch_log(self.path, batch, part)

    def has(self, batch: int, part: str) -> bool:
        """Return whether the log of a part of a batch is there and sound."""
        return not self.fresh and is_finished(self.log(batch, part))

    def finished(self, batch: int) -> bool:
        """Return whether the logs of a batch are there and sound; batch 0 trains on nothing."""
        trained = batch == 0 or self.has(batch, TRAINING)
        return trained and self.has(batch, TEST)

    @property
    def done(self) -> int:
        """How many batches are finished."""
        return sum(self.finished(batch) for batch in range(self.config.batches + 1))

    def run(self, advance: Callable[[float], None]) -> None:
        """Run what is not finished."""
        config = self.config
        protocol = _protocol(self.config, self.repeat)
        learner = _learner(config, protocol)
        environment = Environment(config, protocol)
        tests = protocol.tests()
        write = partial(self._write, advance, environment, learner)
        for batch in range(config.batches + 1):
            train = config.batches > batch and not self.has(batch + 1, TRAINING)
            test = not self.has(batch, TEST)
            # Of trials in the log only the record is made again; a refit costs time, and is due
            # only before the next trial that runs.
            if test or train:
                learner.refit()
            if test:
                pretrained = None if batch else protocol.pretrained
                write(batch=batch, part=TEST, tasks=tests, pretrained=pretrained)
            if train:
                tasks = protocol.training(batch + 1, config.trials)
                write(batch=batch + 1, part=TRAINING, tasks=tasks)
            elif batch < config.batches:
                for trial in read_trials(self.log(batch + 1, TRAINING)):
                    environment.repeat(learner, trial)

    def _write(
        self,
        advance: Callable[[float], None],
        environment: Environment,
        learner: Learner,
        *,
        batch: int,
        part: str,
        tasks: list[Task],
        pretrained: list[str] | None = None,
    ) -> None:
        """Run trials and log them; with the whole log that part of the batch is done."""
        # A batch counts 1, half of it its training; the first has none.
        fraction = (0.5 if batch else 1) / len(tasks)
        run = partial(environment.ask, learner, learn=part == TRAINING)
        path = self.log(batch, part)
        trials = timed(run, tasks, advance, fraction)
        header: dict[str, object] = {
            "config": self.config.as_dict(),
            "seed": self.config.seed,
            "agent": learner.agent.name,
            "repeat": self.repeat,
            "batch": batch,
            "part": part,
        }
        if pretrained is not None:
            header["pretrained"] = pretrained
        if part == TEST and self.config.log == "compact":
            rng = stream(self.config.seed, "tests with steps", self.repeat, batch)
            _write_compact(path, header, list(trials), rng)
            return
        with TrialWriter(path, header, overwrite=True) as log:
            for trial, seconds_of_trial in trials:
                log.write(trial, seconds=seconds_of_trial)


def _write_compact(
    path: Path,
    header: Mapping[str, object],
    timed_trials: Sequence[tuple[Trial, float]],
    rng: np.random.Generator,
) -> None:
    """Write the outcomes of tests, and the steps of the worst trial and of ten drawn ones.

    All agents have the same ten drawn.
    """
    trials, seconds = zip(*timed_trials, strict=True)
    outcomes = TrialOutcomes.of(trials)
    drawn = rng.permutation(len(trials))[:_DRAWN]
    begin = 0
    with TrialWriter(path, header, COMPACT, overwrite=True) as log:
        for row in sorted({*drawn.tolist(), *worst_first(outcomes)[:1].tolist()}):
            log.write_outcomes(outcomes.rows(slice(begin, row)), iter(seconds[begin:row]))
            log.write(trials[row], seconds=seconds[row])
            begin = row + 1
        log.write_outcomes(outcomes.rows(slice(begin, None)), iter(seconds[begin:]))


def plan_online(config: OnlineConfig, *, logs: str | Path = LOGS, fresh: bool = False) -> Planned:
    """Plan an online run: its units go round the agents, each one agent in one repeat.

    Arguments are those of `run_online`.
    """
    weighted = any(isinstance(agent.exploration, ITRSBonus) for agent in config.agents)
    if not weighted and (config.alpha, config.beta) != (None, None):
        names = ", ".join(agent.name for agent in config.agents)
        raise SettingsError(
            f"alpha and beta are weights of Eq. 11, which none of the agents {names} takes; leave "
            "them out, or run morc_itrs or bayes_itrs."
        )
    domain = _protocol(config, 0).dataset.domain  # raises here, not in a process, what is wrong
    if config.reward is None:
        reward = _REWARD if domain.data in SOURCES else domain.report_reward
        config = dataclasses.replace(config, reward=reward)
    name = f"online-{domain.name}-n{config.attributes}"
    data = fingerprint(config.dataset, config.root)
    folder = run_folder(logs, name, config, ignore=("repeats",), data=data)
    absolute = folder.absolute()  # a cluster's workers live elsewhere
    units = [
        _AgentRepeat(dataclasses.replace(config, agents=(agent,)), repeat, absolute, fresh)
        for repeat in range(config.repeats)
        for agent in config.agents
    ]
    return Planned(config, folder, units, partial(warm_up, config, domain))


def run_online(
    config: OnlineConfig,
    *,
    logs: str | Path = LOGS,
    jobs: int = 1,
    fresh: bool = False,
    on_progress: Callable[[float, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> OnlineRun:
    """Run an online experiment; parts that an earlier run finished are read, not run again.

    Several processes may run the same experiment on one folder of logs at the same time; they share
    the work.

    Parameters
    ----------
    config : OnlineConfig
        Settings of the experiment. All its agents get the same objects, tasks, failures and
        recordings.
    logs, jobs, on_note : Any
        As for `run_offline`.
    fresh : bool
        Whether to run finished batches again. Each new batch replaces the old one when it is done.
    on_progress : Callable[[float, int], None] | None
        Called once a second from a thread with the number of finished batches and the number of all
        batches. If workers run on other machines, it is called after every repeat of an agent.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> from meal_bayes.datasets import make_synthetic
    >>> rng = np.random.default_rng(0)
    >>> data = make_synthetic(meal_bayes.load_domain("toy"), objects=12, recordings=2, rng=rng)
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     meal_bayes.save_csv_folder(data, f"{folder}/data")
    ...     config = meal_bayes.OnlineConfig(
    ...         dataset="toy", attributes=1, root=f"{folder}/data", agents=("greedy",), batches=1,
    ...         trials=2, repeats=1,
    ...     )
    ...     run = meal_bayes.run_online(config, logs=f"{folder}/logs")
    >>> type(run).__name__
    'OnlineRun'
    """
    planned = plan_online(config, logs=logs, fresh=fresh)
    run_units([planned], jobs=jobs, on_progress=on_progress, on_note=on_note)
    return OnlineRun(planned.config, planned.folder)


@lru_cache(maxsize=2)
def _loaded(name: str, root: str | None, content: str) -> Dataset:
    dataset = load_dataset(name, root=root)
    if dataset.domain.data not in SOURCES or len(dataset.domain.attributes) <= ASKED:
        return dataset
    return restricted(dataset, learnable(load_percepts(dataset.domain.data)))


def _protocol(config: OnlineConfig, repeat: int) -> Protocol:
    content = fingerprint(config.dataset, config.root)
    return Protocol.of(
        _loaded(config.dataset, config.root, content),
        attributes=config.attributes,
        seed=config.seed,
        repeat=repeat,
        shares=config.split,
    )


def _learner(config: OnlineConfig, protocol: Protocol) -> Learner:
    """Return a learner, pretrained: every behavior once, and all labels, of a part."""
    dataset = protocol.dataset
    split = protocol.split
    count_given = config.normalizer == "all"
    counted = len(split.train) + (len(split.pre) if count_given else 0)
    settings = LearnerSettings(
        seed=config.seed,
        reward=config.reward,
        horizon=config.horizon,
        refit_every=None,
        learn_success=False,
        unit=float(dataset.recordings * counted),  # labeled instances in one unit of Eq. 10
        count_given=count_given,
        drawn=dataset.labels if config.percepts == "model" else None,
    )
    settings = dataclasses.replace(settings, **dict(config.learning))
    learner = Learner(dataset.domain, agent=config.agents[0], settings=settings, logs=None)
    return learner.fit(protocol.pretraining())
