"""OFFLINE-MEAL (Sect. 7.2): agents answer the same queries about objects new to them."""

import dataclasses
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from meal_bayes.agents import Morc, Task, Trial, load_agent
from meal_bayes.datasets import PerceptTable
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.experiments.percepts import percepts_for
from meal_bayes.experiments.store import UNIT, Store, fingerprint
from meal_bayes.experiments.tasks import offline_tasks
from meal_bayes.trial_log import TrialWriter, read_trials
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

    Raises
    ------
    SettingsError : an agent that is unknown or named twice, a negative seed, a reward that is not
        positive and finite.
    """

    dataset: str  # domain whose table is used
    attributes: int = 2  # N
    trials: int = 400
    agents: tuple[str, ...] = DEFAULT_AGENTS
    seed: int = 0
    percepts: str = "recorded"  # or "model"
    perception: str = "default"  # or "paper"
    reward: float | None = None  # r+ = -r-, the domain's by default

    def __post_init__(self) -> None:
        for name in self.agents:
            load_agent(name)
            if self.agents.count(name) > 1:
                raise SettingsError(f"Agent {name!r} is named twice; name each once.")
        if self.seed < 0:
            raise SettingsError(f"seed is {self.seed}; give a whole number, 0 or more.")
        if self.reward is not None and not 0 < self.reward <= LARGEST:
            raise SettingsError(
                f"reward is {self.reward}; give a finite number above 0, at most {LARGEST:g}."
            )
        if not self.agents:
            raise SettingsError(f"No agent named; choose from {', '.join(DEFAULT_AGENTS)}.")

    def as_dict(self) -> dict[str, object]:
        """Plain values, for headers and JSON."""
        return {**dataclasses.asdict(self), "agents": list(self.agents)}


@dataclass(frozen=True, slots=True)
class OfflineRun:
    """A finished run: where its trials are, and what they took to compute."""

    config: OfflineConfig
    folder: Path
    paths: tuple[Path, ...]
    seconds: dict[str, float]  # by agent

    def trials(self) -> Iterator[Trial]:
        """Read all trials back, agent by agent."""
        for path in self.paths:
            yield from read_trials(path)


@dataclass(frozen=True, slots=True)
class _Unit:
    config: OfflineConfig
    agent: str
    first: int  # trial
    path: Path


def run_offline(
    config: OfflineConfig,
    *,
    logs: str | Path = "logs",
    jobs: int = 1,
    fresh: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> OfflineRun:
    """Run an offline experiment; units that are already whole are not run again.

    Parameters
    ----------
    config : what to run; tasks, failures and recordings are the same for all its agents.
    logs : folder for the trials.
    jobs : processes.
    fresh : run again what is there already.
    on_progress : called with (trials done, trials in all).
    """
    if jobs < 1:
        raise SettingsError(f"jobs is {jobs}; give the number of processes, 1 or more.")
    tasks = _tasks(config)
    name = f"offline-{_table(config).domain.name}-n{config.attributes}-seed{config.seed}"
    shared = {key: value for key, value in config.as_dict().items() if key != "agents"}
    shared["table"] = fingerprint(config.dataset)
    store = Store.of(logs, name, shared)
    if fresh:
        for agent in config.agents:
            Store(store.folder / agent).clear()
    units = [
        _Unit(config, agent, first, store.unit(agent, first // UNIT))
        for first in range(0, len(tasks), UNIT)
        for agent in config.agents
    ]
    todo = [unit for unit in units if not unit.path.is_file()]
    total = len(tasks) * len(config.agents)
    done = total - sum(len(_slice(tasks, unit)) for unit in todo)
    if on_progress is not None:
        on_progress(done, total)
    for agent in {unit.agent for unit in todo}:
        load_agent(agent).warm_up()  # once, before every process would
    for finished in in_parallel(_run_unit, todo, jobs=jobs):
        done += finished
        if on_progress is not None:
            on_progress(done, total)
    paths = tuple(unit.path for unit in sorted(units, key=lambda u: config.agents.index(u.agent)))
    seconds = {
        agent: _seconds(path for path in paths if path.parent.name == agent)
        for agent in config.agents
    }
    return OfflineRun(config, store.folder, paths, seconds)


def _run_unit(unit: _Unit) -> int:
    tasks = _slice(_tasks(unit.config), unit)
    config = unit.config
    morc = Morc(
        _table(config),
        load_agent(unit.agent),
        config.seed,
        config.percepts,
        config.reward,
    )
    header = {"config": {**config.as_dict(), "agents": [unit.agent]}, "seed": config.seed}
    with TrialWriter(unit.path, header) as log:
        for task in tasks:
            start = time.perf_counter()
            trial = morc.run(task)
            log.write(trial, seconds=time.perf_counter() - start)
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
    total = 0.0
    for path in paths:
        timing = path.with_name(path.stem + ".timing.csv")
        if not timing.is_file():
            return math.nan
        rows = timing.read_text(encoding="utf-8").splitlines()
        total += sum(float(row.split(",")[1]) for row in rows[1:])
    return total
