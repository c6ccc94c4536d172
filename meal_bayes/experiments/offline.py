"""OFFLINE-MEAL (Sect. 7.2): agents answer the same queries about objects new to them."""

import dataclasses
import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from meal_bayes.agents import Task, Trial, as_agent, distinct, trials_frame
from meal_bayes.datasets import PerceptTable
from meal_bayes.display import short_repr
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.carried import Carried
from meal_bayes.experiments.claims import run_claimed
from meal_bayes.experiments.percepts import percepts_for
from meal_bayes.experiments.store import UNIT, Store, fingerprint, is_whole
from meal_bayes.experiments.tasks import offline_tasks
from meal_bayes.learner import Learner
from meal_bayes.trial_log import (
    TrialOutcomes,
    TrialWriter,
    read_outcomes,
    read_seconds,
    read_trials,
    remove_drafts,
)
from meal_bayes.untrusted import LARGEST

DEFAULT_AGENTS = (
    "random",
    "random_legal",
    "predefined",
    "predefined_plus",
    "greedy",
    "morc",
    "bayes",
)


@dataclass(frozen=True, slots=True)
class OfflineConfig:
    """Settings of an offline run.

    Attributes
    ----------
    dataset : domain or percept table.
    attributes : N, asked at a time.
    trials : of each agent.
    agents : names or values (see `as_agent`), made `Agent`s.
    seed : of all random streams.
    percepts : "recorded", or "model".
    perception : "default", or "paper".
    reward : r+ = -r-, the domain's by default.

    Raises
    ------
    SettingsError : an agent that is unknown or named twice, a negative seed, a reward that is not
        positive and finite.
    """

    dataset: str
    attributes: int = 2
    trials: int = 400
    agents: tuple[Any, ...] = DEFAULT_AGENTS
    seed: int = 0
    percepts: str = "recorded"
    perception: str = "default"
    reward: float | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        found = distinct(as_agent(value) for value in self.agents)
        object.__setattr__(self, "agents", found)
        if self.seed < 0:
            raise SettingsError(f"seed is {self.seed}; give a whole number, 0 or more.")
        if self.reward is not None and not 0 < self.reward <= LARGEST:
            raise SettingsError(
                f"reward is {self.reward}; give a finite number above 0, at most {LARGEST:g}."
            )
        if not self.agents:
            raise SettingsError(f"No agent named; choose from {', '.join(DEFAULT_AGENTS)}.")

    def as_dict(self) -> dict[str, object]:
        """Return plain values, for headers and JSON."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {**fields, "agents": [agent.name for agent in self.agents]}


@dataclass(frozen=True, slots=True)
class OfflineRun:
    """A finished run.

    Attributes
    ----------
    config : of the run.
    folder, paths : of its logs.
    seconds : that its trials took to compute, by agent.
    """

    config: OfflineConfig
    folder: Path
    paths: tuple[Path, ...]
    seconds: dict[str, float]

    def trials(self) -> Iterator[Trial]:
        """Read all trials back, agent by agent."""
        for path in self.paths:
            yield from read_trials(path)

    def outcomes(self) -> TrialOutcomes:
        """Read the outcomes of all trials back, agent by agent."""
        return TrialOutcomes.join([read_outcomes(path) for path in self.paths])

    def to_frame(self) -> Any:
        """Return a pandas data frame, a row a trial; see `trials_frame`."""
        return trials_frame(self.trials())

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class _Unit:
    agent: Carried  # unpickled first, as the config holds the agent too
    config: OfflineConfig
    first: int  # trial
    path: Path
    fresh: bool = False  # run again what is there

    @property
    def done(self) -> bool:
        """Whether its file is there and sound."""
        trials = min(UNIT, self.config.trials - self.first)
        return not self.fresh and is_whole(self.path, trials=trials)


def run_offline(
    config: OfflineConfig,
    *,
    logs: str | Path = "logs",
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> OfflineRun:
    """Run an offline experiment; units that are already whole are not run again.

    Any number of processes may run it on one folder of logs at a time: they share the work.

    Parameters
    ----------
    config : what to run; tasks, failures and recordings are the same for all its agents.
    logs : folder for the trials; on a cluster, one that all its machines see.
    jobs : processes.
    cluster : address of a Dask scheduler, such as tcp://127.0.0.1:8786, instead of processes here.
    fresh : run again what is there already; it is replaced unit by unit.
    on_progress : called with (trials done, trials in all).
    on_note : called with a line that says which other process is waited for; logged by default.

    Raises
    ------
    SettingsError : settings that cannot be run.
    OutputError, LogError : logs that cannot be written.
    """
    if jobs < 1:
        raise SettingsError(f"jobs is {jobs}; give the number of processes, 1 or more.")
    tasks = _tasks(config)
    carried = {agent.name: Carried.of(agent) for agent in config.agents}
    store = _store(config, logs, carried)
    units = [
        _Unit(one, dataclasses.replace(config, agents=(one.agent,)), first, path, fresh)
        for first in range(0, len(tasks), UNIT)
        for name, one in carried.items()
        for path in (store.unit(name, first // UNIT).absolute(),)
    ]
    todo = [unit for unit in units if not unit.done]
    total = len(tasks) * len(carried)
    done = total - sum(len(_slice(tasks, unit)) for unit in todo)
    if on_progress is not None:
        on_progress(done, total)
    if todo:
        own = tuple({unit.agent.agent.name: unit.agent.agent for unit in todo}.values())
        warm_up_offline(dataclasses.replace(config, agents=own))
    work = [(unit, unit.path) for unit in todo]
    for finished in run_claimed(_run_unit, work, jobs=jobs, cluster=cluster, on_note=on_note):
        done += finished
        if on_progress is not None:
            on_progress(done, total)
    numbers = range((len(tasks) + UNIT - 1) // UNIT)
    paths = {name: [store.unit(name, number) for number in numbers] for name in carried}
    seconds = {name: _seconds(iter(own)) for name, own in paths.items()}
    return OfflineRun(config, store.folder, tuple(itertools.chain(*paths.values())), seconds)


def warm_up_offline(config: OfflineConfig) -> None:
    """Compile the kernels that the agents need, once, before every process would."""
    for agent in config.agents:
        agent.warm_up(_table(config).domain, _tasks(config)[0].query)


def _store(config: OfflineConfig, logs: str | Path, carried: Mapping[str, Carried]) -> Store:
    """Name the folder by what every unit depends on, the source of agents of one's own included."""
    shared = {key: value for key, value in config.as_dict().items() if key != "agents"}
    shared["table"] = fingerprint(config.dataset)
    if config.trials % UNIT == 0:  # its units are those of longer runs
        shared["trials"] = "whole units"
    shared["sources"] = {name: one.digest for name, one in carried.items() if one.digest}
    name = f"offline-{_table(config).domain.name}-n{config.attributes}-seed{config.seed}"
    return Store.of(logs, name, shared)


