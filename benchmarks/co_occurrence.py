"""What a joint prior over pairs of attributes says, before and after percepts.

python benchmarks/co_occurrence.py [--dataset NAME ...] [--json]

Pairs and their prior are those of `agents/joint_prior.py`. Everything is learned without the
object at hand, percepts as in `calibration.py`: one recording of each behavior, or none.

Rows are of all pairs of attributes that runs ask, but for values of one group, and of those
coupled; gains are of the coupled prior less the product, means over objects and coupled pairs with
standard errors by object: log-likelihood (nats) and accuracy of both values. `both` is how often
both are said to be true of pairs that no training object has both of: by the product, and by the
coupled prior. What it earns is measured by `coupled.py`.
"""

import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import calibration
import numpy as np
from measuring import options_of, show
from numpy.typing import NDArray
from scipy.special import expit

from meal_bayes.agents.base_rates import learn_base_rates
from meal_bayes.agents.joint_prior import coupled_pairs
from meal_bayes.arrays import Floats
from meal_bayes.datasets import PerceptTable, load_percepts
from meal_bayes.experiments import askable

EVIDENCE = ("none", "all_once")


class Case(NamedTuple):
    """Of one pair, object and set of recordings: gains, and what is said of pairs without both."""

    held_out: int
    log_likelihood: float
    accuracy: float
    exclusive: bool
    both: tuple[bool, bool]  # by the product, and by the coupled prior


def product(first: float, second: float) -> Floats:
    """Return Pr(values) (4,) of independent attributes: neither, the second, the first, both."""
    return np.outer([1 - first, first], [1 - second, second]).ravel()


def pairs_of(table: PerceptTable, columns: list[int]) -> int:
    """Return how many pairs of columns are not values of one group."""
    group = {name: g for g, names in table.domain.groups.items() for name in names}
    names = [table.domain.attributes[p] for p in columns]
    pairs = itertools.combinations(names, 2)
    return sum(group.get(first, first) != group.get(second, second) for first, second in pairs)


def cases(
    table: PerceptTable, columns: list[int], known: list[calibration.Fold], kind: str
) -> Iterator[Case]:
    """Yield a case for each coupled pair, object and set of recordings."""
    for held_out, fold in enumerate(known):
        others = np.delete(table.labels, held_out, axis=0)
        learned = coupled_pairs(table.domain, others, learn_base_rates(table.domain, others).mean)
        beliefs = believed(table, columns, fold, held_out, kind)  # (S,P)
        rates = expit(fold.prior)
        for pair, prior in zip(learned.pairs.tolist(), learned.probability, strict=True):
            truth = table.labels[held_out, pair]
            if not {*pair} <= {*columns} or (truth < 0).any():
                continue
            i, j = (columns.index(column) for column in pair)
            right = 2 * int(truth[0]) + int(truth[1])
            exclusive = not (others[:, pair] == 1).all(axis=1).any()
            for belief in beliefs:
                plain = product(belief[i], belief[j])
                better = plain * prior / product(rates[i], rates[j])
                better /= better.sum()
                yield Case(
                    held_out=held_out,
                    log_likelihood=float(np.log(better[right]) - np.log(plain[right])),
                    accuracy=float(better.argmax() == right) - float(plain.argmax() == right),
                    exclusive=exclusive,
                    both=(bool(plain.argmax() == 3), bool(better.argmax() == 3)),
                )


def believed(
    table: PerceptTable, columns: list[int], fold: calibration.Fold, held_out: int, kind: str
) -> Floats:
    """Return Pr(true) (S,P) of a held-out object after each set of recordings."""
    if kind == "none":
        return expit(fold.prior)[None]
    levels = calibration.LEVELS[calibration.DEFAULT]
    outputs = table.log_odds[held_out][..., columns].astype(float)  # (R,E,P)
    seen = table.levels_of(np.nan_to_num(outputs), levels).transpose(0, 2, 1)
    each = seen[..., None] == np.arange(levels)  # (R,P,E,K)
    sets = calibration.evidence(table.recordings)[kind]
    shown = np.stack([each[part].sum(axis=0) for part in sets])
    model = fold.models[calibration.DEFAULT]
    return expit(calibration.log_odds(model, shown, fold.prior, fold.useful))


def mean_and_error(values: Floats, held_out: NDArray[np.int64]) -> tuple[float, float]:
    """Return the mean and its standard error, whole objects being cases."""
    if not len(values):
        return np.nan, np.nan
    sums = np.bincount(held_out, values - values.mean())
    return float(values.mean()), float(np.sqrt((sums**2).sum()) / len(values))


def measure(name: str) -> list[dict[str, Any]]:
    """Measure one data set: a row for each kind of evidence."""
    table = load_percepts(name)
    columns = table.domain.columns(askable(table))
    known = list(calibration.folds(table, columns))
    rows = []
    for kind in EVIDENCE:
        some = list(cases(table, columns, known, kind))
        objects = np.array([case.held_out for case in some], np.int64)
        gain, gain_se = mean_and_error(np.array([c.log_likelihood for c in some]), objects)
        more, more_se = mean_and_error(np.array([c.accuracy for c in some]), objects)
        exclusive = np.array([case.both for case in some if case.exclusive]).reshape(-1, 2)
        sets = 1 if kind == "none" else table.recordings
        row = {
            "dataset": name,
            "evidence": kind,
            "pairs": pairs_of(table, columns),
            "coupled": len(some) / (sets * len(known)),  # of one object, on average
            "log_likelihood": gain,
            "log_likelihood_se": gain_se,
            "accuracy": more,
            "accuracy_se": more_se,
            "exclusive": len(exclusive),
            "both_by_product": int(exclusive[:, 0].sum()),
            "both_coupled": int(exclusive[:, 1].sum()),
        }
        rows.append(row)
    return rows


def main() -> None:
    """Measure the data sets and print a table, or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--dataset", nargs="+", default=["roc36", "ispy32", "cy101"])
    options = parser.parse_args()
    rows = [row for name in options.dataset for row in measure(name)]
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
