"""Sect. 7.3.1: two illustrative trials, T1 and T2, and what Table 4 says of the second."""

from itertools import product

import numpy as np

from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.replay import cost_of, momdp_of
from paper_repro.statements import THEIRS, Evidence, constructed, fact

PRESS = "crush"  # of CY101's behaviors the one that presses
NOTE = """The paper contradicts itself on T2's belief: Table 4 prints (press, SOFT), late, as [.82
.17; .20 .80] (rows: truth), and Sect. 7.3.1 prints [.57 .43] before press and [.67 .33] after it,
percept "not soft". By Eq. 8 the first takes [.57 .43] to [{soft}]. T1's belief changes from [.37
.63] to [.46 .54] after grasp, by the sentence that prints it. An early table of grasp is not
printed, so that nothing contradicts it: it takes a likelihood ratio of {ratio:.2f}, the late table,
printed beside T2, has {late:.2f}. (That table, called TN FN FP TP, is read row by row as [TN FP; FN
TP], as its rows then sum to 1.) T1's printed cost leaves no time for a press. Choices and IE are
judged with [table4](table4.md), from the robot's own work."""


def run(setting: Setting) -> Result:
    """Sum the costs, and filter T2's percept with the rows that Table 4 prints."""
    paper = paper_values("t1t2")
    late = np.array(paper_values("table4")["late"])
    momdp = momdp_of("cy101", {"soft": {PRESS: [late[1, 1], late[0, 1]]}})  # for its costs
    rows: list[tuple[Cell, ...]] = []
    evidence: dict[str, Evidence | None] = {}
    for name in ("t1", "t2"):
        printed = paper[name]["cost"]
        total = cost_of(momdp, [{"behavior": b} for b in paper[name]["behaviors"]])
        rows.append((f"{name.upper()}: cost, s", f"{printed:.1f}", f"{total:.1f}"))
        evidence[f"{name.upper()} costs {printed} s"] = constructed(
            f"by the paper's table its behaviors cost {total:.1f} s"
        )
    grasp = np.array(paper["grasp"])
    asked = _ratio(paper["t1_before"], paper["t1_after"])
    printed_ratio = grasp[0, 0] / grasp[1, 0]
    evidence[f"T1's belief goes from {paper['t1_before']} to {paper['t1_after']}"] = constructed(
        f"after grasp, of which no early table is printed: a likelihood ratio of {asked:.2f}"
    )
    before = paper["before"]
    after = paper["after"]
    # Eq. 8: a percept "not soft" weighs each truth by the rate in its row of Table 4.
    posterior = np.array(before) * late[:, 0]
    posterior /= posterior.sum()
    # What is printed to two decimals may be anything within half of the last one: the belief before
    # and both rates, at the corners of their ranges, bound the belief after.
    off, no_off, yes_off = np.array(list(product((-0.005, 0.005), repeat=3))).T
    no = (before[0] + off) * (late[0, 0] + no_off)
    yes = (before[1] - off) * (late[1, 0] + yes_off)
    reached = no / (no + yes)
    low = reached.min()
    high = reached.max()
    shown = " ".join(f"{b:.2f}" for b in after)
    ours = " ".join(f"{b:.2f}" for b in posterior)
    rows.append(("T2: (not soft, soft) after press says no", shown, ours))
    evidence[f"T2's belief goes from {before} to {after}"] = fact(
        bool(low - 0.005 <= after[0] <= high + 0.005),
        f"Table 4 and Eq. 8 give [{ours}], of not soft {low:.3f} to {high:.3f}",
    )
    rows.append(("grasp: TPR - FPR of SOFT", f"{grasp[1, 1] - grasp[0, 1]:.2f}", None))
    told = f"Table 4 and Eq. 8 take T2's belief to [{ours}], printed [{shown}]"
    return Result(
        title="Trials T1 and T2 (a can, SOFT?) by CY101's costs, Table 4's rows and our filter",
        sentence=f"{told}.",
        tables=(Table("by CY101's costs and our filter", ("", "paper", "ours"), tuple(rows)),),
        evidence={THEIRS: evidence},
        notes=(NOTE.format(soft=ours, ratio=asked, late=printed_ratio),),
        effects={"13": told},
    )


def _ratio(before: list[float], after: list[float]) -> float:
    """Return the likelihood ratio, of not soft to soft, that takes one belief to the other."""
    return (after[0] / after[1]) / (before[0] / before[1])
