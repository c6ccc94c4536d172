"""Fig. 4: confusion matrices of shake on ROC36, for HEAVY, BEANS and GREEN."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import load_domain
from meal_bayes.evaluation import Estimate
from meal_bayes.perception import TableSource
from meal_bayes.seeds import stream
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.inference import bootstrap_interval
from paper_repro.published import published_counts
from paper_repro.statements import RECORDED, THEIRS, Evidence, above, every, fact

BEHAVIOR = "shake"
SOURCES = {
    "train5": THEIRS,  # what the published simulator loads
    "train12": THEIRS,
    "paper": RECORDED,
}
COLUMNS = ("attribute", "classifiers", "false: no", "yes", "true: no", "yes", "kappa")
NOTE = """Under `theirs` stand the published confusion counts, of which nobody says what they were
counted on. Rows `paper` are the classifiers of Sect. 4.2 (support vector machines, pooled by
kappa), of objects that no classifier has seen."""

Counts = NDArray[np.float64]  # (O,P,2,2) percepts of each object: truth, level


def run(setting: Setting) -> Result:
    """Read the published counts; in full, count held-out percepts by the paper's classifiers."""
    order = paper_values("fig4")["order"]
    text = f"{' > '.join(order)} in kappa"
    rows: list[tuple[Cell, ...]] = []
    evidence: dict[str, dict[str, Evidence | None]] = {}
    shown = {}
    for name, protocol in SOURCES.items():
        if protocol not in setting.protocols or (setting.quick and name == "paper"):
            continue  # it is computed for minutes, once
        published = protocol == THEIRS
        if published:
            counts = published_percepts(name, order)
        else:
            counts = held_out_percepts(TableSource.of("roc36", name).load(), order)
        total = counts.sum(axis=0)  # (P,2,2)
        matrices = total / total.sum(axis=-1, keepdims=True)
        title = f"published, {name}" if published else f"{name} classifiers"
        source = title if published else name
        values = [kappa(table) for table in total]
        shown[title] = values
        rows += [
            (attribute, source, *matrix.ravel().tolist(), value)
            for attribute, matrix, value in zip(order, matrices, values, strict=True)
        ]
        if published:
            falling = all(first > second for first, second in pairwise(values))
            rule = "; ".join(f"{a} {k:.2f}" for a, k in zip(order, values, strict=True))
            evidence.setdefault(protocol, {})[f"{text} ({name})"] = fact(falling, rule)
        else:
            evidence[protocol] = {text: judge(counts, order)}
    told = [
        f"{name} " + ", ".join(f"{a} {k:.2f}" for a, k in zip(order, values, strict=True))
        for name, values in shown.items()
    ]
    return Result(
        title=f"Confusion matrices of {BEHAVIOR} on ROC36",
        sentence=f"Cohen's kappa of {BEHAVIOR}: {'; '.join(told)}.",
        tables=(Table("Pr(percept | truth)", COLUMNS, tuple(rows)),),
        evidence=evidence,
        notes=(NOTE,),
        shows="The paper draws one matrix for each attribute: nearly diagonal for HEAVY, less so "
        "for BEANS, and even for GREEN.",
    )


def judge(counts: Counts, order: list[str]) -> Evidence:
    """Judge that kappa falls from attribute to attribute; whole objects are drawn again."""
    parts = []
    for (p, first), (q, second) in pairwise(enumerate(order)):
        lead = bootstrap_interval(
            counts,
            range(len(counts)),
            stream(0, "kappa", first, second),
            statistic=lambda x, p=p, q=q: kappa(x[:, p].sum(0)) - kappa(x[:, q].sum(0)),  # type: ignore[misc]
        )
        effect = Estimate(lead.estimate, lead.se, len(counts), method="t, bootstrap over objects")
        parts.append(above(effect, 0, of=f"kappa of {first} less that of {second}"))
    return every(parts)


def kappa(matrix: NDArray[np.float64]) -> float:
    """Return Cohen's kappa of a confusion matrix (2,2)."""
    total = matrix.sum()
    agree = float(np.trace(matrix) / total)
    chance = float(matrix.sum(axis=0) @ matrix.sum(axis=1) / total**2)
    return (agree - chance) / (1 - chance) if chance < 1 else 0.0


def published_percepts(name: str, attributes: list[str]) -> Counts:
    """Return the published counts, as those of one object."""
    domain = load_domain("roc36_published")
    e = domain.behavior_index(BEHAVIOR)
    return published_counts(name, domain)[None, domain.columns(attributes), e].astype(float)


def held_out_percepts(table: PerceptTable, attributes: list[str]) -> Counts:
    """Count each object's percepts, yes or no, by classifiers that never saw it."""
    e = table.domain.behavior_index(BEHAVIOR)
    columns = table.domain.columns(attributes)
    odds = table.log_odds[:, :, e][..., columns]  # (O,R,P)
    labels = table.labels[:, columns]
    levels = table.levels_of(odds, 2)
    recorded = ~np.isnan(odds)
    counts = np.zeros((*labels.shape, 2, 2))
    for truth in range(2):
        for level in range(2):
            seen = ((levels == level) & recorded).sum(axis=1)
            counts[:, :, truth, level] = np.where(labels == truth, seen, 0)
    return counts
