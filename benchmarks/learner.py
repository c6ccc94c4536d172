"""What it brings to fit anew more often, on recordings, of a robot that begins with nothing.

    python benchmarks/learner.py --refits 1,2,3 [--json]

`bayes` is asked for one attribute of an object, and told it, TRIALS times, two thirds of the
objects in turn; then it is tested on the others. Reward and accuracy of these tests, the reward on
the way, and CPU seconds of the trials on the way, by `refit_every`; seeds draw objects, questions
and luck alike. It needs the recordings.
"""

import itertools
import time
from functools import partial

import numpy as np
from knowing_little import answers
from measuring import options_of, show

from meal_bayes import Learner, load_dataset
from meal_bayes.robots.recorded import RecordedRobot, replayable
from meal_bayes.seeds import stream

DATASETS = ("roc36", "cy101", "ispy32")
TRIALS = 100
TESTS = 100
REFITS = (0.001, 0.1, 0.2, 0.5)  # parts by which labeled recordings grew; first: every label


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
    parser.add_argument("--refits", metavar="1,2,...", default="1,2,3", help="seeds")
    options = parser.parse_args()
    seeds = [int(seed) for seed in options.refits.split(",")]
    rows = [refits(*setting) for setting in itertools.product(DATASETS, seeds, REFITS)]
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
