"""What one word costs: seconds of `tell` and `forget`, and of the refit that it saves.

    python benchmarks/learner.py [--json]
    python benchmarks/learner.py --refits SEEDS [--json]

Real recordings (MEAL_BAYES_DATA_URL, or downloaded once); the robot replays an object of them under
a name that the learner has not met. CPU milliseconds, the median and the largest of the words.

With `--refits`, what it brings to fit anew more often: `bayes` begins with nothing and is asked for
one attribute of an object, and told it, TRIALS times, two thirds of the objects in turn; then it is
tested on the others. Reward and accuracy of these tests, the reward on the way, and CPU seconds of
the trials on the way, by `refit_every`; seeds (1,2,...) draw objects, questions and luck alike.
"""

import itertools
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from measuring import options_of, show

from meal_bayes import Learner, load_dataset
from meal_bayes.agents import Agent
from meal_bayes.planners import Predefined
from meal_bayes.robots.recorded import RecordedRobot, replayable
from meal_bayes.seeds import stream

WORDS = 30
BAR = 5.0  # ms
TRIALS = 100
TESTS = 100
REFITS = (0.001, 0.1, 0.2, 0.5)  # parts by which labeled recordings grew; first: every label


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
        "all behaviors",
        lambda domain, query: Predefined(sequence),
        object_level=True,
        shared_trait=True,
        base_rates=True,
        levels=4,
    )
    learner = Learner(domain, agent=agent, refit_every=None, logs=None)
    fit = milliseconds(lambda: learner.fit(dataset))
    before = learner.knowledge().posterior.concentration
    trials = []
    values = []
    for n in range(WORDS):
        o = n % len(dataset.objects)
        known = np.flatnonzero(dataset.labels[o] >= 0)
        names = [domain.attributes[p] for p in known[: 1 + n % 3]]
        luck = (stream(n, part) for part in ("order", "failures"))
        robot = RecordedRobot(domain, o, replayable(dataset)[o], *luck, dataset)
        trials.append(learner.ask(names, robot))
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


def answers(truth: dict[str, bool], rng: np.random.Generator, accuracy: float) -> dict[str, bool]:
    """Return what a person says who is right with such an accuracy."""
    return {name: bool(rng.random() < accuracy) == value for name, value in truth.items()}


def refits(name: str, seed: int, refit_every: float) -> dict[str, object]:
    """Measure a learner that begins with nothing and fits anew so often."""
    dataset = load_dataset(name)
    domain = dataset.domain
    rng = stream(seed, "refits", name)
    objects = rng.permutation(len(dataset.objects))
    tested = len(objects) // 3
    learner = Learner(domain, refit_every=refit_every, seed=seed, logs=None)
    rewards = []
    begin = time.process_time()
    for n in range(TRIALS + TESTS):
        part = objects[tested:] if n < TRIALS else objects[:tested]
        o = int(part[n % len(part)])
        p = int(rng.choice(np.flatnonzero(dataset.labels[o] >= 0)))
        value = bool(dataset.labels[o, p])
        truth = {domain.attributes[p]: value}
        learns = n < TRIALS
        luck = (stream(seed, "refits", n, part) for part in ("order", "failures"))
        robot = RecordedRobot(
            domain,
            o,
            replayable(dataset)[o],
            *luck,
            dataset,
            person=partial(answers, truth, stream(seed, "refits", n, "errors")),
        )
        trial = learner.ask(
            list(truth), robot, truth=truth, object_name=dataset.objects[o], learn=learns
        )
        if learns:
            learner.tell(trial, truth)
        if n == TRIALS - 1:
            seconds = time.process_time() - begin
        rewards.append((trial.reward, trial.success))
    way = np.array(rewards[:TRIALS], float)
    tests = np.array(rewards[TRIALS:], float)
    return {
        "dataset": name,
        "seed": seed,
        "refit_every": refit_every,
        "reward": float(tests[:, 0].mean()),
        "accuracy": float(tests[:, 1].mean()),
        "reward_on_the_way": float(way[:, 0].mean()),
        "cpu_s": seconds,
    }


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--refits", metavar="1,2,...", help="seeds, see above")
    options = parser.parse_args()
    if options.refits:
        seeds = [int(seed) for seed in options.refits.split(",")]
        settings = itertools.product(("roc36", "cy101", "ispy32"), seeds, REFITS)
        rows = [refits(*setting) for setting in settings]
    else:
        rows = [measure(name) for name in ("roc36", "cy101", "ispy32")]
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
