"""The data of a report: outcomes of logs, which of them measure an agent, which are shown whole.

Of an online run, the tests after the last batch measure the agents.
The logs of an online run hold training trials, and tests after every batch of them. Pooled, they
would be measures of nobody: of an agent that knew nothing and of what it became.
"""

import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.domain import load_domain
from meal_bayes.errors import LogError, MealBayesError
from meal_bayes.evaluation.learning import POOLED
from meal_bayes.trial_log import Group, Logs
from meal_bayes.trial_log.folder import ASK
from meal_bayes.trials import BatchOutcomes, Trial, TrialOutcomes
from meal_bayes.trials.outcomes import HOUR
from meal_bayes.trials.text import outcome_facts

TRAINING = "train"  # parts of a batch, in the header of its log and at the end of its name
TEST = "test"
TELLING = 3  # trials that a report shows whole
LOSS = "the lowest reward"  # of the agent's trials; so are the others
DEAREST = "the right answer that cost most"
GAIN = "the highest reward"
_EARNING = ("reward", "payoffs", "percepts", "perception", "answers", "learning")  # settings
_NONE = -1  # repeat or batch of a trial whose log names none


class LogPart(NamedTuple):
    """Of which part of a run a log is: the repeat, the batch, and what its trials are for.

    Numbers are -1, and the part is empty, where its header names none.
    """

    repeat: int = _NONE
    batch: int = _NONE
    part: str = ""

    @classmethod
    def of(cls, header: Mapping[str, Any]) -> "LogPart":
        """Return the part that a log's header names."""
        repeat = header.get("repeat")
        batch = header.get("batch")
        part = header.get("part")
        if not isinstance(repeat, int):
            repeat = _NONE
        if part not in (TRAINING, TEST) or not isinstance(batch, int):
            return cls(repeat)
        return cls(repeat, batch, str(part))


def _check_earning(earlier: dict[str, Group], group: Group) -> None:
    """Raise a `LogError` where a group has other rewards or percepts than one of equal tasks."""
    config = group.header.get("config")
    if not isinstance(config, dict):
        return
    asked = [config.get(name) for name in ("dataset", "attributes", "answer")]
    other = earlier.setdefault(json.dumps(asked, sort_keys=True), group)
    settings: Any = other.header["config"]
    for name in _EARNING:
        values = [settings.get(name), config.get(name)]
        if values[0] != values[1] and name == "reward":
            values = [_reward(settings), _reward(config)]
        if values[0] != values[1]:
            raise LogError(
                f"{other.file} and {group.file} are runs with different settings: {name} is "
                f"{values[0]!r:.60} and {values[1]!r:.60}; name the logs of one."
            )


