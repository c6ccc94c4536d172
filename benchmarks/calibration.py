"""What beliefs are worth on the real recordings: NLL, Brier, ECE of observation models.

python benchmarks/calibration.py [--part beliefs|answers|without|simulated] [--dataset NAME ...]
                                 [--prior rates|even] [--attributes all|well|weak] [--json]
                                 [--seed S] [--trials N]

Everything is nested: percepts of an object come from classifiers, and what is believed of them
from tables, that never saw it; the prior is the other objects' base rate.

`beliefs` (default): k recordings of one behavior (in a row, starting from each; the first follows
the last), one recording of each behavior (the r-th, for every r), all recordings of all behaviors.
Counted are attributes that experiments ask; of their behaviors those with TPR - FPR > .2 on the
training objects of the held-out object at hand, and beliefs of several behaviors are those of
these. TPR and FPR are of the decision: "true" where class-balanced log-odds and the base rate's sum
to more than 0. Intervals are of the NLL, 95 %, whole objects redrawn. Sensitivity and specificity
are those of beliefs above one half; one half counts half. With `--prior even` beliefs start from
there: what is left between the two is the percepts'. Well read are attributes of which some
behavior has TPR - FPR > .6.

What decides is Pr(all asked attributes are right), when the agent stops by itself. `answers` shows
it in the trials of `run offline` by number of attributes: what `bayes` says when it answers, how
often that is right, and the gap, with 95 % intervals by object. `without` pairs `bayes` with itself
planned with a discount of .99, and without the trait, on the same questions. `simulated` draws
objects and percepts from what the agent believes: z of said less right.
"""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from measuring import options_of, show
from numpy.typing import NDArray
from rollout import simulate

from meal_bayes import Learner
from meal_bayes.agents import knowledge_without, load_agent
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
from meal_bayes.evaluation.statistics import clustered
from meal_bayes.experiments import askable
from meal_bayes.experiments.offline import offline_tasks
from meal_bayes.perception.confusion import by_truth, youden
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.checks import log_likelihood
from meal_bayes.posterior.trait import learn_trait, truth_evidence
from meal_bayes.seeds import stream
from meal_bayes.trials import Trial
from paper_repro.inference import bootstrap_interval

DEFAULT = "shared trait"
LEVELS = {"counts": 2, "object level": 2, "graded": 4, DEFAULT: 4}
USEFUL = 0.2  # TPR - FPR of the pairs that count
WELL = 0.6  # of attributes that are read well, by some behavior
SETS = 500  # bootstrap draws
SEED = 6201  # none by which the model was chosen
ASKED = {"roc36": (2, 3), "ispy32": (1, 2, 3), "cy101": (1, 2)}
TRIALS = {"roc36": 2000, "ispy32": 2000, "cy101": 1000}
EPISODES = 5  # simulated of each question

Row = dict[str, Any]


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


def answers(name: str, n: int, trials: int, seed: int) -> Row:
    """Measure answers about objects of a percept table, each left out by what is learned."""
    table = load_percepts(name)
    learner = Learner(table.domain, agent="bayes", seed=seed, logs=None).fit(table)
    done = [learner.ask(task) for task in offline_tasks(table, n, trials, seed)]
    objects = np.array([trial.task.object_index for trial in done])
    said, right, answered = stopped(done)
    gap = clustered((said - right)[answered], objects[answered]).interval()
    return {**row_of(name, n, done), "gap": gap.estimate, "gap_low": gap.low, "gap_high": gap.high}


