"""Sect. 7.3.1 and Table 4: two illustrative trials, and the observation model behind the second."""

import numpy as np
from frame import Cell, Claim, Result, Setting, Table, main, paper_values
from replay import cost_of, momdp_of, replay, same_digits

PRESS = "crush"  # of CY101's behaviors the one that presses


def run(setting: Setting) -> Result:
    """Sum the costs, and filter T2's percept with the rows that Table 4 prints."""
    paper, table = paper_values("t1t2"), paper_values("table4")
    false, true = (np.array(row) / sum(row) for row in table["late"])  # columns: no, yes
    rates = {"soft": {PRESS: [float(true[1]), float(false[1])]}}
    momdp = momdp_of("cy101", rates)
    before = float(paper["before"][1])  # Pr(soft)
    odds = before / (1 - before) * true[0] / false[0]
    soft = float(odds / (1 + odds))
    _, after = replay(momdp, [{"behavior": PRESS, "percept": [0]}])
    uniform = float(after.positive[0])
    costs = {name: cost_of(momdp, [{"behavior": b} for b in paper[name]["behaviors"]])
             for name in ("t1", "t2")}  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (f"{name.upper()}: cost, s", paper[name]["cost"], costs[name]) for name in costs
    ]
    rows.append(("T2: Pr(not soft) before, after `press` says no", f"{paper['before'][0]}, "
                 f"{paper['after'][0]}", f"{1 - before:.2f}, {1 - soft:.2f}"))  # fmt: skip
    rows.append(("the same from an even belief", None, 1 - uniform))
    claims = [Claim(f"{n.upper()} costs {paper[n]['cost']} s", same_digits([paper[n]["cost"]], [c]))
              for n, c in costs.items()]  # fmt: skip
    rounded = same_digits([paper["after"][0]], [1 - soft])
    claims.append(
        Claim(f"T2's belief goes to {paper['after'][0]}", rounded, contradicted=not rounded)
    )
    return Result(
        item="t1t2",
        title="Trials T1 and T2 (a can, SOFT?) and Table 4's rows",
        paper=f"{paper['t1']['cost']} s, wrong; {paper['t2']['cost']} s, right",
        ours=f"{costs['t1']:.1f} s; {costs['t2']:.1f} s",
        tables=(Table("by CY101's costs and our filter", ("", "paper", "ours"), tuple(rows)),),
        claims=tuple(claims),
        notes=("One row of Table 4 sums to .99 and is normalized.",),
    )


if __name__ == "__main__":
    main(run)
