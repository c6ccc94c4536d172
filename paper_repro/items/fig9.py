"""Fig. 9: two relevant attributes of ISPY32, and more and more irrelevant ones beside them."""

from collections.abc import Mapping

import numpy as np

from meal_bayes.evaluation import canvas, clustered_se, plots
from meal_bayes.trial_log import TrialOutcomes
from paper_repro.frame import Cell, Estimate, Result, Setting, Table, paper_values, until_decided
from paper_repro.offline import AGAINST, Runs, estimate, run_agent
from paper_repro.statements import (
    Evidence,
    above,
    below,
    change_of_means,
    constructed,
    every,
    joined,
    mean_interval,
)

IRRELEVANT = (0, 1, 2, 3, 4, 5)
STEPS = (100, 200, 400)  # trials
MEASURES = ("reward", "cost", "success")
LABELS = {"reward": "reward", "cost": "cost, s", "success": "accuracy, relevant ones"}
NOTE = """One super MOMDP has all attributes in its state and in its reports, whose reward is for
the whole truth vector (Eq. 4; PP src_py/constructor.py compares all values as well): MORC on a
query of so many attributes. The first ones are relevant, and accuracy is theirs. `ours` builds the
MOMDP of the relevant attributes alone (Alg. 1, l. 2), so it is a line by construction. Up to three
attributes the planner is value iteration on a grid, beyond that it is tree search."""
SHOWS = """The paper draws reward, cost and success over 0 to 5 irrelevant attributes: reward falls
from above 150 to below 25, cost first rises and then falls as the planner gives up."""


def run(setting: Setting) -> Result:
    """Run the super MOMDP with 0 to 5 irrelevant attributes, two relevant ones and one."""
    numbers, steps = setting.choose(IRRELEVANT, (0, 2)), setting.trial_steps(STEPS, 4)
    points = {str(k): k for k in numbers}
    runs: dict[str, Runs] = {}
    evidence: dict[str, dict[str, Evidence]] = {}
    for protocol in setting.protocols:

        def run_one(point: str, trials: int, where: str = protocol) -> TrialOutcomes:
            return run_agent(setting, where, "ispy32", 2 + points[point], AGAINST, trials)

        runs[protocol], evidence[protocol] = until_decided(points, steps, run_one, judge)
    single = {
        point: run_agent(setting, "published", "ispy32", 1 + points[point], AGAINST, steps[0])
        for point in points
    }
    if "recorded" in runs:
        line = "our MOMDP has the relevant attributes alone: reward is level"
        evidence["recorded"][line] = constructed("irrelevant attributes never enter")
    rows: list[tuple[Cell, ...]] = []
    for k in numbers:
        found = [run[str(k)] for run in (*runs.values(), single)]
        rows.append((k, 6 * 2 ** (2 + k) + 1, *(measure(one, m, relevant) for m in MEASURES
                     for one, relevant in zip(found, (*(2 for _ in runs), 1), strict=True)),
                     *(float((~one.answered).mean()) for one in found)))  # fmt: skip
    kinds = (*runs, "published, one relevant")
    columns = ("irrelevant", "states", *(f"{LABELS[m]}: {kind}" for m in MEASURES
               for kind in kinds), *(f"abstained: {kind}" for kind in kinds))  # fmt: skip
    ends = {kind: (run[str(numbers[0])], run[str(numbers[-1])]) for kind, run in runs.items()}
    words = {
        kind: f"reward from {a.reward.mean():.0f} to {b.reward.mean():.0f}"
        for kind, (a, b) in ends.items()
    }
    one = [single[str(k)].reward.mean() for k in (numbers[0], numbers[-1])]
    return Result(
        title="Two relevant attributes and more and more irrelevant ones, in one super MOMDP",
        paper="reward from above 150 to below 25",
        published=words["published"],
        ours=words.get("recorded", ""),
        tables=(Table("super MOMDPs", columns, tuple(rows)),),
        statements=joined(evidence.get("recorded"), evidence["published"]),
        notes=(NOTE,),
        figures={f"_{m}": figure(runs, numbers, m) for m in MEASURES},
        shows=SHOWS,
        effects={
            "19": f"one relevant attribute, 0 to {numbers[-1]} irrelevant ones, as published: "
            f"reward from {one[0]:.1f} to {one[1]:.1f}; two relevant: {words['published']}"
        },
    )


def judge(runs: Runs) -> dict[str, Evidence]:
    """Judge where the curve begins and ends, and that exploring grows before it is given up."""
    paper = paper_values("fig9")
    points = list(runs)
    first, last = runs[points[0]], runs[points[-1]]
    costs = {point: run.cost.mean() for point, run in runs.items()}
    top = max(costs, key=costs.__getitem__)
    peak, high, low = runs[top], paper["first_reward_above"], paper["last_reward_below"]
    return {
        f"reward starts above {high:g}": above(
            mean_interval(first.reward, first.object_index), high, len(first), points[:1],
            of="reward",
        ),
        f"reward ends below {low:g}": below(
            mean_interval(last.reward, last.object_index), low, len(last), points[-1:], of="reward"
        ),
        "with more irrelevant attributes it explores more": above(
            change_of_means(peak.cost, peak.object_index, first.cost, first.object_index), 0,
            min(len(peak), len(first)), (top, points[0]), of="most cost less the first, s",
        ),
        "then it gives up: it abstains more, and explores less than at most": every(
            (
                above(
                    change_of_means(
                        ~last.answered, last.object_index, ~first.answered, first.object_index
                    ),
                    0, min(len(last), len(first)), (points[-1], points[0]), of="rise of abstaining",
                ),
                above(
                    change_of_means(peak.cost, peak.object_index, last.cost, last.object_index), 0,
                    min(len(peak), len(last)), (top, points[-1]), of="most cost less the last, s",
                ),
            )
        ),
    }  # fmt: skip


def measure(run: TrialOutcomes, name: str, relevant: int) -> Estimate:
    """Estimate reward, cost, or the accuracy of the relevant attributes alone."""
    if name != "success":
        return estimate(run, name)
    right = (run.report == run.truth)[:, :relevant].all(axis=1)
    return Estimate(float(right.mean()), clustered_se(right, run.object_index))


def figure(runs: Mapping[str, Runs], numbers: tuple[int, ...], name: str) -> canvas.Axes:
    """Draw a measure over the irrelevant attributes, and ours as the line that it is."""
    x, lines = np.array(numbers, float), []
    for kind, run in runs.items():
        y, se = np.array([measure(run[str(k)], name, 2) for k in numbers]).T
        lines.append(plots.Series(kind, x, y, y - se, y + se))
    if "recorded" in runs:
        level = measure(runs["recorded"][str(numbers[0])], name, 2).mean
        lines.append(plots.Series("ours, by construction", x, np.full(len(x), level)))
    return plots.lines(lines, x_label="irrelevant attributes", y_label=LABELS[name])
