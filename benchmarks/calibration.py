"""What beliefs are worth on the real recordings: NLL, Brier, ECE of observation models.

python benchmarks/calibration.py [--dataset NAME ...] [--prior rates|even]
                                 [--attributes all|well|weak] [--json]

Everything is nested: percepts of an object come from classifiers, and what is believed of them
from tables, that never saw it; the prior is the other objects' base rate.

Evidence: k recordings of one behavior (in a row, starting from each; the first follows the last),
one recording of each behavior (the r-th, for every r), all recordings of all behaviors. Counted are
attributes that experiments ask; of their behaviors those with TPR - FPR > .2 on the training
objects of the held-out object at hand, and beliefs of several behaviors are those of these. TPR and
FPR are of the decision: "true" where class-balanced log-odds and the base rate's sum to more than
0.

Intervals are of the NLL, 95 %, whole objects redrawn. Sensitivity and specificity are those of
beliefs above one half; one half counts half. With `--prior even` beliefs start from there: what is
left between the two is the percepts'. Well read are attributes of which some behavior has
TPR - FPR > .6.
"""

import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from measuring import options_of, show
from numpy.typing import NDArray

from meal_bayes.agents import knowledge_without
from meal_bayes.agents.base_rates import learn_base_rates
from meal_bayes.arrays import Floats
from meal_bayes.datasets import PerceptTable, load_percepts
from meal_bayes.datasets.percepts import LIMIT
from meal_bayes.evaluation import (
    brier,
    calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
)
from meal_bayes.experiments import askable
from meal_bayes.perception.confusion import by_truth, youden
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.checks import log_likelihood
from meal_bayes.posterior.trait import learn_trait, truth_evidence
from meal_bayes.seeds import stream
from paper_repro.inference import bootstrap_interval

DEFAULT = "shared trait"
LEVELS = {"counts": 2, "object level": 2, "graded": 4, DEFAULT: 4}
USEFUL = 0.2  # TPR - FPR of the pairs that count
WELL = 0.6  # of attributes that are read well, by some behavior
SETS = 500  # bootstrap draws


class Model(NamedTuple):
    """An observation model without one object: P attributes, E behaviors, C latent classes."""

    confusion: Floats  # (P,E,C,K)
    precision: Floats  # (P,E,C)
    latent_classes: Floats  # (2,C) Pr(class | truth)


class Fold(NamedTuple):
    """What is known without one object."""

    prior: Floats  # (P,) log-odds
    useful: NDArray[np.bool_]  # (P,E)
    models: dict[str, Model]


def folds(table: PerceptTable, columns: list[int]) -> Iterator[Fold]:
    """Learn every observation model without each object in turn."""
    labels = table.labels
    posteriors = {}
    for levels in (2, 4):
        counts = (by_truth(table.training_levels(o, levels), labels) for o in range(len(labels)))
        posteriors[levels] = list(map(ConfusionPosterior.from_objects, counts))
    for o in range(len(labels)):
        others = np.delete(labels, o, axis=0)
        rates = learn_base_rates(table.domain, others).mean
        prior = np.log(rates) - np.log1p(-rates)
        models = {}
        for levels, graded in ((2, "object level"), (4, "graded")):
            models[graded] = Model(*posteriors[levels][o].select(columns), np.eye(2))
        paper = ConfusionPosterior.from_counts(posteriors[2][o].counts)
        models["counts"] = Model(*paper.select(columns, exact=True), np.eye(2))
        trait = learn_trait(posteriors[4][o], table.training_levels(o, 4), labels, rates)
        rows = trait.select(*posteriors[4][o].select(columns))
        models[DEFAULT] = Model(*rows, trait.latent_classes)
        useful = youden(decisions(table, o, prior))[columns] > USEFUL
        yield Fold(prior[columns], useful, models)


def decisions(table: PerceptTable, held_out: int, prior: Floats) -> Floats:
    """Count what would be decided of the training objects, (P,E,2,2) by truth and decision.

    Of the fine bin that holds the threshold, the share beyond it; outer bins reach to the limit.
    """
    ends = np.concatenate([[-LIMIT], table.edges, [LIMIT]])
    yes = np.clip((ends[1:] + prior[:, None]) / np.diff(ends), 0.0, 1.0)  # (P,L)
    bins = by_truth(table.training_bins[held_out].astype(np.int64), table.labels).sum(axis=0)
    split = [(bins * side[:, None, None, :]).sum(axis=-1) for side in (1 - yes, yes)]
    return np.stack(split, axis=-1)


def log_odds(model: Model, shown: NDArray[np.int64], prior: Floats, used: Floats | None) -> Floats:
    """Belief after percepts (S,P,E,K): of each behavior, (S,P,E), or of those used, (S,P)."""
    counts = shown.astype(float)
    seen = np.stack(
        [
            log_likelihood(counts, model.confusion[:, :, c], model.precision[:, :, c])
            for c in range(model.latent_classes.shape[1])
        ],
        axis=-1,
    )  # (S,P,E,C)
    # Behaviors are independent given the truth and the latent class, over which truths are summed;
    # prior log-odds of the attribute are added.
    log_classes = np.log(np.maximum(model.latent_classes, 1e-300))
    if used is None:
        return np.asarray(prior[:, None] + truth_evidence(seen, log_classes))
    return np.asarray(prior + truth_evidence((seen * used[..., None]).sum(axis=2), log_classes))


