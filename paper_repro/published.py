"""What was published: learned matrices, and settings of the plotted files."""

import csv
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import PerceptTable, load_percepts, save_percepts
from meal_bayes.datasets.sources import fetch, source
from meal_bayes.domain import Domain, load_domain
from meal_bayes.experiments.online import restricted_domain
from paper_repro.agents import ASK
from paper_repro.frame import HERE, Setting, paper_values

EVERY_ACTION = str(HERE / "domains" / "roc36_every_action.toml")  # x decides nothing
SIMULATOR = str(HERE / "domains" / "roc36_code.toml")
SIMULATOR_REWARD = 100.0  # of a right report, and lost by a wrong one
QUESTIONS = ("weight", "color", "content")  # groups of ROC36; the first N are asked
ANSWER_RIGHT = 0.85  # Pr(a person's whole answer is right), ROC36


def table_path(
    setting: Setting,
    dataset: str,
    *,
    name: str = "",
    domain: str = "",
    matrices: str = "",
    costs: dict[str, float] | None = None,
    answer: float | None = None,
    asked: tuple[str, ...] = (),
    **changes: Any,
) -> str:
    """Write a percept table under another domain, or with published matrices; return its path.

    Parameters
    ----------
    setting : whose logs it is kept beside.
    dataset : roc36, ispy32 or cy101.
    name : of the table.
    domain : a shipped one, or a path; the data set's by default.
    matrices : "train5" or "train12", ROC36's published confusion counts; learned ones by default.
    costs : s, of behaviors that cost something else.
    answer : Pr(a person is right), of each attribute.
    asked : groups of attributes that questions are of; all by default.
    changes : other fields of the domain.
    """
    return _written(
        path=setting.logs / "tables" / f"{name}.npz",
        dataset=dataset,
        domain=domain or dataset,
        matrices=matrices,
        costs=tuple((costs or {}).items()),
        answer=answer,
        asked=asked,
        changes=(("name", name), *changes.items()),
    )


@lru_cache(maxsize=32)
def _written(
    path: Path,
    dataset: str,
    domain: str,
    matrices: str,
    costs: tuple[tuple[str, float], ...],
    answer: float | None,
    asked: tuple[str, ...],
    changes: tuple[tuple[str, Any], ...],
) -> str:
    """Write a table once for a program, as items share it and compressing it takes a second."""
    base = load_domain(domain)
    if asked:
        base = of_groups(base, asked)
    priced = dict(costs)
    behaviors = []
    for behavior in base.behaviors:
        right = behavior.answer_accuracy
        if behavior.name == ASK and answer is not None:
            right = answer
        cost = priced.get(behavior.name, behavior.cost)
        behaviors.append(replace(behavior, cost=cost, answer_accuracy=right))
    base = replace(base, behaviors=tuple(behaviors), **dict(changes))
    table = load_percepts(dataset, domain=base)
    if matrices:
        table = with_counts(table, published_counts(matrices, base))
    path.parent.mkdir(parents=True, exist_ok=True)
    save_percepts(table, path)
    return str(path)


def of_groups(domain: Domain, names: tuple[str, ...]) -> Domain:
    """Return a domain with the attributes of some of its groups alone."""
    values = set().union(*(domain.groups[name] for name in names))
    return restricted_domain(domain, tuple(name for name in domain.attributes if name in values))


def published_roc36(setting: Setting, matrices: str, n: int, domain: str = SIMULATOR) -> str:
    """Return ROC36 by published counts and a domain's diagram, reinit for 0 s as in Table 3.

    The published simulator asks for weight, weight and color, or all three (`QUESTIONS`). A
    person's whole answer is right with .85 there: here each of N attributes is with .85^(1/N).
    """
    return table_path(
        setting,
        "roc36",
        name=f"roc36_table3_{matrices}_{Path(domain).stem}_n{n}",
        domain=domain,
        matrices=matrices,
        costs={"reinit": 0.0},
        answer=ANSWER_RIGHT ** (1 / n),
        asked=QUESTIONS[:n],
    )


def every_action_roc36(setting: Setting, matrices: str, n: int) -> str:
    """Return it with every action legal everywhere, for the published Random, Predefined Plus."""
    return table_path(
        setting,
        "roc36",
        name=f"roc36_every_{matrices}_n{n}",
        domain=EVERY_ACTION,
        matrices=matrices,
        asked=QUESTIONS[:n],
    )


def plotted_ispy32(setting: Setting) -> str:
    """Return ISPY32 under the settings that the plotted files' names tell.

    A person is right with the stated accuracy in each attribute.
    """
    paper = paper_values("plotted")
    return table_path(
        setting,
        "ispy32",
        name="ispy32_plotted",
        domain="ispy32_published",
        costs={ASK: paper["ask_cost"]},
        answer=paper["ask_accuracy"],
        legal_budget=(paper["budget"],),
    )


def published_counts(name: str, domain: Domain) -> NDArray[np.int64]:
    """Read ROC36's published counts (P,E,2,2) of truth and percept; none of reinit and ask."""
    counts = np.zeros((len(domain.attributes), len(domain.behaviors), 2, 2), np.int64)
    path = fetch("roc36") / source("roc36").path / f"confusion_matrices_{name}.csv"
    with path.open(encoding="ascii") as file:
        for attribute, behavior, *row in list(csv.reader(file))[1:]:
            if attribute not in domain.attributes:
                continue
            hit, false_alarm, miss, rejection = map(int, row)
            matrix = counts[domain.attributes.index(attribute), domain.behavior_index(behavior)]
            matrix[:] = [[rejection, false_alarm], [miss, hit]]
    return counts


def with_counts(table: PerceptTable, counts: NDArray[np.int64]) -> PerceptTable:
    """Replace what is learned by counts (P,E,2,2), the same for each object that is left out.

    They are dealt out over the other objects of each truth, as only their sums enter Eq. 8.
    """
    objects = len(table.objects)
    bins = np.zeros((objects, objects, *counts.shape[:2], 2), np.uint8)
    for held_out, p, truth in product(range(objects), range(len(counts)), range(2)):
        others = np.flatnonzero((table.labels[:, p] == truth) & (np.arange(objects) != held_out))
        # Each of the others has an equal part of every count, the first ones have one more.
        share, remainder = np.divmod(counts[p, :, truth], len(others))  # (E,2)
        bins[held_out, others, p] = share + (np.arange(len(others))[:, None, None] < remainder)
    rounds = -(-int(bins.sum(axis=-1).max()) // table.recordings)  # as many recordings as counts
    return replace(
        table,
        log_odds=np.tile(table.log_odds, (1, rounds, 1, 1)),
        training_bins=bins,
        edges=table.edges[[len(table.edges) // 2]],
        recording_counts=table.recording_counts * rounds,
    )
