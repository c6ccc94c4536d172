"""ONLINE-MEAL (Sect. 7.3): agents that learn from their own trials, tested after every batch."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from meal_bayes.agents import (
    Agent,
    Experience,
    Feedback,
    ITRSBonus,
    OnlineLearner,
    RunContext,
    Task,
    Trial,
    origin_of,
)
from meal_bayes.datasets import Dataset, load_dataset, load_percepts
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.carried import Carried
from meal_bayes.experiments.claims import run_claimed
from meal_bayes.experiments.online_config import OnlineConfig
from meal_bayes.experiments.protocol import ASKED, Protocol, learnable, restricted
from meal_bayes.experiments.store import Store, file_name, fingerprint, is_whole
from meal_bayes.perception import Kernels
from meal_bayes.seeds import stream
from meal_bayes.trial_log import (
    BatchOutcomes,
    OutcomeWriter,
    TrialOutcomes,
    TrialWriter,
    log_info,
    read_outcomes,
    read_trials,
    remove_drafts,
)

_REWARD = 300.0  # of the paper (Sect. 7.3)
_STEP = 10  # repeats after which a run that goes on until it is decided looks for the first time


@dataclass(frozen=True, slots=True)
class OnlineRun:
    """A finished run: its settings, and the folder of its logs."""

    config: OnlineConfig
    folder: Path

    def results(self) -> Iterator[BatchOutcomes]:
        """Yield the test results of every agent, repeat and batch, in order."""
        for agent in self.config.agents:
            for repeat in _repeats(self.config):
                unit = _unit(self.config, agent, repeat, self.folder)
                cost = 0.0
                for batch in range(self.config.batches + 1):
                    if batch:
                        cost += log_info(unit.log(batch, "train")).cost
                    tests = read_outcomes(unit.log(batch, "test"))
                    yield BatchOutcomes(agent.name, repeat, batch, cost / 3600, tests)

    def training(self, agent: str) -> list[TrialOutcomes]:
        """Return the outcomes of an agent's training trials, in order, one entry a repeat."""
        (own,) = (one for one in self.config.agents if one.name == agent)
        units = [_unit(self.config, own, k, self.folder) for k in _repeats(self.config)]
        batches = range(1, self.config.batches + 1)
        return [
            TrialOutcomes.join([read_outcomes(unit.log(b, "train")) for b in batches])
            for unit in units
        ]


@dataclass(frozen=True, slots=True)
class _Unit:
    """One agent in one repeat."""

    carried: Carried  # unpickled first, as the config holds the agent too
    config: OnlineConfig
    repeat: int
    folder: Path
    fresh: bool = False  # run again what is there

    @property
    def agent(self) -> Agent:
        """Who runs, with the config's weights of Eq. 11."""
        agent: Agent = self.config.agents[0]
        bonus, given = agent.exploration, {"alpha": self.config.alpha, "beta": self.config.beta}
        if not isinstance(bonus, ITRSBonus):
            return agent
        weights = {name: value for name, value in given.items() if value is not None}
        return dataclasses.replace(agent, exploration=dataclasses.replace(bonus, **weights))

    @property
    def name(self) -> tuple[str, int]:
        """The agent's name and the repeat."""
        return self.agent.name, self.repeat

    def log(self, batch: int, part: str) -> Path:
        folder = self.folder / file_name(self.agent.name) / f"repeat-{self.repeat:03d}"
        return folder / f"{batch:02d}-{part}.mcap"

    def has(self, batch: int, part: str) -> bool:
        """Return whether the log of a part of a batch is there and sound."""
        return not self.fresh and is_whole(self.log(batch, part))

    @property
    def done(self) -> int:
        """How many batches are finished."""
        parts = [("test",), *[("train", "test")] * self.config.batches]
        return sum(all(self.has(b, p) for p in ps) for b, ps in enumerate(parts))


def _unit(
    config: OnlineConfig, agent: Agent, repeat: int, folder: Path, fresh: bool = False
) -> _Unit:
    own = dataclasses.replace(config, agents=(agent,))
    return _Unit(Carried.of(agent), own, repeat, folder, fresh)


