"""Table 4: how a robot perceives SOFT by pressing, early and late in its work (CY101)."""

import numpy as np
from frame import Cell, Claim, Result, Setting, Table, main, paper_values
from numpy.typing import NDArray
from online import OURS, PAPERS, panel
from t1t2 import PRESS

from meal_bayes import read_trials

AGENT = "morc_itrs"


def run(setting: Setting) -> Result:
    """Read the rows off the MOMDPs of training trials in the first and in the last batch."""
    paper, attribute = paper_values("table4"), setting.of("table4", "attribute")
    repeats = setting.of("fig10", "repeats")["cy101_1"]
    done = panel(setting, "cy101", 1, (*PAPERS, *OURS), repeats)
    found = {}
    for name, batch in (("early", 1), ("late", setting.of("online", "batches"))):
        logs = sorted(done.folder.glob(f"{AGENT}/repeat-*/{batch:02d}-train.mcap"))
        rows = [row for log in logs if (row := _rows(log, attribute)) is not None]
        found[name] = (np.mean(rows, axis=0) if rows else np.full((2, 2), np.nan), len(rows))
    rows_of_table: list[tuple[Cell, ...]] = [
        (f"{name}, {truth}", *paper[name][v], *map(float, found[name][0][v]), found[name][1])
        for name in found
        for v, truth in enumerate((f"not {attribute}", attribute))
    ]
    youden = {name: float(rows[1, 1] - rows[0, 1]) for name, (rows, _) in found.items()}
    columns = ("rows: truth", "paper: no", "yes", "ours: no", "yes", "repeats")
    return Result(
        item="table4",
        title="Observation model of (press, SOFT) on CY101, early and late",
        paper="TPR - FPR .18 early, .63 late",
        ours=", ".join(f"{value:.2f} {name}" for name, value in youden.items()),
        tables=(Table("confusion matrices, mean over repeats", columns, tuple(rows_of_table)),),
        claims=(
            Claim("pressing tells more of SOFT late than early", youden["late"] > youden["early"]),
        ),
        notes=(
            "Early: learned from pretraining alone; late: with nine batches of work. Rows are "
            "those of training trials that asked for the attribute; not every batch has one.",
        ),
    )


def _rows(log: object, attribute: str) -> NDArray[np.float64] | None:
    for trial in read_trials(str(log)):
        names = trial.momdp.query.attributes
        if attribute in names:
            e = trial.momdp.behavior_names.index(PRESS)
            return np.asarray(trial.momdp.rows[names.index(attribute), e])
    return None


if __name__ == "__main__":
    main(run)
