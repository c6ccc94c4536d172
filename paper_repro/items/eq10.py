"""Eq. 10: experience counted in training alone, as the paper reads, or in pretraining as well."""

from collections.abc import Iterator
from typing import Any

from meal_bayes.experiments import OnlineConfig
from paper_repro.frame import Cell, Result, Setting, Table
from paper_repro.items.fig10 import area
from paper_repro.online import BEST, REPEATS, curves_config, mean_of, paired, run_curves
from paper_repro.statements import RECORDED

READINGS = {
    "paper": "labelled instances of training, over 5 recordings of its objects",
    "all": "those of pretraining too, and its objects",
}
NOTE = """CY101, one attribute, on recordings. Both readings are settings of an online run
(`normalizer`); the first is the default. The paper's T2 prints an IE of .67, which is judged with
[table4](table4.md)."""


def runs(setting: Setting) -> Iterator[OnlineConfig]:
    """List the runs under both readings."""
    for normalizer in READINGS:
        yield curves_config(setting, **how_run(setting, normalizer))


def how_run(setting: Setting, normalizer: str) -> dict[str, Any]:
    """Return the arguments of the run under a reading."""
    repeats = setting.repeats_of(REPEATS, column=RECORDED)
    run = {"dataset": "cy101", "n": 1, "agent": BEST, "repeats": repeats}
    return run | {"normalizer": normalizer}


def run(setting: Setting) -> Result:
    """Run MORC-ITRS under both readings, on the same tasks."""
    first, second = (run_curves(setting, **how_run(setting, name)) for name in READINGS)
    lead = paired(*area(second, first, "reward"), first.ratio)
    rows: list[tuple[Cell, ...]] = []
    for name, curves, less in zip(READINGS, (first, second), (None, lead), strict=True):
        last = (mean_of(values[:, -1], first.ratio) for values in (curves.hours, curves.reward))
        rows.append((name, READINGS[name], len(curves), *last, less))
    sentence = (
        "Counting pretraining too changes MORC-ITRS's reward over its hours of exploration on "
        f"CY101, 1 attribute, by {lead.estimate:+.1f} ± {lead.se:.1f} ({len(first)} repeats)."
    )
    columns = ("normalizer", "counts", "repeats", "explored, h", "reward", "less the paper's")
    return Result(
        title="Two readings of Eq. 10's experience",
        sentence=sentence,
        tables=(Table("readings", columns, tuple(rows)),),
        evidence={},
        size=f"{len(first)} repeats.",
        notes=(NOTE,),
        effects={"24": sentence},
    )
