"""Outcomes of logs, and which of them measure an agent: of an online run, its last tests.

The logs of an online run hold training trials, and tests after every batch of them. Pooled, they
would be measures of nobody: of an agent that knew nothing and of what it became.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Bools, Ints
from meal_bayes.evaluation.learning import POOLED
from meal_bayes.trial_log import Group, Logs
from meal_bayes.trial_log.logs import of_search
from meal_bayes.trials import BatchOutcomes, TrialOutcomes
from meal_bayes.trials.outcomes import HOUR

TRAINING = "train"  # parts of a batch, in the header of its log and at the end of its name
TEST = "test"
SEARCHED = "searched"  # an object that a search turned to, and may have left for another
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
        if of_search(header):
            return cls(part=SEARCHED)
        if not isinstance(repeat, int):
            repeat = _NONE
        if part not in (TRAINING, TEST) or not isinstance(batch, int):
            return cls(repeat)
        return cls(repeat, batch, str(part))


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
        (n,) "train", "test", "searched", or "" of a run without training.
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
            Not one trial can be read, or the logs are of several data sets.
        """
        columns = list[tuple[TrialOutcomes, Ints, Ints, NDArray[np.object_]]]()
        for group in logs.shown():
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

        Of an online run those are the tests after the last so many batches, else all trials but
        those of searches, which mean nothing apart; these only where there are no others.
        """
        if self.last_batch is None:
            alone = self.part != SEARCHED
            return self.rows(alone) if alone.any() and not alone.all() else self
        # Later tests of some agents only would compare what has learned differently long.
        recent = (self.batch > self.last_batch - batches) & (self.batch <= self.last_batch)
        return self.rows((self.part == "") | ((self.part == TEST) & recent))

    @property
    def searched(self) -> bool:
        """Whether all trials are those of searches."""
        return bool((self.part == SEARCHED).all())

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
