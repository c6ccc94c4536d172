"""OFFLINE-MEAL (Sect. 7.2): agents answer the same queries about objects new to them."""

import dataclasses
import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from meal_bayes.agents import as_agent, distinct
from meal_bayes.datasets import Dataset, PerceptTable
from meal_bayes.display import short_repr
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import summarize
from meal_bayes.experiments.percepts import kept_table, percepts_for
from meal_bayes.experiments.sources import agent_digest
from meal_bayes.experiments.store import UNIT, Store, fingerprint, is_whole
from meal_bayes.experiments.tasks import offline_tasks
from meal_bayes.experiments.units import run_units
from meal_bayes.learner import Learner
from meal_bayes.trial_log import (
    TrialWriter,
    read_outcomes,
    read_seconds,
    read_trials,
)
from meal_bayes.trials import Task, Trial, TrialOutcomes, steps_frame, trials_frame
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
    dataset : a shipped data set, a percept table or its path, or recordings.
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

    dataset: Any
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
        if isinstance(self.dataset, Dataset | PerceptTable):
            object.__setattr__(self, "dataset", kept_table(self.dataset))
        if not isinstance(self.dataset, str):
            raise SettingsError(
                f"dataset is {self.dataset!r:.40}; give the name of a data set, a percept table, "
                "its path, or recordings (`load_dataset`, `Dataset.from_frames`)."
            )
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

    def steps(self) -> Any:
        """Return a pandas data frame, a row a step of every trial."""
        return steps_frame(self.trials())

    __repr__ = short_repr

    def _repr_html_(self) -> str:
        return summarize(self)._repr_html_()


@dataclass(frozen=True, slots=True)
class _Unit:
    """Up to 100 trials of one agent.

    Attributes
    ----------
    config : of the run, with this agent alone.
    path : of its log.
    first : number of its first trial.
    fresh : run again what is there.
    """

    config: OfflineConfig
    path: Path
    first: int
    fresh: bool = False

    @property
    def size(self) -> int:
        return min(UNIT, self.config.trials - self.first)

    @property
    def done(self) -> int:
        whole = not self.fresh and is_whole(self.path, trials=self.size)
        return self.size if whole else 0

    def run(self) -> None:
        if self.done:  # by another process, meanwhile
            return
        config = self.config
        learner = Learner(
            _table(config).domain,
            agent=config.agents[0],
            seed=config.seed,
            reward=config.reward,
            percepts=config.percepts,
            logs=None,
        ).fit(_table(config))
        header = {"config": config.as_dict(), "seed": config.seed}
        with TrialWriter(self.path, header) as log:
            for task in _tasks(config)[self.first : self.first + UNIT]:
                start = time.perf_counter()
                trial = learner.ask(task)
                log.write(trial, seconds=time.perf_counter() - start)


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
    store = _store(config, logs)
    units = [
        _Unit(dataclasses.replace(config, agents=(agent,)), path, first, fresh)
        for first in range(0, len(_tasks(config)), UNIT)
        for agent in config.agents
        for path in (store.unit(agent.name, first // UNIT).absolute(),)
    ]
    run_units(
        units,
        _warm_up,
        jobs=jobs,
        cluster=cluster,
        on_progress=on_progress,
        on_note=on_note,
    )
    numbers = range(math.ceil(config.trials / UNIT))
    paths = {
        agent.name: [store.unit(agent.name, number) for number in numbers]
        for agent in config.agents
    }
    seconds = {name: _seconds(iter(files)) for name, files in paths.items()}
    return OfflineRun(config, store.folder, tuple(itertools.chain(*paths.values())), seconds)


def warm_up_offline(config: OfflineConfig) -> None:
    """Compile the kernels that the agents need, once, before every process would."""
    for agent in config.agents:
        agent.warm_up(_table(config).domain, _tasks(config)[0].query)


def _warm_up(units: list[_Unit]) -> None:
    agents = {unit.config.agents[0].name: unit.config.agents[0] for unit in units}
    warm_up_offline(dataclasses.replace(units[0].config, agents=tuple(agents.values())))


def _store(config: OfflineConfig, logs: str | Path) -> Store:
    """Name the folder by what every unit depends on, the source of agents of one's own included."""
    shared = {key: value for key, value in config.as_dict().items() if key != "agents"}
    shared["table"] = fingerprint(config.dataset)
    if config.trials % UNIT == 0:  # its units are those of longer runs
        shared["trials"] = "whole units"
    digests = {agent.name: agent_digest(agent) for agent in config.agents}
    shared["sources"] = {name: digest for name, digest in digests.items() if digest}
    name = f"offline-{_table(config).domain.name}-n{config.attributes}-seed{config.seed}"
    return Store.of(logs, name, shared)


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
