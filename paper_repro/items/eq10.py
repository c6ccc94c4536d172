"""Eq. 10: experience counted in training alone, as the paper reads, or in pretraining as well."""

from paper_repro.frame import Cell, Estimate, Result, Setting, Table
from paper_repro.items.fig10 import area
from paper_repro.online import BEST, mean_of, paired, run_curves

READINGS = {"paper": "labelled instances of training, over 5 recordings of its objects",
            "all": "those of pretraining too, and its objects"}  # fmt: skip
STEPS = (10,)  # repeats: nothing is to be decided
NOTE = """CY101, one attribute, on recordings. Both readings are settings of an online run
(`normalizer`); the first is the default. The paper's T2 prints an IE of .67, which is judged with
[table4](#table4)."""


def run(setting: Setting) -> Result:
    """Run MORC-ITRS under both readings, on the same tasks."""
    rows: list[tuple[Cell, ...]] = []
    effects = {}
    for repeats in () if setting.as_published else setting.repeat_steps(STEPS):
        first, second = (
            run_curves(setting, "cy101", 1, BEST, repeats, normalizer=name) for name in READINGS
        )
        lead = paired(*area(second, first, "reward"))
        rows = [
            (name, READINGS[name], len(one), mean_of(one.hours[:, -1]), mean_of(one.reward[:, -1]))
            for name, one in zip(READINGS, (first, second), strict=True)
        ]
        rows[0], rows[1] = (*rows[0], None), (*rows[1], Estimate.of(lead))
        effects["24"] = (
            "counting pretraining too: MORC-ITRS's reward over its hours of exploration on CY101, "
            f"1 attribute, {lead.estimate:+.1f} ± {lead.se:.1f} ({len(first)} repeats)"
        )
    columns = ("normalizer", "counts", "repeats", "explored, h", "reward", "less the paper's")
    return Result(
        title="Two readings of Eq. 10's experience",
        paper="instances of training",
        ours=f"{rows[1][3][0]:.2f} h against {rows[0][3][0]:.2f} h" if rows else "",  # type: ignore[index]
        tables=(Table("readings", columns, tuple(rows)),) if rows else (),
        statements=(),
        notes=(NOTE,),
        effects=effects,
    )
