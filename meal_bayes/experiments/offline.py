"""OFFLINE-MEAL (Sect. 7.2): agents answer the same queries about objects new to them.

`offline_tasks` draws what is asked: objects, attributes, and for yes or no which of them hold.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import check_whole, is_whole, plain
from meal_bayes.datasets import Dataset, PerceptTable
from meal_bayes.domain import Domain, Event, Query
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.config import OfflineConfig, check_answer
from meal_bayes.experiments.store import agent_folder, is_finished, run_folder
from meal_bayes.experiments.units import Planned, run_units, timed, warm_up
from meal_bayes.files import LOGS
from meal_bayes.learner import Learner
from meal_bayes.look import short_repr
from meal_bayes.perception import TableSource
from meal_bayes.seeds import Key, stream
from meal_bayes.trial_log import TrialWriter, read_outcomes, read_seconds, read_trials
from meal_bayes.trials import Task, Trial, TrialOutcomes, trials_frame

if TYPE_CHECKING:
    import pandas as pd

_LISTED = 200_000  # (object, query) pairs up to which all are listed and shuffled

_Pair = tuple[int, tuple[str, ...]]


def askable(table: PerceptTable | Dataset) -> tuple[str, ...]:
    """Return the attributes that are true and false for more objects than `asked_minimum`."""
    positive = (table.labels == 1).sum(axis=0)
    negative = (table.labels == 0).sum(axis=0)
    enough = np.minimum(positive, negative) > table.domain.asked_minimum
    return tuple(name for name, ok in zip(table.domain.attributes, enough, strict=True) if ok)


def offline_tasks(
    table: PerceptTable, n_attributes: int, trials: int, seed: int, *, answer: str = "values"
) -> list[Task]:
    """Draw the tasks of an offline run.

    Objects are drawn uniformly. Attributes are drawn uniformly and without repetition from those
    that can be asked. If the domain has at least N groups (as ROC36), a query contains one
    attribute of each of N groups, and in half of the trials all of them are true. Each task
    combines an object with a set of attributes. All combinations are drawn once, in a random order,
    before any is repeated. If there are groups, combinations in which all attributes are true have
    an order of their own, and so do all others. The kind of answer (see `OfflineConfig`) does not
    change the objects, attributes and random streams, with one exception: yes-or-no questions never
    ask whether two values of a group are both true.

    Raises
    ------
    SettingsError
        There are no trials, a question has more attributes than can be asked, or no object has
        labels of so many attributes.
    """
    check_answer(answer)
    trials = check_whole("trials", trials)
    seed = check_whole("seed", seed)
    n_attributes = plain(n_attributes)
    names = askable(table)
    whole = is_whole(n_attributes)
    if not whole or not 1 <= n_attributes <= len(names):
        raise SettingsError(
            f"The number of attributes in a question is {n_attributes!r:.60}; give a number from 1 "
            f"to {len(names)} for {table.domain.name}."
        )
    if trials < 1:
        raise SettingsError(f"{trials} trials were asked for; give at least 1.")
    _check_labeled(table, names, n_attributes, conjunctions=answer == "yes or no")
    # The stream names no agent: all are asked the same.
    rng = stream(seed, "tasks", table.domain.data, n_attributes)
    of_groups = (tuple(n for n in group if n in names) for group in table.domain.groups.values())
    groups = [members for members in of_groups if members]
    objects = range(len(table.objects))
    count = len(objects) * math.comb(len(names), n_attributes)
    # By groups (ROC36); one by one where a list would be too long; else all, shuffled.
    if groups and n_attributes <= len(groups):
        pairs = _grouped(table, groups, n_attributes, rng)
    elif count > _LISTED:
        pairs = _draws(len(objects), names, n_attributes, count, rng)
    else:
        queries = itertools.combinations(names, n_attributes)
        pairs = _rounds(list(itertools.product(objects, queries)), rng)
    has_label = dict(zip(table.domain.attributes, (table.labels >= 0).T, strict=True))
    judgeable = (
        (o, attributes)
        for o, attributes in pairs
        if all(has_label[name][o] for name in attributes)
        and (answer != "yes or no" or table.domain.can_be(dict.fromkeys(attributes, True)))
    )
    tasks = []
    for index, (o, attributes) in enumerate(itertools.islice(judgeable, trials)):
        name = table.objects[o]
        key: Key = (table.domain.data, index, name, *attributes)
        tasks.append(Task(f"{index:05d} {name}", Query(attributes), o, name, key))
    if answer == "values":
        return tasks
    return _of_yes_or_no(tasks, table, balanced=answer == "balanced", seed=seed)


def _check_labeled(
    table: PerceptTable, names: tuple[str, ...], n_attributes: int, *, conjunctions: bool
) -> None:
    """Raise an error if no object has labels of as many attributes as a question needs."""
    columns = table.domain.columns(names)
    labeled = table.labels[:, columns] >= 0
    most = int(labeled.sum(axis=1).max())
    if n_attributes > most:
        raise SettingsError(
            f"Questions are about {n_attributes} attributes, but no object has labels of more than "
            f"{most} of them; ask about fewer attributes, or add labels."
        )
    if not conjunctions:
        return
    variables: dict[tuple[str, ...], list[int]] = {}
    for index, name in enumerate(names):
        variables.setdefault(table.domain.group_of(name) or (name,), []).append(index)
    together = np.stack([labeled[:, indices].any(axis=1) for indices in variables.values()])
    most = int(together.sum(axis=0).max())
    if n_attributes > most:
        raise SettingsError(
            f"Questions ask whether {n_attributes} attributes are all true, but no object has "
            f"labels of more than {most} attributes that can be true together (of a group, only "
            "one can). Ask about fewer attributes, or ask 'balanced' questions "
            "(--yes-no-balanced), which negate some attributes."
        )


def _of_yes_or_no(
    tasks: list[Task], table: PerceptTable, *, balanced: bool, seed: int
) -> list[Task]:
    """Ask whether all attributes of each task hold; if balanced, literals of which half hold.

    Of the other half a subset of the literals is wrong, which is drawn uniformly of those that the
    domain's groups leave open.
    """
    rng = stream(seed, "literals", table.domain.data, len(tasks))
    halves = rng.permutation(np.arange(len(tasks)) % 2 == 0)
    new_tasks = []
    for task, holds in zip(tasks, halves.tolist(), strict=True):
        n = len(task.query)
        literals = np.ones(n, bool)
        if balanced:
            columns = table.domain.columns(task.query.attributes)
            literals = table.labels[task.object_index, columns] == 1
            if not holds:
                literals = _others(literals, task.query.attributes, table.domain, rng)
        query = task.query
        if n > 1 or not literals.all():  # else it is the value of one attribute
            query = dataclasses.replace(query, event=Event(tuple(literals.tolist())))
        new_tasks.append(dataclasses.replace(task, query=query))
    return new_tasks


def _others(
    literals: NDArray[np.bool_], names: tuple[str, ...], domain: Domain, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Draw values other than these, which some object may have."""
    while True:
        wrong = int(rng.integers(1, 2 ** len(names)))
        drawn = np.asarray(literals ^ ((wrong >> np.arange(len(names))) % 2 == 1))
        if domain.can_be(dict(zip(names, drawn.tolist(), strict=True))):
            return drawn


