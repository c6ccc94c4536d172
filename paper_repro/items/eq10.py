"""Eq. 10: experience counted in training alone, as the paper reads, or in pretraining as well."""

from paper_repro.frame import Cell, Result, Setting, Table
from paper_repro.items.fig10 import area
from paper_repro.online import BEST, REPEATS, mean_of, paired, run_curves

READINGS = {"paper": "labelled instances of training, over 5 recordings of its objects",
            "all": "those of pretraining too, and its objects"}  # fmt: skip
NOTE = """CY101, one attribute, on recordings. Both readings are settings of an online run
(`normalizer`); the first is the default. The paper's T2 prints an IE of .67, which is judged with
[table4](table4.md)."""


def run(setting: Setting) -> Result:
    """Run MORC-ITRS under both readings, on the same tasks."""
    rows: list[tuple[Cell, ...]] = []
    effects, sentence = {}, "Both readings are not run here."
    repeats = 0 if setting.as_published else setting.repeats_of(REPEATS)
    if repeats:
        first, second = (
            run_curves(setting, "cy101", 1, BEST, repeats, normalizer=name) for name in READINGS
        )
        lead = paired(*area(second, first, "reward"), first.ratio)
        rows = [
            (name, READINGS[name], len(one), mean_of(one.hours[:, -1]), mean_of(one.reward[:, -1]))
            for name, one in zip(READINGS, (first, second), strict=True)
        ]
        rows[0], rows[1] = (*rows[0], None), (*rows[1], lead)
        effects["24"] = sentence = (
            "Counting pretraining too changes MORC-ITRS's reward over its hours of exploration on "
            f"CY101, 1 attribute, by {lead.estimate:+.1f} ± {lead.se:.1f} ({len(first)} repeats)."
        )
    columns = ("normalizer", "counts", "repeats", "explored, h", "reward", "less the paper's")
    return Result(
        title="Two readings of Eq. 10's experience",
        sentence=sentence,
        tables=(Table("readings", columns, tuple(rows)),) if rows else (),
        evidence={},
        notes=(NOTE,),
        effects=effects,
    )
