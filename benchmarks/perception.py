"""Perception on the real recordings: held-out log-loss, Cohen's kappa, permuted labels, CPU time.

python benchmarks/perception.py [--dataset NAME ...] [--permutations N] [--json]
                                [--without joint|balanced|nonnegative|nested|positive_youden_only]
                                [--width MEDIANS] [--paper]

Ours comes first, the paper's method stands beside it.
"""

import dataclasses
import time
from typing import Any

import numpy as np
from held_out import (
    base_rate_log_loss,
    cohens_kappa,
    held_out_log_loss,
    held_out_log_odds,
    permuted,
    with_base_rate,
    yes_counts,
)
from measuring import options_of, show

from meal_bayes.datasets import Dataset, load_dataset
from meal_bayes.perception import PAPER, build_percept_table
from meal_bayes.perception.settings import DEFAULT, PerceptionSettings
from meal_bayes.seeds import stream

CURES = ("joint", "balanced", "nonnegative", "nested", "positive_youden_only")


def asked(dataset: Dataset) -> np.ndarray:
    """Columns of the attributes that experiments ask."""
    true = (dataset.labels == 1).sum(axis=0)
    false = (dataset.labels == 0).sum(axis=0)
    return np.flatnonzero(np.minimum(true, false) > dataset.domain.asked_minimum)


def kappas(dataset: Dataset, log_odds: np.ndarray) -> np.ndarray:
    """Kappa of each asked attribute and sensing behavior, (P,E)."""
    sensing = [e for e, behavior in enumerate(dataset.domain.behaviors) if behavior.modalities]
    kappa = cohens_kappa(yes_counts(log_odds, dataset.labels).sum(axis=0))
    return kappa[np.ix_(asked(dataset), sensing)]


def measure(
    name: str, permutations: int, method: str, settings: PerceptionSettings
) -> dict[str, Any]:
    """Measure one data set under one method."""
    dataset = load_dataset(name)
    columns = asked(dataset)
    start = time.process_time()
    log_odds = held_out_log_odds(dataset, settings=settings)
    balanced = method != "paper"
    decisions = time.process_time() - start
    start = time.process_time()
    build_percept_table(dataset, perception=settings)
    tables = time.process_time() - start
    loss = held_out_log_loss(log_odds, dataset.labels, balanced=balanced)
    kappa = kappas(dataset, log_odds)
    by_chance = []
    for number in range(permutations):
        shuffled = permuted(dataset, stream(number, "permutation", name))
        by_chance.append(
            float(kappas(shuffled, held_out_log_odds(shuffled, settings=settings)).mean())
        )
    return {
        "dataset": name,
        "method": method,
        "attributes": len(columns),
        "log_loss": float(np.nanmean(loss[:, columns])),
        "base_rate_log_loss": float(base_rate_log_loss(dataset.labels)[columns].mean()),
        "kappa": float(kappa.mean()),
        "posterior_kappa": float(kappas(dataset, with_base_rate(log_odds, dataset.labels)).mean()),
        "best_kappa": float(kappa.max(axis=1).mean()),
        "permuted_kappa": float(np.mean(by_chance)) if by_chance else None,
        "decisions_cpu_s": decisions,
        "tables_cpu_s": tables,
    }


def main() -> None:
    """Measure the data sets and print a table, or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--dataset", nargs="+", default=["roc36", "ispy32", "cy101"])
    parser.add_argument("--permutations", type=int, default=5)
    parser.add_argument("--without", choices=CURES, help="take one of the settings out")
    parser.add_argument("--width", type=float, help="of kernels, in medians; learned by default")
    parser.add_argument("--paper", action="store_true", help="measure the paper's method as well")
    options = parser.parse_args()
    settings = dataclasses.replace(DEFAULT, width=options.width)
    if options.without:
        settings = dataclasses.replace(settings, **{options.without: False})
    methods = {"ours": settings, **({"paper": PAPER} if options.paper else {})}
    rows = [
        measure(name, options.permutations, method, chosen)
        for name in options.dataset
        for method, chosen in methods.items()
    ]
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
