"""Do intervals of leave-one-object-out results hold over new training sets? Simulated classifiers.

Some objects of two classes have features by a normal law whose mean goes by the class; each object
is recorded a few times. A classifier, the nearer of two class means, is taught by all objects but
one and judges the recordings of that one; trials of an object are one cluster, as in every offline
table of this project. Its interval takes objects as independent, though any two classifiers share
all training objects but one. Printed: how often the 95 % interval of the accuracy contains the
truth, which is the accuracy over new objects after a new training set of as many, where classes lie
near together and far apart; and how often it contains the accuracy over new objects after the
training set at hand, which is what the interval is about.

    python benchmarks/shared_training.py [--json] [--simulations 400] [--objects 32]
"""

import numpy as np
from measuring import options_of, show

from meal_bayes.arrays import Floats
from meal_bayes.evaluation import clustered
from meal_bayes.seeds import stream

FEATURES = 4
RECORDINGS = 5
WITHIN = 0.3  # sd of a recording about its object's own mean
DISTANCES = (0.25, 0.5, 1.0, 2.0)  # between the class means, in sd of objects
NEW = 2000  # objects that stand for all
POSITIVE = 0.5


def draw(rng: np.random.Generator, objects: int, distance: float) -> tuple[Floats, Floats]:
    """Draw features (O,R,F) and labels (O,) of objects; both classes have one."""
    label = (rng.permutation(objects) < objects * POSITIVE).astype(float)
    mean = rng.normal(size=(objects, 1, FEATURES))
    mean[..., 0] += distance * label[:, None]
    features = mean + WITHIN * rng.normal(size=(objects, RECORDINGS, FEATURES))
    return features, label


def right(train: Floats, label: Floats, features: Floats, truth: Floats) -> Floats:
    """Return which recordings (O,R) the nearer class mean of a training set labels right."""
    centers = [train[label == value].mean(axis=(0, 1)) for value in (0, 1)]
    distance = [((features - center) ** 2).sum(axis=-1) for center in centers]
    return np.asarray((distance[1] < distance[0]) == truth[:, None], float)


def main() -> None:
    """Measure, and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--simulations", type=int, default=400)
    parser.add_argument("--objects", type=int, default=32)
    options = parser.parse_args()
    rows = []
    for distance in DISTANCES:
        intervals = []
        mine = []
        for number in range(options.simulations):
            rng = stream(number, "held out", int(100 * distance))
            features, label = draw(rng, options.objects, distance)
            every = np.arange(options.objects)
            # Leave one object out: two training sets of n - 1 share n - 2 objects, so that results
            # of different objects are not independent. Clusters of objects cannot know of that.
            values = np.concatenate(
                [
                    right(features[every != o], label[every != o], features[[o]], label[[o]])
                    for o in every
                ]
            )
            effect = clustered(values.ravel(), np.repeat(every, RECORDINGS), fraction=True)
            intervals.append(effect.interval()[2:])
            mine.append(float(right(features, label, *draw(rng, NEW, distance)).mean()))
        # Two truths: of this training set, on new objects, and its mean over new training sets.
        low, high = np.array(intervals).T
        truth = float(np.mean(mine))
        over_sets = (low <= truth) & (truth <= high)
        at_hand = (low <= mine) & (mine <= high)
        rows.append(
            {
                "classes are apart by": distance,
                "accuracy": truth,
                "contains that over new training sets": float(over_sets.mean()),
                "contains that of its training set": float(at_hand.mean()),
                "of": options.simulations,
                "width": float((high - low).mean()),
            }
        )
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
