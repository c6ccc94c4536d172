"""ONLINE-MEAL (Sect. 7.3): robots that learn while they work, tested after every batch."""

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from meal_bayes.agents import (
    PUBLISHED,
    Experience,
    Feedback,
    MorcItrs,
    OnlineAgent,
    Surroundings,
    Task,
    Trial,
    as_online_agent,
    distinct,
    heard,
    load_agent,
    origin_of,
)
from meal_bayes.datasets import Dataset, load_dataset, load_percepts
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.carried import Carried
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.experiments.store import Store, file_name, fingerprint
from meal_bayes.experiments.world import ASKED, Protocol, learnable, restricted
from meal_bayes.perception import Kernels
from meal_bayes.seeds import stream
from meal_bayes.trial_log import BatchMarks, Marks, TrialWriter, read_trials

_LOGS = ("all", "train")
_REWARD = 300.0  # of the paper (Sect. 7.3)


@dataclass(frozen=True, slots=True)
class OnlineConfig:
    """Settings of an online run.

    Raises
    ------
    SettingsError : what is unknown, named twice, or out of range.
    """

    dataset: str  # a shipped domain, or the path of one's own (TOML)
    attributes: int = 1  # N
    root: str | None = None  # folder of the recordings; of public ones, found or downloaded
    agents: tuple[Any, ...] = ("iterative_morc", "morc_itrs", "bayes", "bayes_memory")
    batches: int = 10
    trials: int = 40  # training trials a batch
    repeats: int = 1
    seed: int = 0
    first: int = 0  # repeat to begin with: repeats are first .. first + repeats - 1
    split: tuple[int, int, int] = (33, 33, 34)  # shares of pre, train, test
    reward: float | None = None  # r+ = -r-; 300 on public data (Sect. 7.3), else the domain's
    alpha: float | None = None  # of morc_itrs; the recipe's by default
    beta: float | None = None
    answers: str = "verdict"  # what a person tells: see `Feedback`
    error: float = 0.0  # Pr(a person errs)
    success: tuple[tuple[str, float], ...] = ()  # of the body: (behavior, probability)
    learn_success: bool = False  # does the robot learn success probabilities?
    published: tuple[str, ...] = ()  # what the authors' code does otherwise
    horizon: int = 1000  # queries to be answered, for which curiosity explores
    log: str = "all"  # or "train": test trials leave their marks only

    def __post_init__(self) -> None:
        found = distinct(as_online_agent(value) for value in self.agents)
        object.__setattr__(self, "agents", found)
        for name in ("attributes", "batches", "trials", "repeats", "horizon"):
            if getattr(self, name) < 1:
                raise SettingsError(f"{name} is {getattr(self, name)}; give at least 1.")
        if self.seed < 0 or self.first < 0:
            raise SettingsError("seed and first are whole numbers, 0 or more.")
        if self.reward is not None and not 0 < self.reward < math.inf:
            raise SettingsError(f"reward is {self.reward}; give a finite number above 0.")
        if len(self.split) != 3 or min(self.split) < 1:  # noqa: PLR2004
            raise SettingsError(f"split is {self.split}; give three shares, such as 33/33/34.")
        if self.log not in _LOGS:
            raise SettingsError(unknown("log", self.log, _LOGS))
        for name in self.published:
            if name not in PUBLISHED:
                raise SettingsError(unknown("published variant", name, PUBLISHED))
        for name in ("alpha", "beta"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < math.inf:
                raise SettingsError(f"{name} is {value}; give a finite number, 0 or more.")
        Feedback(self.answers, self.error)

    def as_dict(self) -> dict[str, object]:
        """Plain values, for headers and JSON."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        lists = {name: list(getattr(self, name)) for name in ("split", "published")}
        names = [agent.name for agent in self.agents]
        return {**fields, **lists, "agents": names, "success": [list(p) for p in self.success]}


@dataclass(frozen=True, slots=True)
class OnlineRun:
    """A finished run."""

    config: OnlineConfig
    folder: Path

    def results(self) -> Iterator[BatchMarks]:
        """Give the test results of every agent, repeat and batch, in order."""
        for agent in self.config.agents:
            for repeat in _repeats(self.config):
                unit = _unit(self.config, agent, repeat, self.folder)
                cost = 0.0
                for batch in range(self.config.batches + 1):
                    if batch:
                        cost += float(Marks.load(unit.marks(batch, "train")).cost.sum())
                    yield BatchMarks(
                        agent.name,
                        repeat,
                        batch,
                        cost / 3600,
                        Marks.load(unit.marks(batch, "test")),
                    )


@dataclass(frozen=True, slots=True)
class _Unit:
    """One agent in one repeat."""

    carried: Carried  # unpickled first, as the config holds the agent too
    config: OnlineConfig
    repeat: int
    folder: Path

    @property
    def agent(self) -> OnlineAgent:
        """Who runs, with the config's weights of exploration."""
        agent: OnlineAgent = self.config.agents[0]
        alpha = agent.alpha if self.config.alpha is None else self.config.alpha
        beta = agent.beta if self.config.beta is None else self.config.beta
        return dataclasses.replace(agent, alpha=alpha, beta=beta)

    def log(self, batch: int, part: str) -> Path:
        folder = self.folder / file_name(self.agent.name) / f"repeat-{self.repeat:03d}"
        return folder / f"{batch:02d}-{part}.mcap"

    def marks(self, batch: int, part: str) -> Path:
        return self.log(batch, part).with_suffix(".marks.csv")

    @property
    def done(self) -> int:
        """How many batches are finished."""
        parts = [("test",), *[("train", "test")] * self.config.batches]
        return sum(all(self.marks(b, p).is_file() for p in ps) for b, ps in enumerate(parts))


def _unit(config: OnlineConfig, agent: OnlineAgent, repeat: int, folder: Path) -> _Unit:
    own = dataclasses.replace(config, agents=(agent,))
    return _Unit(Carried.of(agent.recipe), own, repeat, folder)


def run_online(
    config: OnlineConfig,
    *,
    logs: str | Path = "logs",
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> OnlineRun:
    """Run an online experiment; batches that are already whole are not run again.

    Parameters
    ----------
    config : what to run; objects, tasks, failures and recordings are the same for all its agents.
    logs : folder for the trials; on a cluster, one that all its machines see.
    jobs : processes.
    cluster : address of a Dask scheduler, such as tcp://127.0.0.1:8786, instead of processes here.
    fresh : run again what is there already.
    on_progress : called with (batches done, batches in all).
    """
    if jobs < 1:
        raise SettingsError(f"jobs is {jobs}; give at least 1.")
    domain = _protocol(config, config.first).dataset.domain  # or say what is wrong
    if config.reward is None:
        reward = _REWARD if domain.data in SOURCES else domain.report_reward
        config = dataclasses.replace(config, reward=reward)
    store = Store.of(logs, f"online-{domain.name}-n{config.attributes}", _shared(config))
    units = [
        _unit(config, agent, repeat, store.folder.absolute())  # a cluster's workers live elsewhere
        for repeat in _repeats(config)
        for agent in config.agents
    ]
    if fresh:
        for agent in config.agents:
            Store(store.folder / file_name(agent.name)).clear()
    batches = config.batches + 1
    finished = [unit.done for unit in units]
    total, done = batches * len(units), sum(finished)
    todo = [unit for unit, ready in zip(units, finished, strict=True) if ready < batches]
    if on_progress is not None:
        on_progress(done, total)
    if todo:
        load_agent("bayes").warm_up()  # once, before every process would
    for count in in_parallel(_run_unit, todo, jobs=jobs, cluster=cluster):
        done += count
        if on_progress is not None:
            on_progress(done, total)
    return OnlineRun(config, store.folder)


def _repeats(config: OnlineConfig) -> range:
    return range(config.first, config.first + config.repeats)


def _shared(config: OnlineConfig) -> dict[str, object]:
    """Give what every unit depends on; repeats and agents name its folders."""
    shared = {k: v for k, v in config.as_dict().items() if k not in ("agents", "repeats", "first")}
    digests = {agent.name: origin_of(agent.recipe).digest for agent in config.agents}
    sources = {name: digest for name, digest in digests.items() if digest}
    return {**shared, "data": fingerprint(config.dataset, config.root), "sources": sources}


def _dataset(config: OnlineConfig) -> Dataset:
    return _loaded(config.dataset, config.root, fingerprint(config.dataset, config.root))


@lru_cache(maxsize=2)
def _loaded(name: str, root: str | None, content: str) -> Dataset:
    dataset = load_dataset(name, root=root)
    if dataset.domain.data not in SOURCES or len(dataset.domain.attributes) <= ASKED:
        return dataset
    return restricted(dataset, learnable(load_percepts(dataset.domain.data)))


def _protocol(config: OnlineConfig, repeat: int) -> Protocol:
    return Protocol.of(
        _dataset(config), attributes=config.attributes, seed=config.seed, repeat=repeat,
        shares=config.split,
    )  # fmt: skip


def _run_unit(unit: _Unit) -> int:
    """Run what a unit has not finished; return how many batches that were."""
    before, config, agent = unit.done, unit.config, unit.agent
    protocol = _protocol(config, unit.repeat)
    dataset = protocol.dataset
    rng = stream(config.seed, "world", dataset.domain.data, unit.repeat)
    experience = Experience.none(dataset, rng, memory=agent.memory)
    experience = experience.pretrain(dataset, protocol.split.pre)
    world = _surroundings(config, protocol, Kernels.of(dataset, experience.training_set()))
    tests, names = protocol.tests(), dataset.domain.attributes
    for batch in range(config.batches + 1):
        train = config.batches > batch and not unit.log(batch + 1, "train").is_file()
        test = not unit.marks(batch, "test").is_file()
        learner = None
        if train or test:
            learner = MorcItrs.learn(agent, world, experience, config.seed)
            if test:
                _write(unit, batch, "test", learner.test, tests, names, config.log == "all")
            if train:
                tasks = protocol.training(batch + 1, config.trials)
                _write(unit, batch + 1, "train", _Training(learner), tasks, names, logged=True)
                experience = learner.experience
        if not train and batch < config.batches:
            experience = _replay(unit, batch + 1, world, experience)
    return config.batches + 1 - before


def _surroundings(config: OnlineConfig, protocol: Protocol, kernels: Kernels) -> Surroundings:
    dataset, split = protocol.dataset, protocol.split
    return Surroundings(
        dataset=dataset,
        kernels=kernels,
        objects=np.concatenate([split.train, split.test]),
        delta=dataset.recordings * (len(split.pre) + len(split.train)),
        queries=config.horizon * config.attributes / len(dataset.domain.attributes),
        reward=_REWARD if config.reward is None else config.reward,
        feedback=Feedback(config.answers, config.error),
        body=_body(dataset.domain, dict(config.success)),
        learn_success=config.learn_success,
        published=config.published,
    )


def _body(domain: Domain, success: Mapping[str, float]) -> Domain:
    """Change how often behaviors succeed."""
    for name in success:
        domain.behavior_index(name)  # or say what is wrong
    return dataclasses.replace(domain, diagram=domain.diagram.succeeding(success.get))


class _Training:
    """Runs a training trial and takes it in before the next."""

    def __init__(self, learner: MorcItrs) -> None:
        self.learner = learner

    def __call__(self, task: Task) -> Trial:
        trial = self.learner.train(task)
        self.learner.absorb(trial)
        return trial


def _write(
    unit: _Unit, batch: int, part: str, run: Callable[[Task], Trial], tasks: list[Task],
    attributes: tuple[str, ...], logged: bool,
) -> None:  # fmt: skip
    """Run trials, log them, and write their marks last: with those the batch is done."""
    trials = []
    path = unit.log(batch, part)
    if logged:
        header = {
            "config": unit.config.as_dict(), "seed": unit.config.seed, "agent": unit.agent.name,
            "repeat": unit.repeat, "batch": batch, "part": part,
        }  # fmt: skip
        with TrialWriter(path, header) as log:
            for task in tasks:
                start = time.perf_counter()
                trials.append(run(task))
                log.write(trials[-1], seconds=time.perf_counter() - start)
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
        trials = [run(task) for task in tasks]
    Marks.of(trials, attributes).save(unit.marks(batch, part))


def _replay(unit: _Unit, batch: int, world: Surroundings, experience: Experience) -> Experience:
    """Rebuild what a finished batch taught from its log alone."""
    trials = list(read_trials(unit.log(batch, "train")))
    for trial in trials:
        told = heard(world, trial, unit.config.seed)
        experience = experience.absorb(world.dataset.domain, trial, told)
    if not unit.marks(batch, "train").is_file():
        Marks.of(trials, world.dataset.domain.attributes).save(unit.marks(batch, "train"))
    return experience
