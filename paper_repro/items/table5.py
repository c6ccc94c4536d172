"""Table 5: the belief of EMPTY in the demonstration trial, by our filter."""

from itertools import product

import numpy as np

from meal_bayes.momdp import best_report
from paper_repro.frame import Result, Setting, Table, paper_values
from paper_repro.replay import cost_of, momdp_of, replay
from paper_repro.statements import THEIRS, Evidence, constructed, fact

NOTE = """The paper prints no rates. One likelihood ratio each of look, grasp, lift, and of shake
for yes and for no, five in all, are fitted to the first five beliefs; the sixth follows from the
third, fourth and fifth by Eq. 8, within the rounding of what is printed: {low:.3f} to {high:.3f}.
The trial costs {cost:.1f} s by CY101's costs; the paper prints none."""


def run(setting: Setting) -> Result:
    """Replay the trial with fitted rates; only the sixth belief is a prediction."""
    paper = paper_values("table5")
    momdp = momdp_of("cy101", paper["fitted"])
    beliefs = replay(momdp, paper["steps"])
    positive = [float(belief.positive[0]) for belief in beliefs[1:]]
    printed = [step["belief"] for step in paper["steps"]]
    report = momdp.action_name(best_report(momdp, beliefs[-1])).removeprefix("report ")
    rows = [
        (step["behavior"], "yes" if step["percept"][0] else "no", step["belief"], value)
        for step, value in zip(paper["steps"], positive, strict=True)
    ]
    # The same percept, shake says no, came twice: what it did first it does again (Eq. 8).
    low, high = predicted(printed[2], printed[3], printed[4])
    evidence: dict[str, Evidence | None] = {
        f"after {name} ({percept}) the belief is {value:.2f}": constructed(
            "a likelihood ratio was fitted to it"
        )
        for name, percept, value, _ in rows[:-1]
    }
    inside = low - 0.005 <= printed[5] <= high + 0.005
    rule = f"{printed[5]:.2f} is what the same percept did before: {low:.3f} to {high:.3f}"
    evidence[f"after the last shake (no) the belief is {printed[5]:.2f}"] = fact(inside, rule)
    evidence[f"the report is {paper['report']}"] = constructed("argmax of the last belief")
    rates = paper["fitted"]["empty"]
    lift = float(np.log(np.divide(*rates["lift_slow"])))  # of true to false positives
    shake = float(np.log(np.divide(*rates["shake"])))
    evidence["lift says little of EMPTY, shake much"] = constructed(
        f"by the rates that fit the printed beliefs a yes is worth {lift:.2f} and {shake:.2f} nats"
    )
    title = "belief that the bottle is empty"
    return Result(
        title="Demonstration trial, a pill bottle half full of beans, EMPTY?",
        sentence=f"The sixth belief, printed {printed[5]:.2f}, follows from the others: "
        f"{positive[5]:.2f}, and the report is {report}.",
        tables=(Table(title, ("behavior", "percept", "paper", "ours"), tuple(rows)),),
        evidence={THEIRS: evidence},
        notes=(NOTE.format(low=low, high=high, cost=cost_of(momdp, paper["steps"])),),
    )


def predicted(before: float, after: float, now: float) -> tuple[float, float]:
    """Return the range of the belief after a percept that took `before` to `after`, from `now`.

    All three are rounded to two decimals.
    """
    reach = [-0.005, 0.005]
    ends = []
    for d in product(reach, repeat=3):
        a, b, c = (value + more for value, more in zip((before, after, now), d, strict=True))
        # Odds are multiplied by the likelihood ratio that took the odds of a to those of b.
        odds = c / (1 - c) * (b / (1 - b)) / (a / (1 - a))
        ends.append(odds / (1 + odds))
    return min(ends), max(ends)