def _reward(config: Mapping[str, Any]) -> object:
    """Return the reward of a run, which by default is that of its domain."""
    reward = config.get("reward")
    if reward is None:
        with contextlib.suppress(MealBayesError, OSError):
            return load_domain(config["dataset"]).report_reward
    return reward


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class LoggedOutcomes:
    """Trials of logs, and what the header of each trial's log says of it.

    Attributes
    ----------
    outcomes : TrialOutcomes
        n trials, whose keys name repeat, batch and part as well, so that trials of two agents with
        equal keys are of one task after equally much training.
    repeat, batch : NDArray[np.int64]
        (n,) -1 where the header names none.
    part : NDArray[np.object_]
        (n,) "train", "test", or "" of a run without training.
    """

    outcomes: TrialOutcomes
    repeat: Ints
    batch: Ints
    part: NDArray[np.object_]

    @classmethod
    def read(
        cls, logs: Logs, *, on_group: Callable[[Group], None] | None = None
    ) -> "LoggedOutcomes":
        """Read logs as far as they can be read; `on_group` is called with each group of trials.

        Raises
        ------
        LogError
            Not one trial can be read, the logs are of several data sets, or trials of equal tasks
            have settings by which they earn different rewards.
        """
        columns = list[tuple[TrialOutcomes, Ints, Ints, NDArray[np.object_]]]()
        earlier = dict[str, Group]()
        for group in logs.begun():
            _check_earning(earlier, group)
            if on_group is not None:
                on_group(group)
            log_part = LogPart.of(group.header)
            n = len(group.outcomes)
            columns.append(
                (
                    _keyed(group.outcomes, log_part),
                    np.full(n, log_part.repeat),
                    np.full(n, log_part.batch),
                    np.full(n, log_part.part, object),
                )
            )
        outcomes, repeats, batches, parts = zip(*columns, strict=True)
        return cls(
            TrialOutcomes.join(outcomes),
            np.concatenate(repeats),
            np.concatenate(batches),
            np.concatenate(parts),
        )

    def rows(self, chosen: Bools) -> "LoggedOutcomes":
        """Return some trials, by a mask (n,)."""
        return LoggedOutcomes(
            self.outcomes.rows(chosen), self.repeat[chosen], self.batch[chosen], self.part[chosen]
        )

    @property
    def last_batch(self) -> int | None:
        """The last batch after which every agent was tested; None of a run without training."""
        tested = [
            self.batch[(self.part == TEST) & (self.outcomes.agent == name)]
            for name in self.outcomes.agents
        ]
        return min((int(batch.max()) for batch in tested if len(batch)), default=None)

    def measured(self, batches: int = 1) -> "LoggedOutcomes":
        """Return the trials that measure the agents.

        Of an online run those are the tests after the last so many batches, else all trials.
        """
        if self.last_batch is None:
            return self
        # Later tests of some agents only would compare what has learned differently long.
        recent = (self.batch > self.last_batch - batches) & (self.batch <= self.last_batch)
        return self.rows((self.part == "") | ((self.part == TEST) & recent))

    @property
    def heading(self) -> str:
        """Say which trials `measured` chose of an online run; empty of any other."""
        last = self.last_batch
        if last is None:
            training = bool((self.part == TRAINING).any())
            return "Training trials: no agent has been tested yet." if training else ""
        later = self.batch[self.part == TEST].max() > last
        all_agents = ", the last that every agent was tested after" if later else ""
        left_out = len(self.outcomes) - len(self.measured().outcomes)
        return (
            f"Tests after batch {last}{all_agents}; ECE is of the tests after the last {POOLED} "
            f"batches. The {left_out:,} trials of training and of earlier tests are not counted."
        )

    def batches(self) -> list[BatchOutcomes]:
        """Return the tests of every agent, repeat and batch, with the hours explored before."""
        results = list[BatchOutcomes]()
        for agent in self.outcomes.agents:
            of_agent = self.outcomes.agent == agent
            for repeat in np.unique(self.repeat[of_agent]).tolist():
                rows = of_agent & (self.repeat == repeat)
                trained = rows & (self.part == TRAINING)
                tested = rows & (self.part == TEST)
                for batch in np.unique(self.batch[tested]).tolist():
                    # Tests of batch b come after the training of batches 1 to b.
                    seconds = self.outcomes.cost[trained & (self.batch <= batch)].sum()
                    tests = self.outcomes.rows(tested & (self.batch == batch))
                    hours = float(seconds) / HOUR
                    results.append(BatchOutcomes(agent, repeat, batch, hours, tests))
        return results


def _keyed(outcomes: TrialOutcomes, log_part: LogPart) -> TrialOutcomes:
    """Return outcomes whose keys name repeat, batch and part, if there are any."""
    if log_part == LogPart():
        return outcomes
    keys = [json.dumps([*log_part, key]) for key in outcomes.key]
    return dataclasses.replace(outcomes, key=np.array(keys, object))


class AgentPart(NamedTuple):
    """An agent's trials in one part of a batch, training or tests; `batch` is -1 of no batch."""

    agent: str
    batch: int
    part: str


class ShownTrial(NamedTuple):
    """A trial that is shown, its number in its file, its outcome as one row.

    `trial` is None of a compact log.
    """

    file: Path
    number: int
    outcome: TrialOutcomes
    trial: Trial | None

    @property
    def question(self) -> str:
        """The question as it was asked, or as its log has it."""
        if self.trial is None:
            return outcome_facts(self.outcome, 0)["question"]
        return self.trial.task.question


class Place(NamedTuple):
    """Where a trial is: its file, its number there, and the question as it was asked."""

    file: Path
    number: int
    question: str


