"""Fig. 9: two relevant attributes of ISPY32, and more and more irrelevant ones beside them."""

import numpy as np
from frame import Cell, Claim, Result, Setting, Table, main, paper_values
from super_momdp import Point, Points, mean, run_points, timing

from meal_bayes.evaluation import canvas, plots

Row = tuple[Cell, ...]
MEASURES = {"reward": "reward", "cost": "cost, s", "success": "accuracy"}
KINDS = {"flat": "published", "drawn": "published", "ours": "recorded"}  # protocols
NOTE = """All attributes are perceived and believed in; only the two relevant ones are asked, so in
a factored model the others change no decision. `flat` is point-based value iteration over all
states, 5 s a query (a sweep that has begun ends), in place of the paper's solver; its arrays end at
three irrelevant attributes. `drawn` is the factored planner in the published protocol too."""


def run(setting: Setting) -> Result:
    """Measure reward, cost and success over the number of irrelevant attributes."""
    paper, found, rows = paper_values("fig9"), run_points(_points(setting), setting), list[Row]()
    for k in setting.of("fig9", "irrelevant"):
        kinds = [found.get((kind, k)) for kind in KINDS]
        states = next(trials for trials in kinds if trials)[0]["states"]
        cells = [mean(t, m) if t else None for m in MEASURES for t in kinds]
        rows.append((k, f"{states:.3g}", *cells))
    labels = [f"{label}: {kind}" for label in MEASURES.values() for kind in KINDS]
    reward = {k: [mean(t, "reward").mean for t in _curve(found, k).values()] for k in KINDS}
    high, low = paper["first_reward_above"], paper["last_reward_below"]
    starts = {kind: curve[0] > high for kind, curve in reward.items() if curve}
    falls = {kind: curve[0] > low > min(curve) for kind, curve in reward.items() if curve}
    own = reward["ours"] or reward["drawn"]
    return Result(
        item="fig9",
        title="Two relevant attributes and more and more irrelevant ones, in one super MOMDP",
        paper=f"reward from above {high:.0f} to below {low:.0f}",
        ours=f"reward from {own[0]:.1f} to {own[-1]:.1f} with {rows[-1][0]} irrelevant ones",
        tables=(Table("super MOMDPs", ("irrelevant", "states", *labels), tuple(rows)),),
        claims=(
            Claim(f"reward starts above {high:.0f}", starts.get("ours"), starts["flat"]),
            Claim(f"reward falls below {low:.0f}", falls.get("ours"), falls["flat"]),
        ),
        notes=(NOTE.replace("\n", " "),),
        figures={f"_{measure}": figure(found, measure) for measure in MEASURES},
        seconds=sum(row["planning_s"] + row["trial_s"] for rows in found.values() for row in rows),
        timing=timing(found),
    )


def _points(setting: Setting) -> dict[tuple[str, int], Point]:
    count, few, s, flat_ks, ks = (
        setting.of("fig9", key)
        for key in ("trials", "flat_trials", "flat_seconds", "flat_irrelevant", "irrelevant")
    )
    points = {("flat", k): Point("flat", "published", k, few, s) for k in flat_ks}
    for kind in ("drawn", "ours"):
        if KINDS[kind] in setting.protocols:
            points |= {(kind, k): Point("factored", KINDS[kind], k, count, 0.0) for k in ks}
    return points


def _curve(found: Points, kind: str) -> Points:
    return {key: trials for key, trials in found.items() if key[0] == kind}


def figure(found: Points, measure: str) -> canvas.Axes:
    """Draw a measure over the irrelevant attributes."""
    lines = []
    for kind in KINDS:
        if curve := _curve(found, kind):
            y, se = np.array([mean(trials, measure) for trials in curve.values()]).T
            lines.append(
                plots.Series(kind, np.array([k for _, k in curve], float), y, y - se, y + se)
            )
    return plots.lines(lines, x_label="irrelevant attributes", y_label=MEASURES[measure])


if __name__ == "__main__":
    main(run)