def _run_unit(unit: _Unit) -> int:
    tasks = _slice(_tasks(unit.config), unit)
    config = unit.config
    if unit.done:  # by another process, meanwhile
        return len(tasks)
    learner = Learner(
        _table(config).domain,
        agent=unit.agent.agent,
        seed=config.seed,
        reward=config.reward,
        percepts=config.percepts,
        logs=None,
    ).fit(_table(config))
    header = {"config": config.as_dict(), "seed": config.seed}
    with TrialWriter(unit.path, header) as log:
        for task in tasks:
            start = time.perf_counter()
            trial = learner.replay(task)
            log.write(trial, seconds=time.perf_counter() - start)
    remove_drafts(unit.path)  # of processes that were killed
    return len(tasks)


def _slice(tasks: list[Task], unit: _Unit) -> list[Task]:
    return tasks[unit.first : unit.first + UNIT]


def _tasks(config: OfflineConfig) -> list[Task]:
    return offline_tasks(_table(config), config.attributes, config.trials, config.seed)


def _table(config: OfflineConfig) -> PerceptTable:
    return _loaded(config.dataset, config.perception, fingerprint(config.dataset))


@lru_cache(maxsize=4)
def _loaded(dataset: str, perception: str, content: str) -> PerceptTable:
    return percepts_for(dataset, perception)


def _seconds(paths: Iterator[Path]) -> float:
    """Sum of the timing tables beside the logs, s; nan where one has been removed."""
    found = [read_seconds(path) for path in paths]
    return math.fsum(map(math.fsum, found)) if all(found) else math.nan