def run_online(
    config: OnlineConfig,
    *,
    logs: str | Path = "logs",
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> OnlineRun:
    """Run an online experiment; batches that are already whole are not run again.

    Any number of processes may run it on one folder of logs at a time: they share the work.

    Parameters
    ----------
    config : what to run; objects, tasks, failures and recordings are the same for all its agents.
    logs : folder for the trials; on a cluster, one that all its machines see.
    jobs : processes.
    cluster : address of a Dask scheduler, such as tcp://127.0.0.1:8786, instead of processes here.
    fresh : run again what is there already; it is replaced batch by batch.
    on_progress : called with (batches done, batches in all).
    on_note : called with a line that says which other process is waited for; logged by default.
    """
    if jobs < 1:
        raise SettingsError(f"jobs is {jobs}; give at least 1.")
    domain = _protocol(config, config.first).dataset.domain  # or say what is wrong
    _true_dynamics(domain, dict(config.success))  # the same
    if config.reward is None:
        reward = _REWARD if domain.data in SOURCES else domain.report_reward
        config = dataclasses.replace(config, reward=reward)
    store = Store.of(logs, f"online-{domain.name}-n{config.attributes}", _shared(config))
    folder = store.folder.absolute()  # a cluster's workers live elsewhere
    units = [
        _unit(config, agent, repeat, folder, fresh)
        for repeat in _repeats(config)
        for agent in config.agents
    ]
    batches = config.batches + 1
    finished = {unit.name: unit.done for unit in units}
    total, done = batches * len(units), sum(finished.values())
    todo = [unit for unit in units if finished[unit.name] < batches]
    if on_progress is not None:
        on_progress(done, total)
    if todo:
        warm_up_online(config)
    work = [(unit, unit.log(0, "test").parent) for unit in todo]
    for name in run_claimed(_run_unit, work, jobs=jobs, cluster=cluster, on_note=on_note):
        done += batches - finished[name]
        if on_progress is not None:
            on_progress(done, total)
    return OnlineRun(config, store.folder)


def run_online_until(
    config: OnlineConfig, decided: Callable[[list[BatchOutcomes]], bool], **options: Any
) -> OnlineRun:
    """Run repeats in steps of 10, 20, 40, ... until the results are decided.

    Parameters
    ----------
    config : what to run; its repeats are the most that are run.
    decided : of the results so far.
    options : of `run_online`.
    """
    repeats = min(_STEP, config.repeats)
    while True:
        run = run_online(dataclasses.replace(config, repeats=repeats), **options)
        if repeats == config.repeats or decided(list(run.results())):
            return run
        repeats = min(2 * repeats, config.repeats)


def warm_up_online(config: OnlineConfig) -> None:
    """Compile the kernels that the agents need, once, before every process would."""
    domain = _protocol(config, config.first).dataset.domain
    query = Query(domain.attributes[: config.attributes])
    for agent in config.agents:
        agent.warm_up(domain, query)


def _repeats(config: OnlineConfig) -> range:
    return range(config.first, config.first + config.repeats)


def _shared(config: OnlineConfig) -> dict[str, object]:
    """Return what every unit depends on; repeats and agents name its folders."""
    shared = {k: v for k, v in config.as_dict().items() if k not in ("agents", "repeats", "first")}
    digests = {agent.name: origin_of(agent).digest for agent in config.agents}
    sources = {name: digest for name, digest in digests.items() if digest}
    return {**shared, "data": fingerprint(config.dataset, config.root), "sources": sources}


@lru_cache(maxsize=2)
def _loaded(name: str, root: str | None, content: str) -> Dataset:
    dataset = load_dataset(name, root=root)
    if dataset.domain.data not in SOURCES or len(dataset.domain.attributes) <= ASKED:
        return dataset
    return restricted(dataset, learnable(load_percepts(dataset.domain.data)))


def _protocol(config: OnlineConfig, repeat: int) -> Protocol:
    content = fingerprint(config.dataset, config.root)
    data = (config.dataset, config.root, content)
    return _drawn(data, config.attributes, config.seed, repeat, config.split)


@lru_cache(maxsize=2)
def _drawn(
    data: tuple[str, str | None, str], attributes: int, seed: int, repeat: int,
    shares: tuple[int, int, int],
) -> Protocol:  # fmt: skip
    return Protocol.of(
        _loaded(*data), attributes=attributes, seed=seed, repeat=repeat, shares=shares
    )


def _run_unit(unit: _Unit) -> tuple[str, int]:
    """Run what a unit has not finished; return its name."""
    config, agent = unit.config, unit.agent
    protocol = _protocol(config, unit.repeat)
    dataset = protocol.dataset
    rng = stream(config.seed, "world", dataset.domain.data, unit.repeat)
    experience = Experience.none(dataset, rng, memory=agent.memory)
    experience = experience.pretrain(dataset, protocol.split.pre)
    context = _context(config, protocol, Kernels.of(dataset, experience.training_set()))
    tests = protocol.tests()
    for batch in range(config.batches + 1):
        train = config.batches > batch and not unit.has(batch + 1, "train")
        test = not unit.has(batch, "test")
        learner = None
        if test:
            learner = OnlineLearner.fit(agent, context, experience, config.seed)
            known = [dataset.objects[o] for o in protocol.split.pre] if batch == 0 else []
            _write(unit, batch, "test", learner.test, tests, pretrained=known)
        if train:
            if learner is None or agent.trained_by is not None:
                trainer = dataclasses.replace(agent.trained_by or agent, name=agent.name)
                learner = OnlineLearner.fit(trainer, context, experience, config.seed)
            tasks = protocol.training(batch + 1, config.trials)
            _write(unit, batch + 1, "train", _Training(learner), tasks)
            experience = learner.experience
        if not train and batch < config.batches:
            experience = _replay(unit, batch + 1, context, experience)
    return unit.name


def _context(config: OnlineConfig, protocol: Protocol, kernels: Kernels) -> RunContext:
    dataset, split = protocol.dataset, protocol.split
    pretrained = [] if config.normalizer == "paper" else [split.pre]
    return RunContext(
        dataset=dataset,
        kernels=kernels,
        scored=np.concatenate([split.train, split.test]),
        counted=np.concatenate([*pretrained, split.train]),
        queries=config.horizon * config.attributes / len(dataset.domain.attributes),
        reward=_REWARD if config.reward is None else config.reward,
        feedback=Feedback(config.answers, config.error),
        true_dynamics=_true_dynamics(dataset.domain, dict(config.success)),
        learn_success=config.learn_success,
        published=config.published,
    )


def _true_dynamics(domain: Domain, success: Mapping[str, float]) -> Domain:
    """Return the domain with other success probabilities."""
    for name in success:
        domain.behavior_index(name)  # or say what is wrong
    return dataclasses.replace(domain, diagram=domain.diagram.succeeding(success.get))


class _Training:
    """Runs a training trial, and learns from its feedback before the next."""

    def __init__(self, learner: OnlineLearner) -> None:
        self.learner = learner

    def __call__(self, task: Task) -> Trial:
        trial = self.learner.train(task)
        self.learner.tell(trial)
        return trial


def _write(
    unit: _Unit, batch: int, part: str, run: Callable[[Task], Trial], tasks: list[Task], *,
    pretrained: Sequence[str] = (),
) -> None:  # fmt: skip
    """Run trials and log them; with the whole log that part of the batch is done.

    Parameters
    ----------
    pretrained : objects on which every behavior was executed before, all their labels given.
    """
    path = unit.log(batch, part)
    header = {
        "config": unit.config.as_dict(), "seed": unit.config.seed, "agent": unit.agent.name,
        "repeat": unit.repeat, "batch": batch, "part": part,
        **({"pretrained": list(pretrained)} if pretrained else {}),
    }  # fmt: skip
    if part == "test" and unit.config.log == "compact":
        trials, seconds = zip(*(_timed(run, task) for task in tasks), strict=True)
        with OutcomeWriter(path, header) as log:
            log.write_outcomes(TrialOutcomes.of(trials), seconds=seconds)
    else:
        with TrialWriter(path, header) as whole:
            for trial, took in (_timed(run, task) for task in tasks):
                whole.write(trial, seconds=took)
    remove_drafts(path)  # of processes that were killed


def _timed(run: Callable[[Task], Trial], task: Task) -> tuple[Trial, float]:
    start = time.perf_counter()
    return run(task), time.perf_counter() - start


def _replay(unit: _Unit, batch: int, context: RunContext, experience: Experience) -> Experience:
    """Return the experience after a finished batch, from its log alone."""
    for trial in read_trials(unit.log(batch, "train")):
        feedback = context.labels_of(trial, unit.config.seed)
        experience = experience.absorb(context.dataset.domain, trial, feedback)
    return experience