def _draws(
    n_objects: int, names: tuple[str, ...], n: int, pairs: int, rng: np.random.Generator
) -> Iterator[_Pair]:
    """Draw pairs one by one, none twice before all have come."""
    drawn: set[_Pair] = set()
    while True:
        columns = sorted(rng.choice(len(names), size=n, replace=False))
        pair = int(rng.integers(n_objects)), tuple(names[i] for i in columns)
        if pair in drawn:
            continue
        drawn.add(pair)
        yield pair
        if len(drawn) == pairs:
            drawn.clear()


def _grouped(
    table: PerceptTable, groups: list[tuple[str, ...]], n: int, rng: np.random.Generator
) -> Iterator[_Pair]:
    """Yield queries that describe the object and queries that do not, in turn (ROC36)."""
    true = list[_Pair]()
    false = list[_Pair]()
    labels = dict(zip(table.domain.attributes, table.labels.T, strict=True))
    for o in range(len(table.objects)):
        for of_query in itertools.combinations(groups, n):
            for attributes in itertools.product(*of_query):
                values = [int(labels[name][o]) for name in attributes]
                if min(values) >= 0:
                    (true if all(values) else false).append((o, attributes))
    if not true and not false:
        raise SettingsError(
            f"No object has labels of an attribute of each of {n} groups; label more."
        )
    if not true or not false:
        return _rounds(true + false, rng)
    in_turn = zip(_rounds(true, rng), _rounds(false, rng), strict=True)
    return itertools.chain.from_iterable(in_turn)


