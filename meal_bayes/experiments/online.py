"""ONLINE-MEAL (Sect. 7.3): agents that learn from their own trials, tested after every batch."""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

from meal_bayes.datasets import Dataset, load_dataset, load_percepts
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.evaluation.logged import TEST, TRAINING
from meal_bayes.experiments.config import OnlineConfig
from meal_bayes.experiments.online_protocol import (
    ASKED,
    Environment,
    Protocol,
    learnable,
    restricted,
)
from meal_bayes.experiments.store import agent_folder, is_whole, run_folder
from meal_bayes.experiments.units import run_units, timed, warm_up
from meal_bayes.files import LOGS
from meal_bayes.learner import Learner, LearnerSettings
from meal_bayes.perception.table_source import fingerprint
from meal_bayes.trial_log import TrialWriter, log_info, read_outcomes, read_trials, write_trials
from meal_bayes.trials import BatchOutcomes, Task, TrialOutcomes
from meal_bayes.trials.outcomes import HOUR

_REWARD = 300.0  # of the paper (Sect. 7.3)


@dataclass(frozen=True, slots=True)
class OnlineRun:
    """A finished run: its settings, and the folder of its logs."""

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
    """Return where the logs of an agent's repeat lie in the folder of a run."""
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
        return not self.fresh and is_whole(self.log(batch, part))

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
            logged, seconds = zip(*trials, strict=True)
            outcomes = [TrialOutcomes.of(logged)]
            write_trials(path, outcomes, header=header, seconds=seconds, overwrite=True)
            return
        with TrialWriter(path, header, overwrite=True) as log:
            for trial, seconds_of_trial in trials:
                log.write(trial, seconds=seconds_of_trial)


def run_online(
    config: OnlineConfig,
    *,
    logs: str | Path = LOGS,
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    on_progress: Callable[[float, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> OnlineRun:
    """Run an online experiment; batches that are already whole are not run again.

    Any number of processes may run it on one folder of logs at a time: they share the work.

    Parameters
    ----------
    config : OnlineConfig
        What to run; objects, tasks, failures and recordings are the same for all its agents.
    logs, jobs, cluster, on_note : Any
        As of `run_offline`.
    fresh : bool
        Run again what is there already; it is replaced batch by batch.
    on_progress : Callable[[float, int], None] | None
        Called with (batches done, batches in all) after every trial, from processes once a second;
        from a cluster after a repeat of an agent.

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
    run_units(
        units,
        partial(warm_up, config, domain),
        jobs=jobs,
        cluster=cluster,
        on_progress=on_progress,
        on_note=on_note,
    )
    return OnlineRun(config, folder)


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
    reward = dataset.domain.report_reward if config.reward is None else config.reward
    settings = LearnerSettings(
        seed=config.seed,
        reward=reward,
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
