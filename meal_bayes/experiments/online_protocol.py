"""The protocol of ONLINE-MEAL (Sect. 7.3): objects in three parts, tasks, robot and person."""

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, PerceptTable, object_index
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.config import OnlineConfig
from meal_bayes.learner import Learner, implied
from meal_bayes.perception.perceiver import answer
from meal_bayes.robots import OutcomeChecker
from meal_bayes.robots.recorded import Order, RecordedRobot, replayable
from meal_bayes.seeds import stream
from meal_bayes.trials import Task, Trial

ASKED = 10  # attributes of an online run
_TESTS = 340  # test trials a batch, at most
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
    return Dataset(
        domain, dataset.objects, dataset.features, dataset.labels[:, columns], rows_checked=True
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
                raise SettingsError("An object is in two parts of the split; give it in one.")
        protocol = cls(dataset, split, attributes, seed, repeat)
        for name, part in (("train", split.train), ("test", split.test)):
            if not protocol._pairs(part):
                raise SettingsError(
                    f"Of no object of the {name} part are {attributes} attributes known; "
                    "add labels, or ask fewer at a time."
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