def _rounds(pairs: list[_Pair], rng: np.random.Generator) -> Iterator[_Pair]:
    """Repeat all pairs without end, each time in another random order."""
    while pairs:
        for i in rng.permutation(len(pairs)):
            yield pairs[i]


UNIT = 100  # trials of one agent in a file


@dataclass(frozen=True, slots=True)
class OfflineRun:
    """Result of an offline experiment.

    Attributes
    ----------
    config : OfflineConfig
        Settings of the experiment.
    folder : Path
        Folder of the logs.
    paths : tuple[Path, ...]
        Path of each log.
    seconds : dict[str, float]
        Computing time of each agent's trials, s; nan if a file with the times was removed.
    """

    config: OfflineConfig
    folder: Path
    paths: tuple[Path, ...]
    seconds: dict[str, float]

    def trials(self) -> Iterator[Trial]:
        """Read all trials from the logs, agent by agent."""
        for path in self.paths:
            yield from read_trials(path)

    def outcomes(self) -> TrialOutcomes:
        """Read the outcomes of all trials from the logs, agent by agent."""
        return TrialOutcomes.join([read_outcomes(path) for path in self.paths])

    def to_frame(self) -> "pd.DataFrame":
        """Return a pandas data frame with a row for each trial; see `trials_frame`."""
        return trials_frame(self.trials())

    def steps(self) -> Any:
        """Return a data frame with a row for each step of every trial; see `Trial.to_frame`."""
        import pandas as pd  # noqa: PLC0415  takes half a second

        frames = []
        for trial in self.trials():
            task = {"task": trial.task.name, "object": trial.task.object_name}
            frames.append(trial.to_frame().assign(agent=trial.agent, **task))
        return pd.concat(frames, ignore_index=True)

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class _TrialBlock:
    """Up to 100 trials of one agent."""

    config: OfflineConfig  # with this agent alone
    path: Path  # of its log
    tasks: list[Task]
    fresh: bool  # run again what is there

    @property
    def size(self) -> int:
        return len(self.tasks)

    @property
    def done(self) -> int:
        return 0 if self.fresh or not is_finished(self.path) else self.size

    def run(self, advance: Callable[[float], None]) -> None:
        if self.done:  # by another process, meanwhile
            return
        config = self.config
        table = _loaded(TableSource.of(config.dataset, config.perception))
        learner = Learner(
            table.domain,
            agent=config.agents[0],
            seed=config.seed,
            reward=config.reward,
            payoffs=config.payoffs,
            percepts=config.percepts,
            logs=None,
        ).fit(table)
        header = {"config": config.as_dict(), "seed": config.seed}
        with TrialWriter(self.path, header, overwrite=True) as log:
            for trial, seconds in timed(learner.ask, self.tasks, advance):
                log.write(trial, seconds=seconds)


