"""Sect. 7.3.1: two illustrative trials, T1 and T2, and what Table 4 says of the second."""

from itertools import product

import numpy as np

from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.replay import cost_of, momdp_of
from paper_repro.statements import THEIRS, Evidence, constructed, fact

PRESS = "crush"  # of CY101's behaviors the one that presses
NOTE = """The paper contradicts itself on T2's belief: Table 4 prints (press, SOFT), late, as [.82
.17; .20 .80] (rows: truth), and Sect. 7.3.1 prints [.57 .43] before press and [.67 .33] after it,
percept "not soft". By Eq. 8 the first takes [.57 .43] to [{soft}]. (The table of grasp, called TN
FN FP TP, is read row by row as [TN FP; FN TP], as its rows then sum to 1.) T1's printed behaviors
leave a `press` out, which takes its belief from [.37 .63] to [.46 .54]. Choices and IE are judged
with [table4](table4.md), from the robot's own work."""


def run(setting: Setting) -> Result:
    """Sum the costs, and filter T2's percept with the rows that Table 4 prints."""
    paper, table = paper_values("t1t2"), paper_values("table4")
    early, late = np.array(table["early"]), np.array(table["late"])
    beliefs = {"T1": (paper["t1_before"], paper["t1_after"], early[:, 0]),
               "T2": (paper["before"], paper["after"], late[:, 0])}  # fmt: skip
    momdp = momdp_of("cy101", {"soft": {PRESS: [late[1, 1], late[0, 1]]}})  # for its costs
    rows: list[tuple[Cell, ...]] = []
    evidence: dict[str, Evidence | None] = {}
    told = []
    for name in ("t1", "t2"):
        printed = paper[name]["cost"]
        total = cost_of(momdp, [{"behavior": b} for b in paper[name]["behaviors"]])
        rows.append((f"{name.upper()}: cost, s", f"{printed:.1f}", f"{total:.1f}"))
        evidence[f"{name.upper()} costs {printed} s"] = constructed(
            f"by the paper's table its behaviors cost {total:.1f} s"
        )
    for trial, (before, after, row) in beliefs.items():
        posterior = np.array(before) * row
        posterior /= posterior.sum()
        off, no_off, yes_off = np.array(list(product((-0.005, 0.005), repeat=3))).T  # by rounding
        no, yes = (before[0] + off) * (row[0] + no_off), (before[1] - off) * (row[1] + yes_off)
        low, high = (f(no / (no + yes)) for f in (np.min, np.max))
        shown, ours = (" ".join(f"{b:.2f}" for b in side) for side in (after, posterior))
        rows.append((f"{trial}: (not soft, soft) after press says no", shown, ours))
        told.append(f"{trial}'s belief to [{ours}], printed [{shown}]")
        evidence[f"{trial}'s belief goes from {before} to {after}"] = fact(
            bool(low - 0.005 <= after[0] <= high + 0.005),
            f"Table 4 and Eq. 8 give [{ours}], of not soft {low:.3f} to {high:.3f}",
        )
    grasp = np.array(paper["grasp"])
    rows.append(("grasp: TPR - FPR of SOFT", f"{grasp[1, 1] - grasp[0, 1]:.2f}", None))
    return Result(
        title="Trials T1 and T2 (a can, SOFT?) by CY101's costs, Table 4's rows and our filter",
        sentence=f"Table 4 and Eq. 8 take {'; '.join(told)}.",
        tables=(Table("by CY101's costs and our filter", ("", "paper", "ours"), tuple(rows)),),
        evidence={THEIRS: evidence},
        notes=(NOTE.format(soft=ours),),
        effects={"13": f"Table 4 and Eq. 8 take {'; '.join(told)}"},
    )
