"""What one word costs: seconds of `tell` and `forget`, and of the refit that it saves.

    python benchmarks/learner.py [--json]

Real recordings (MEAL_BAYES_DATA_URL, or downloaded once); the robot replays an object of them under
a name that the learner has not met. CPU milliseconds, the median and the largest of the words.
"""

import argparse
import json
import time
from collections.abc import Callable

import numpy as np

from meal_bayes import Learner, Outcome, load_dataset
from meal_bayes.agents import Agent
from meal_bayes.datasets import Dataset
from meal_bayes.planners import Predefined

WORDS = 30
BAR = 5.0  # ms


class Replayer:
    """Hands the recordings of one object out, whatever the state."""

    def __init__(self, dataset: Dataset, o: int) -> None:
        self._dataset, self._object = dataset, o
        self._states = dataset.domain.diagram

    def start(self) -> str:
        """Return to the start."""
        self._state = self._states.start
        return self._state

    def execute(self, behavior: str) -> Outcome:
        """Succeed, and hand the first recording out."""
        self._state = self._states.successes(self._state).get(behavior, self._state)
        modalities = self._dataset.domain.behaviors[
            self._dataset.domain.behavior_index(behavior)
        ].modalities
        if not modalities:
            return Outcome(self._state)
        return Outcome(self._state, self._dataset.instance(self._object, behavior, 0).features)


def milliseconds(work: Callable[[], object]) -> float:
    """Measure the CPU time of a call, ms."""
    begin = time.process_time()
    work()
    return 1000 * (time.process_time() - begin)


def measure(name: str) -> dict[str, object]:
    """Measure words about the objects of a data set."""
    dataset = load_dataset(name)
    domain = dataset.domain
    sequence = domain.default_sequence
    agent = Agent(
        "all behaviors", lambda domain, query: Predefined(sequence),
        object_level=True, shared_trait=True, base_rates=True, levels=4,
    )  # fmt: skip
    learner = Learner(domain, agent=agent, refit_every=None, logs=None)
    fit = milliseconds(lambda: learner.fit(dataset))
    before = learner.knowledge().posterior.concentration
    trials, values = [], []
    for n in range(WORDS):
        o = n % len(dataset.objects)
        known = np.flatnonzero(dataset.labels[o] >= 0)
        names = [domain.attributes[p] for p in known[: 1 + n % 3]]
        trials.append(learner.ask(names, Replayer(dataset, o)))
        values.append(
            {name: bool(dataset.labels[o, domain.attribute_index(name)]) for name in names}
        )
    pairs = list(zip(trials, values, strict=True))
    told = [milliseconds(lambda t=t, v=v: learner.tell(t, v)) for t, v in pairs]
    forgotten = [milliseconds(lambda t=t: learner.forget(t)) for t in trials]
    left = np.abs(learner.knowledge().posterior.concentration - before).max()
    for trial, value in pairs:
        learner.tell(trial, value)
    refit = milliseconds(learner.refit)
    return {
        "dataset": name,
        "objects": len(dataset.objects),
        "tell_ms": float(np.median(told)),
        "tell_worst_ms": max(told),
        "forget_ms": float(np.median(forgotten)),
        "fit_ms": fit,
        "refit_ms": refit,
        "left_after_forgetting": float(left),
        "bar_ms": BAR,
    }


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    wanted = parser.parse_args()
    rows = [measure(name) for name in ("roc36", "cy101", "ispy32")]
    if wanted.json:
        print(json.dumps(rows))
        return
    for row in rows:
        print(
            f"{row['dataset']:<8} tell {row['tell_ms']:.2f} ms (worst {row['tell_worst_ms']:.2f}, "
            f"bar {BAR:g}), forget {row['forget_ms']:.2f} ms, fit {row['fit_ms']:.0f} ms, refit "
            f"{row['refit_ms']:.0f} ms; left after forgetting {row['left_after_forgetting']:.1e}"
        )


if __name__ == "__main__":
    main()
