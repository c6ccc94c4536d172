"""Sect. 7.3.1: two illustrative trials, T1 and T2, and what Table 4 says of the second."""

import numpy as np

from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.replay import cost_of, momdp_of, same_digits
from paper_repro.statements import Statement, fact

PRESS = "crush"  # of CY101's behaviors the one that presses
NOTE = """The paper contradicts itself on T2's belief: Table 4 prints (press, SOFT), late, as [.82
.17; .20 .80] (rows: truth), and Sect. 7.3.1 prints [.57 .43] before press and [.67 .33] after it,
percept "not soft". By Eq. 8 the first takes [.57 .43] to [{soft}]. (The table of grasp, called TN
FN FP TP, is read row by row as [TN FP; FN TP], as its rows then sum to 1.) T1's choices and IE are
judged with [table4](#table4), from the robot's own work."""


def run(setting: Setting) -> Result:
    """Sum the costs, and filter T2's percept with the rows that Table 4 prints."""
    paper, table = paper_values("t1t2"), paper_values("table4")
    late = np.array(table["late"])
    belief = np.array(paper["before"]) * late[:, 0]
    belief /= belief.sum()
    momdp = momdp_of("cy101", {"soft": {PRESS: [late[1, 1], late[0, 1]]}})  # for its costs
    rows: list[tuple[Cell, ...]] = []
    statements = []
    for name in ("t1", "t2"):
        printed = paper[name]["cost"]
        found = cost_of(momdp, [{"behavior": b} for b in paper[name]["behaviors"]])
        rows.append((f"{name.upper()}: cost, s", f"{printed:.1f}", f"{found:.1f}"))
        rule = f"its behaviors cost {printed} s by the paper's table (they cost {found:.1f} s)"
        text = f"{name.upper()} costs {printed} s"
        statements.append(Statement(text, fact(same_digits([printed], [found]), rule)))
    shown, ours = (" ".join(f"{b:.2f}" for b in side) for side in (paper["after"], belief))
    rows.append(("T2: (not soft, soft) after press says no", shown, ours))
    rule = f"Table 4 and Eq. 8 give the same to two decimals (they give [{ours}])"
    text = f"T2's belief goes from {paper['before']} to {paper['after']}"
    statements.append(Statement(text, fact(same_digits(paper["after"], belief.tolist()), rule)))
    grasp = np.array(paper["grasp"])
    rows.append(("grasp: TPR - FPR of SOFT", f"{grasp[1, 1] - grasp[0, 1]:.2f}", None))
    return Result(
        title="Trials T1 and T2 (a can, SOFT?) by CY101's costs, Table 4's rows and our filter",
        paper=f"{paper['t1']['cost']} s, wrong; {paper['t2']['cost']} s, right",
        ours="; ".join(f"{row[2]} s" for row in rows[:2]),
        tables=(Table("by CY101's costs and our filter", ("", "paper", "ours"), tuple(rows)),),
        statements=tuple(statements),
        notes=(NOTE.format(soft=ours),),
        effects={"13": f"by Table 4 [{ours}], printed [{shown}]"},
    )
