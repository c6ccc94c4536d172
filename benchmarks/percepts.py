"""Held-out percepts beside plain logistic regression's, over the number of positive objects.

python benchmarks/percepts.py [--dataset NAME ...] [--part odd|even] [--seed S]
                              [--permuted] [--json]

Attributes are the data set's whose index is odd: what the percepts' formulas were chosen on were
the even ones. Each comes as it is, and with positive objects taken away until 9, 6, 4 or 3 are
left (`--seed` draws which). Logistic regression (C = .02) learns from the features of all
modalities side by side, standardized, by ten folds of objects; ours by leaving each object out.

Rows have the mean AUC and log-loss (nats, base rates added) over pairs of attribute and behavior,
the difference of the AUC where logistic regression has more than .6, with its standard error by
attributes, and how many pairs have an AUC below one half by more than two standard errors.
`--permuted` shuffles the labels over the objects: nothing can be learned.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from held_out import permuted
from measuring import options_of, show
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from meal_bayes.arrays import Floats, Ints
from meal_bayes.datasets import Dataset, TrainingSet, load_dataset
from meal_bayes.perception import DEFAULT
from meal_bayes.perception.feature_spaces import assign_folds, gather, number_in_object
from meal_bayes.perception.fitting import method_of
from meal_bayes.perception.kernel_widths import learned_widths
from meal_bayes.seeds import stream

LEFT = (3, 4, 6, 9)  # positive objects
C = 0.02  # of logistic regression, the inverse of its ridge
FOLDS = 10
PARITY = {"odd": 1, "even": 0}
READ = 0.6  # AUC of logistic regression of pairs that can be read


class Variant(NamedTuple):
    """Labels (O,) of one attribute, -1 of positive objects that were taken away."""

    attribute: int
    labels: Ints
    whole: bool


def variants(dataset: Dataset, parity: int, seed: int) -> Iterator[Variant]:
    """Yield the attributes whose index is odd (1) or even (0), whole and made rarer."""
    rng = stream(seed, "rare attributes", dataset.domain.data)
    for attribute in range(parity, len(dataset.domain.attributes), 2):
        labels = dataset.labels[:, attribute].astype(np.int64)
        positive = np.flatnonzero(labels == 1)
        n_negative = (labels == 0).sum()
        if len(positive) < min(LEFT) or n_negative < 2 * min(LEFT):
            continue
        yield Variant(attribute, labels, whole=True)
        for left in LEFT:
            if left < len(positive) and 2 * left < n_negative:
                rarer = labels.copy()
                rarer[rng.permutation(positive)[left:]] = -1
                yield Variant(attribute, rarer, whole=False)


def components(features: Floats) -> Floats:
    """Return the principal components (n,r) of standardized features (n,D).

    An L2 penalty is the same in any rotation, so logistic regression is the same on them.
    """
    scale = features.std(axis=0)
    standardized = (features - features.mean(axis=0)) / np.where(scale > 1e-12, scale, 1.0)
    left, values, _ = np.linalg.svd(standardized, full_matrices=False)
    return np.asarray(left * values)


def logistic(objects: Ints, features: Floats, variant: Variant) -> Floats:
    """Score recordings (n,) by logistic regression that never saw the object's fold.

    Folds are stratified by label: were they not, those without a true object would teach a higher
    base rate, and true objects would look the less true.
    """
    folds = np.empty(len(variant.labels), np.int64)
    for label in (-1, 0, 1):
        (some,) = np.nonzero(variant.labels == label)
        folds[some] = assign_folds(np.arange(len(some)), FOLDS)
    fold_of = folds[objects]
    labels = variant.labels[objects]
    outputs = np.full(len(objects), np.nan)
    for fold in range(FOLDS):
        train = (fold_of != fold) & (labels >= 0)
        test = (fold_of == fold) & (labels >= 0)
        if test.any():
            model = LogisticRegression(C=C, max_iter=300).fit(features[train], labels[train])
            outputs[test] = model.decision_function(features[test])
    return outputs


def log_loss(log_odds: Floats, truth: Ints) -> float:
    """Return the mean negative log-likelihood of the truth, in nats."""
    return float(np.logaddexp(0.0, np.where(truth == 1, -log_odds, log_odds)).mean())


def compare(variant: Variant, ours: Floats, plain: Floats, labels: Ints) -> dict[str, Any]:
    """Compare outputs (n,) of recordings whose labels (n,) are known, of one behavior."""
    known = labels >= 0
    truth = labels[known]
    positive = int((variant.labels == 1).sum())
    negative = int((variant.labels == 0).sum())
    # The base rate of the other objects, as ours are class-balanced.
    others = positive - (truth == 1) + 1, negative - (truth == 0) + 1
    auc = float(roc_auc_score(truth, ours[known]))
    lr_auc = float(roc_auc_score(truth, plain[known]))
    # The standard error of an AUC of one half, with objects as cases [Hanley1982].
    chance = 0.5 - 2 * np.sqrt((positive + negative + 1) / (12 * positive * negative))
    return {
        "attribute": variant.attribute,
        "whole": variant.whole,
        "positive": positive,
        "auc": auc,
        "lr_auc": lr_auc,
        "below_chance": bool(auc < chance),
        "lr_below_chance": bool(lr_auc < chance),
        "log_loss": log_loss(ours[known] + np.log(others[0] / others[1]), truth),
        "lr_log_loss": log_loss(plain[known], truth),
    }


def measure(
    name: str, root: str | None, parity: int, seed: int, shuffled: bool
) -> list[dict[str, Any]]:
    """Return a row for each variant of an attribute and behavior."""
    dataset = load_dataset(name, root=root)
    if shuffled:
        dataset = permuted(dataset, stream(seed, "permuted labels", name))
    chosen = list(variants(dataset, parity, seed))
    by_object = np.stack([variant.labels for variant in chosen], axis=1)
    asked = tuple(dataset.domain.attributes[variant.attribute] for variant in chosen)
    gathered = gather(dataset, TrainingSet.everything(dataset), DEFAULT)
    width, _ = learned_widths(gathered.values(), DEFAULT)
    rows = []
    for e, recordings in gathered.items():
        objects = recordings.objects
        behavior = dataset.domain.behaviors[e]
        labels = by_object[objects]
        wide = replace(recordings.widened(width), labels=labels.astype(np.int8), questions=asked)
        _, ours = method_of(DEFAULT).fit(wide, DEFAULT)
        of_modalities = [
            dataset.features[behavior.name, modality][objects, number_in_object(objects)]
            for modality in behavior.modalities
        ]
        features = components(np.hstack(of_modalities))
        for v, variant in enumerate(chosen):
            plain = logistic(objects, features, variant)
            row = compare(variant, ours[:, v], plain, labels[:, v])
            rows.append({"dataset": name, "behavior": behavior.name, **row})
    return rows


def summarize(rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield a row of each data set and number of positives, and of all its rows."""
    for name in dict.fromkeys(row["dataset"] for row in rows):
        of_data = [row for row in rows if row["dataset"] == name]
        sizes = {
            f"{n}": [r for r in of_data if not r["whole"] and r["positive"] == n] for n in LEFT
        }
        whole = [row for row in of_data if row["whole"]]
        for positives, some in {**sizes, "as they are": whole, "all": of_data}.items():
            if some:
                yield {"dataset": name, "positives": positives, **summary(some)}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return means over rows, and of those that can be read the difference of the AUC."""
    columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    read = columns["lr_auc"] > READ
    gain = (columns["auc"] - columns["lr_auc"])[read]
    # Behaviors and rarer variants of one attribute share its objects.
    _, attribute = np.unique(columns["attribute"][read], return_inverse=True)
    sums = np.bincount(attribute, gain - gain.mean() if len(gain) else gain)
    means = {key: columns[key].mean() for key in ("auc", "lr_auc", "log_loss", "lr_log_loss")}
    return {
        "pairs": len(rows),
        **means,
        "read": int(read.sum()),
        "gain": gain.mean() if len(gain) else np.nan,
        "gain_se": np.sqrt((sums**2).sum()) / max(len(gain), 1),
        "below_chance": int(columns["below_chance"].sum()),
        "lr_below_chance": int(columns["lr_below_chance"].sum()),
    }


def main() -> None:
    """Measure the data sets and print a table, or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--dataset", nargs="+", default=["roc36", "ispy32", "cy101"])
    parser.add_argument("--root", help="folder mirror of the recordings; downloaded by default")
    parser.add_argument("--part", choices=PARITY, default="odd", help="attributes, by their index")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--permuted", action="store_true", help="shuffle labels over the objects")
    options = parser.parse_args()
    parity = PARITY[options.part]
    rows = [
        row
        for name in options.dataset
        for row in measure(name, options.root, parity, options.seed, options.permuted)
    ]
    show(list(summarize(rows)), rows if options.json else None)


if __name__ == "__main__":
    main()
