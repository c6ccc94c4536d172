"""OFFLINE-MEAL (Sect. 7.2): agents answer the same queries about objects new to them."""

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from meal_bayes.datasets import PerceptTable
from meal_bayes.experiments.config import OfflineConfig
from meal_bayes.experiments.store import agent_folder, is_whole, run_folder
from meal_bayes.experiments.tasks import offline_tasks
from meal_bayes.experiments.units import run_units, timed, warm_up
from meal_bayes.files import LOGS
from meal_bayes.learner import Learner
from meal_bayes.look import short_repr
from meal_bayes.perception import TableSource
from meal_bayes.trial_log import TrialWriter, read_outcomes, read_seconds, read_trials
from meal_bayes.trials import Task, Trial, TrialOutcomes, trials_frame

UNIT = 100  # trials of one agent in a file


@dataclass(frozen=True, slots=True)
class OfflineRun:
    """A finished run.

    Attributes
    ----------
    config : OfflineConfig
        Of the run.
    folder : Path
        Of its logs.
    paths : tuple[Path, ...]
        Of each log.
    seconds : dict[str, float]
        That its trials took to compute, by agent; nan where a timing table was removed.
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
        """Return a pandas data frame, a row a step of every trial; see `Trial.to_frame`."""
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
        return 0 if self.fresh or not is_whole(self.path) else self.size

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


def run_offline(
    config: OfflineConfig,
    *,
    logs: str | Path = LOGS,
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    on_progress: Callable[[float, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> OfflineRun:
    """Run an offline experiment; units that are already whole are not run again.

    Any number of processes may run it on one folder of logs at a time: they share the work.

    Parameters
    ----------
    config : OfflineConfig
        What to run; tasks, failures and recordings are the same for all its agents.
    logs : str | Path
        Folder for the trials; on a cluster, one that all its machines see.
    jobs : int
        Processes.
    cluster : str | None
        Address of a Dask scheduler, such as tcp://127.0.0.1:8786, instead of processes here.
    fresh : bool
        Run again what is there already; it is replaced unit by unit.
    on_progress : Callable[[float, int], None] | None
        Called with (trials done, trials in all), from processes once a second; from a cluster after
        100 trials.
    on_note : Callable[[str], None] | None
        Called with a line that says which other process is waited for; logged by default.

    Raises
    ------
    SettingsError
        Settings that cannot be run.
    OutputError, LogError
        Logs that cannot be written.

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
    source = TableSource.of(config.dataset, config.perception)
    table = _loaded(source)
    config = dataclasses.replace(config, dataset=source.name)  # by which other processes find it
    tasks = offline_tasks(
        table, config.attributes, config.trials, config.seed, answer=config.answer
    )
    name = f"offline-{table.domain.name}-n{config.attributes}-seed{config.seed}"
    # Whole units of a short run are the first units of a longer one, so both share a folder.
    ignore = ("trials",) if config.trials % UNIT == 0 else ()
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
    run_units(
        units,
        partial(warm_up, config, table.domain),
        jobs=jobs,
        cluster=cluster,
        on_progress=on_progress,
        on_note=on_note,
    )
    paths = list[Path]()
    seconds = {}
    for number, agent in enumerate(config.agents):
        # Units go round the agents, so every len(agents)-th is of this one.
        logs_of_agent = [unit.path for unit in units[number :: len(config.agents)]]
        times = list(map(read_seconds, logs_of_agent))
        seconds[agent.name] = math.fsum(map(math.fsum, times)) if all(times) else math.nan
        paths += logs_of_agent
    return OfflineRun(config, folder, tuple(paths), seconds)


@lru_cache(maxsize=4)
def _loaded(source: TableSource) -> PerceptTable:
    """Load a table once for all units that a process runs."""
    return source.load()