class ShownTrials:
    """Trials of groups, as they are read: where each is, and the few that are kept whole.

    Attributes
    ----------
    places : list[Place]
        Of each trial, in the order of `LoggedOutcomes.outcomes`.
    newest : list[ShownTrial]
        The last few trials.
    lab : bool
        Whether the trials are those of a robot's lab, which `Learner.ask` logged.
    """

    def __init__(self) -> None:
        self.places = list[Place]()
        self.newest = list[ShownTrial]()
        self.lab = False
        self._telling: dict[tuple[AgentPart, str], list[ShownTrial]] = {}

    def take(self, group: Group) -> None:
        """Note the places of a group's trials, and keep those that tell most."""
        config = group.header.get("config")
        self.lab |= isinstance(config, dict) and config.get("command") == ASK
        log_part = LogPart.of(group.header)
        outcomes = group.outcomes
        for row, number in enumerate(group.numbers):
            facts = outcome_facts(outcomes, row)
            question = group.trials[row].task.question if group.trials else facts["question"]
            self.places.append(Place(group.file, number, question))
        last = range(max(0, len(outcomes) - TELLING), len(outcomes))
        self.newest = [*self.newest, *_shown_rows(group, last)][-TELLING:]
        for agent in outcomes.agents:
            key = AgentPart(agent, log_part.batch, log_part.part)
            of_agent = outcomes.agent == agent
            for kind, merits in telling_merits(outcomes).items():
                order = np.argsort(-merits, kind="stable")
                rows = order[(of_agent & np.isfinite(merits))[order]][:TELLING].tolist()
                kept = [*self._telling.get((key, kind), ()), *_shown_rows(group, rows)]
                kept.sort(key=lambda shown: -_merit(shown, kind))
                self._telling[key, kind] = kept[:TELLING]

    def worst(self, parts: Sequence[AgentPart]) -> ShownTrial | None:
        """Return the trial of these parts with the lowest reward; None if no truth is known."""
        return next(iter(self._candidates(parts, LOSS)), None)

    def telling(self, parts: Sequence[AgentPart]) -> list[tuple[str, ShownTrial]]:
        """Return up to three trials of some parts of an agent's, and why each is shown.

        They are the one with the lowest reward, the right one that cost most and the one with the
        highest reward; further ones with low rewards where two of these are the same.
        """
        chosen = dict[tuple[Path, int], tuple[str, ShownTrial]]()
        for kind in (LOSS, DEAREST, GAIN):
            for shown in self._candidates(parts, kind)[:1]:
                chosen.setdefault((shown.file, shown.number), (kind, shown))
        for shown in self._candidates(parts, LOSS):
            if len(chosen) < TELLING:
                chosen.setdefault((shown.file, shown.number), ("a low reward", shown))
        return list(chosen.values())

    def _candidates(self, parts: Sequence[AgentPart], kind: str) -> list[ShownTrial]:
        """Return the trials of these parts that may be shown for a reason, the first choice first.

        Of equal ones, the first is that of the earliest part.
        """
        kept = [shown for part in parts for shown in self._telling.get((part, kind), ())]
        return sorted(kept, key=lambda shown: -_merit(shown, kind))


def _merit(shown: ShownTrial, kind: str) -> float:
    return float(telling_merits(shown.outcome)[kind][0])


def telling_merits(outcomes: TrialOutcomes) -> dict[str, Floats]:
    """Return by what trials are chosen to be shown, (n,) each; the largest first, -inf never.

    Of equally low rewards the trial whose belief was surest comes first.
    """
    right = outcomes.judged & (outcomes.success == 1)
    return {
        LOSS: np.where(outcomes.judged, outcomes.certainty - outcomes.reward, -np.inf),
        DEAREST: np.where(right, outcomes.cost, -np.inf),
        GAIN: np.where(right, outcomes.reward, -np.inf),
    }


def worst_first(outcomes: TrialOutcomes) -> Ints:
    """Return the trials whose truth is known, the worst first, (n,).

    They are those with the lowest reward; of equals, those that were surest come first, then the
    earliest.
    """
    order = np.argsort(-telling_merits(outcomes)[LOSS], kind="stable")
    return order[outcomes.judged[order]]


def _shown_rows(group: Group, rows: Sequence[int]) -> Iterator[ShownTrial]:
    """Yield some trials of a group."""
    for row in rows:
        trial = group.trials[row] if group.trials else None
        yield ShownTrial(group.file, group.numbers[row], group.outcomes.rows([row]), trial)