def plan_offline(config: OfflineConfig, *, logs: str | Path = LOGS, fresh: bool = False) -> Planned:
    """Plan an offline run: its units go round the agents, each up to 100 trials of one agent.

    Arguments are those of `run_offline`.
    """
    source = TableSource.of(config.dataset, config.perception)
    table = _loaded(source)
    config = dataclasses.replace(config, dataset=source.name)  # by which other processes find it
    tasks = offline_tasks(
        table, config.attributes, config.trials, config.seed, answer=config.answer
    )
    name = f"offline-{table.domain.name}-n{config.attributes}-seed{config.seed}"
    # Whole units of a short run are the first units of a longer one, so both share a folder; but of
    # balanced questions, which of them hold is drawn for all trials at once.
    whole = config.trials % UNIT == 0 and config.answer != "balanced"
    ignore = ("trials",) if whole else ()
    folder = run_folder(logs, name, config, ignore=ignore, table=source.fingerprint)
    absolute = folder.absolute()  # a cluster's workers live elsewhere
    units = [
        _TrialBlock(
            dataclasses.replace(config, agents=(agent,)),
            agent_folder(absolute, agent.name) / f"unit-{first // UNIT:04d}.mcap",
            tasks[first:][:UNIT],
            fresh,
        )
        for first in range(0, len(tasks), UNIT)
        for agent in config.agents
    ]
    return Planned(config, folder, units, partial(warm_up, config, table.domain))


def run_offline(
    config: OfflineConfig,
    *,
    logs: str | Path = LOGS,
    jobs: int = 1,
    fresh: bool = False,
    on_progress: Callable[[float, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> OfflineRun:
    """Run an offline experiment; parts that an earlier run finished are read, not run again.

    Several processes may run the same experiment on one folder of logs at the same time; they share
    the work.

    Parameters
    ----------
    config : OfflineConfig
        Settings of the experiment. All its agents get the same tasks, failures and recordings.
    logs : str | Path
        Folder for the logs. On a cluster, all machines must have access to it.
    jobs : int
        Number of processes. Under another backend of joblib, such as
        `joblib.parallel_config("dask")`, the workers of a cluster run the trials.
    fresh : bool
        Whether to run finished parts again. When a new part is complete, it replaces the old
        one.
    on_progress : Callable[[float, int], None] | None
        Called once a second from a thread with the number of finished trials and the number of all
        trials. If workers run on other machines, it is called after every 100 trials.
    on_note : Callable[[str], None] | None
        Called with a message if this process has to wait for another one. By default the message is
        logged.

    Raises
    ------
    SettingsError
        The experiment cannot be run with these settings.
    OutputError, LogError
        The logs cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import meal_bayes
    >>> config = meal_bayes.OfflineConfig(
    ...     dataset="roc36", attributes=1, trials=2, agents=("greedy",)
    ... )
    >>> with TemporaryDirectory() as folder:
    ...     run = meal_bayes.run_offline(config, logs=folder)
    >>> type(run).__name__
    'OfflineRun'
    """
    planned = plan_offline(config, logs=logs, fresh=fresh)
    run_units([planned], jobs=jobs, on_progress=on_progress, on_note=on_note)
    units = planned.units
    paths = list[Path]()
    seconds = {}
    for number, agent in enumerate(config.agents):
        # Units go round the agents, so every len(agents)-th is of this one.
        logs_of_agent = [unit.path for unit in units[number :: len(config.agents)]]
        times = list(map(read_seconds, logs_of_agent))
        seconds[agent.name] = math.fsum(map(math.fsum, times)) if all(times) else math.nan
        paths += logs_of_agent
    return OfflineRun(planned.config, planned.folder, tuple(paths), seconds)


@lru_cache(maxsize=4)
def _loaded(source: TableSource) -> PerceptTable:
    """Load a table once for all units that a process runs."""
    return source.load()