def evidence(recordings: int) -> dict[str, list[NDArray[np.int64]]]:
    """Which recordings each kind of evidence takes, at a time.

    Runs of k go round in a ring, so that all recordings are in equally many: were the fifth of
    five left out for k = 2, it would be missed or spared there alone.
    """
    choices = {}
    for k in (1, 2, 5, 10):
        if k <= recordings:
            starts = range(recordings if k < recordings else 1)
            choices[f"k={k}"] = [(np.arange(k) + start) % recordings for start in starts]
    choices["all_once"] = [np.array([r]) for r in range(recordings)]
    choices["all"] = [np.arange(recordings)]
    return choices


def chosen(table: PerceptTable, attributes: str) -> list[int]:
    """Return the columns of what experiments ask: all, those read "well", or "weak" ones."""
    columns = table.domain.columns(askable(table))
    if attributes == "all":
        return columns
    counts = by_truth(table.training_levels(0, 2), table.labels).sum(axis=0)
    well = youden(counts).max(axis=1) > WELL
    return [p for p in columns if well[p] == (attributes == "well")]


def measure(name: str, attributes: str, prior: str) -> tuple[list[dict[str, Any]], float]:
    """Measure one data set: rows, and CPU seconds of learning all folds of the default."""
    table = load_percepts(name)
    columns = chosen(table, attributes)
    start = time.process_time()
    for o in range(len(table.objects)):
        knowledge_without(table, o, levels=LEVELS[DEFAULT])
    seconds = time.process_time() - start
    known = list(folds(table, columns))
    if prior == "even":
        known = [fold._replace(prior=np.zeros_like(fold.prior)) for fold in known]
    rows = []
    for kind, sets in evidence(table.recordings).items():
        for model in LEVELS:
            cases = [
                beliefs(table, columns, fold, model, held_out=o, sets=sets, kind=kind)
                for o, fold in enumerate(known)
            ]
            objects = np.repeat(np.arange(len(known)), [len(positive) for positive, _ in cases])
            positive, truth = (np.concatenate(part) for part in zip(*cases, strict=True))
            rows.append(
                {"dataset": name, "evidence": kind, "observation_model": model}
                | score(positive, truth, objects)
            )
    return rows, seconds


def beliefs(
    table: PerceptTable,
    columns: list[int],
    fold: Fold,
    model: str,
    held_out: int,
    sets: list[NDArray[np.int64]],
    kind: str,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Beliefs (n,) in what a held-out object is, and its truth, after each set of recordings."""
    outputs = table.log_odds[held_out][..., columns].astype(float)  # (R,E,P)
    seen = table.levels_of(np.nan_to_num(outputs), LEVELS[model]).transpose(0, 2, 1)
    each = seen[..., None] == np.arange(LEVELS[model])  # (R,P,E,K)
    shown = np.stack([each[part].sum(axis=0) for part in sets])
    truth = table.labels[held_out, columns] == 1
    single = kind.startswith("k=")
    odds = log_odds(fold.models[model], shown, fold.prior, None if single else fold.useful)
    value = np.broadcast_to(truth[:, None] if single else truth, odds.shape)
    counted = np.broadcast_to(fold.useful if single else True, odds.shape)
    return 1 / (1 + np.exp(-odds[counted])), value[counted]


def score(
    positive: Floats, truth: NDArray[np.bool_], objects: NDArray[np.int64]
) -> dict[str, float]:
    """Measure beliefs."""
    # Beliefs in one object are alike, and negative log-likelihoods skewed: whole objects are drawn.
    nll = bootstrap_interval(
        negative_log_likelihood(positive, truth), objects, stream(0, "calibration"), draws=SETS
    )
    return {
        "nll": nll.estimate,
        "nll_se": nll.se,
        "nll_low": nll.low,
        "nll_high": nll.high,
        "brier": float(brier(positive, truth).mean()),
        "ece": calibration_error(positive, truth),
        "ece_calibrated": expected_calibration_error(positive, stream(0, "calibrated belief")),
        "accuracy": float(((positive > 0.5) == truth).mean()),
        "sensitivity": float(np.heaviside(positive[truth] - 0.5, 0.5).mean()),
        "specificity": float(np.heaviside(0.5 - positive[~truth], 0.5).mean()),
    }


def main() -> None:
    """Measure the data sets and print a table, or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--dataset", nargs="+", default=["roc36", "ispy32", "cy101"])
    parser.add_argument("--prior", choices=("rates", "even"), default="rates")
    parser.add_argument("--attributes", choices=("all", "well", "weak"), default="all")
    options = parser.parse_args()
    rows = []
    seconds = {}
    for name in options.dataset:
        of_data, seconds[name] = measure(name, options.attributes, options.prior)
        rows += of_data
    show(rows, {"default": DEFAULT, "fit_cpu_s": seconds, "rows": rows} if options.json else None)
    if not options.json:
        print(f"\nCPU seconds of all folds of {DEFAULT!r}, the default: {seconds}")


if __name__ == "__main__":
    main()
