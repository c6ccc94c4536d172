"""Fig. 4: confusion matrices of shake on ROC36, for HEAVY, BEANS and GREEN."""

from itertools import pairwise

import numpy as np
from frame import Cell, Claim, Result, Setting, Table, main, paper_values

from meal_bayes.datasets import PerceptTable
from meal_bayes.evaluation import plots
from meal_bayes.experiments.percepts import percepts_for
from meal_bayes.perception import ConfusionCounts
from meal_bayes.perception.confusion import by_truth

COLUMNS = ("attribute", "classifiers", "false: no", "yes", "true: no", "yes", "kappa")


def run(setting: Setting) -> Result:
    """Count held-out percepts by truth, with our classifiers and, in full, with the paper's."""
    behavior, attributes = setting.of("fig4", "behavior"), setting.of("fig4", "attributes")
    rows: list[tuple[Cell, ...]] = []
    kappas, figures = {}, {}
    for name in ("default",) if setting.quick else ("default", "paper"):
        table = percepts_for(setting.of("fig4", "dataset"), name)
        counts = held_out_counts(table)
        columns = [table.domain.attribute_index(attribute) for attribute in attributes]
        e = table.domain.behavior_index(behavior)
        matrices = counts.total()[columns, e].astype(float)  # (N,2,2)
        matrices /= matrices.sum(axis=-1, keepdims=True)
        kappas[name] = dict(zip(attributes, counts.kappa()[columns, e].tolist(), strict=True))
        for attribute, matrix in zip(attributes, matrices, strict=True):
            rows.append((attribute, name, *matrix.ravel().tolist(), kappas[name][attribute]))
        figures["" if name == "default" else f"_{name}"] = plots.confusion_matrices(
            matrices, attributes, title=f"{behavior}, {name} classifiers"
        )
    order = paper_values("fig4")["order"]
    falls = {name: _falls([kappa[one] for one in order]) for name, kappa in kappas.items()}
    return Result(
        item="fig4",
        title=f"Confusion matrices of {behavior} on ROC36, of objects that no classifier has seen",
        paper="heavy good, beans fair, green poor",
        ours="kappa " + ", ".join(f"{one} {kappas['default'][one]:.2f}" for one in order),
        tables=(Table("Pr(percept | truth)", COLUMNS, tuple(rows)),),
        claims=(Claim(f"{' > '.join(order)} in kappa", falls["default"], falls.get("paper")),),
        notes=(
            "Rows `paper` are the classifiers of Sect. 4.2 (support vector machines, pooled by "
            "kappa); the column of the published protocol is theirs.",
        ),
        figures=figures,
    )


def held_out_counts(table: PerceptTable) -> ConfusionCounts:
    """Count each object's percepts, yes or no, by classifiers that never saw it."""
    levels, known = table.levels_of(table.log_odds, 2), ~np.isnan(table.log_odds)  # (O,R,E,P)
    counts = np.stack([((levels == level) & known).sum(axis=1) for level in range(2)], axis=-1)
    return by_truth(counts.transpose(0, 2, 1, 3).astype(np.int64), table.labels)


def _falls(values: list[float]) -> bool:
    return all(before > after for before, after in pairwise(values))


if __name__ == "__main__":
    main(run)