def without(name: str, n: int, trials: int, seed: int) -> list[Row]:
    """Measure what `bayes` earns beyond itself without one of its parts, on the same questions."""
    table = load_percepts(name)
    tasks = offline_tasks(table, n, trials, seed)
    objects = np.array([task.object_index for task in tasks])
    bayes = load_agent("bayes")
    parts = {
        "": bayes,
        "planned with discount .99": replace(bayes, discount=0.99),
        "without the trait": replace(bayes, shared_trait=False),
    }
    done = {}
    for part, agent in parts.items():
        learner = Learner(table.domain, agent=agent, seed=seed, logs=None).fit(table)
        done[part] = [learner.ask(task) for task in tasks]
    rows = []
    for part in list(parts)[1:]:
        row: Row = {"dataset": name, "attributes": n, "trials": trials, "bayes less": part}
        for measure_ in ("reward", "cost"):
            ours, other = (
                np.array([getattr(trial, measure_) for trial in done[p]]) for p in ("", part)
            )
            found = clustered(ours - other, objects).interval()
            row |= {measure_: found.estimate, f"{measure_}_low": found.low}
            row |= {f"{measure_}_high": found.high}
        rows.append(row)
    return rows


def simulated(name: str, n: int, trials: int, seed: int) -> Row:
    """Draw objects and percepts from what is believed: z tells whether the procedure is right."""
    table = load_percepts(name)
    agent = load_agent("bayes")
    learner = Learner(table.domain, agent=agent, seed=seed, logs=None).fit(table)
    said = []
    right = []
    for task in offline_tasks(table, n, max(1, trials // EPISODES), seed):
        momdp = agent.model(task.query, learner.knowledge(task.object_name))
        rng = stream(seed, "simulated", *task.key)
        policy = agent.planner(table.domain, task.query).solve(momdp, rng)
        played = simulate(momdp, policy, EPISODES, rng)
        said.append(played.certainty[~played.abstained])
        right.append(played.success[~played.abstained])
    sure = np.concatenate(said)
    gap = sure - np.concatenate(right)
    z = gap.sum() / np.sqrt((sure * (1 - sure)).sum())
    return {
        "dataset": name,
        "attributes": n,
        "answered": len(sure),
        "says": float(sure.mean()),
        "right": float((sure - gap).mean()),
        "z": float(z),
    }


def stopped(trials: list[Trial]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return of trials Pr(right) when they ended, whether they were right, and answered."""
    said = np.array([trial.certainty for trial in trials])
    right = np.array([bool(trial.success) for trial in trials], float)
    return said, right, np.array([trial.report is not None for trial in trials])


def row_of(name: str, n: int, trials: list[Trial]) -> Row:
    """Sum up trials."""
    said, right, answered = stopped(trials)
    return {
        "dataset": name,
        "attributes": n,
        "trials": len(trials),
        "answered": int(answered.sum()),
        "says": float(said[answered].mean()),
        "right": float(right[answered].mean()),
        "reward": float(np.mean([trial.reward for trial in trials])),
        "cost_s": float(np.mean([trial.cost for trial in trials])),
    }


def main() -> None:
    """Measure the data sets and print a table, or JSON."""
    parser = options_of(__doc__)
    parts: dict[str, Callable[..., Any]] = {
        "answers": answers,
        "without": without,
        "simulated": simulated,
    }
    parser.add_argument("--part", choices=("beliefs", *parts), default="beliefs")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--trials", type=int, help="of a row; by default those on the page")
    parser.add_argument("--dataset", nargs="+", default=["roc36", "ispy32", "cy101"])
    parser.add_argument("--prior", choices=("rates", "even"), default="rates")
    parser.add_argument("--attributes", choices=("all", "well", "weak"), default="all")
    options = parser.parse_args()
    rows: list[Row] = []
    if options.part != "beliefs":
        measured = parts[options.part]
        cells = [(data, n) for data in options.dataset for n in ASKED[data]]
        for data, n in cells:
            found = measured(data, n, options.trials or TRIALS[data], options.seed)
            rows += found if isinstance(found, list) else [found]
            print(found, file=sys.stderr, flush=True)
        show(rows, {"rows": rows} if options.json else None)
        return
    seconds = {}
    for name in options.dataset:
        of_data, seconds[name] = measure(name, options.attributes, options.prior)
        rows += of_data
    show(rows, {"default": DEFAULT, "fit_cpu_s": seconds, "rows": rows} if options.json else None)
    if not options.json:
        print(f"\nCPU seconds of all folds of {DEFAULT!r}, the default: {seconds}")


if __name__ == "__main__":
    main()
