"""Fig. 9: two relevant attributes of ISPY32, and more and more irrelevant ones beside them."""

from collections.abc import Mapping
from math import hypot

import numpy as np

from meal_bayes.evaluation import Estimate, clustered, estimate_mean
from meal_bayes.trials import TrialOutcomes
from paper_repro.agents import ANSWERS, DECLINES
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.inference import (
    LEVEL,
    change_of_means,
    drawn_change,
    drawn_mean,
    planned_trials,
)
from paper_repro.items import fig8
from paper_repro.offline import Runs, run_agent
from paper_repro.published import plotted_ispy32
from paper_repro.statements import (
    RECORDED,
    THEIRS,
    Evidence,
    above,
    below,
    constructed,
    every,
)

IRRELEVANT = (0, 1, 2, 3, 4, 5)
RELEVANT = 2
TRIALS = 60  # of what is not judged
PUBLISHED = 200  # the paper's
FORCED = 300  # of MORC that must answer, which is judged at both ends
MEASURES = ("reward", "cost", "success")
LABELS = {"reward": "reward", "cost": "cost, s", "success": "accuracy, relevant ones"}
DRAWN = "theirs"
FORCES = "theirs, must answer"
STATEMENTS = 6  # of the column `theirs` that trials decide
SPREAD = {"first": 335.0, "last": 138.0, "cost": hypot(50.8, 75.4)}  # sd of a trial in a first run
NOTE = """One super MOMDP has all attributes in its state and in its reports, whose reward is for
the whole truth vector, as the name of the plotted file says (the active line of the published code
compares the queried values only). The first ones are relevant, and accuracy is theirs. MORC gives
up by an illegal behavior at its cost, the paper's only way; in the rows `must answer`, a variant of
ours that the paper does not have, it never does. Under `theirs` asking costs 100 s and each
attribute of an answer is right with .65. The published code has another `ask`, by which the best
reward ends above 150, whoever plans ([published_ask](published_ask.md)). The matrices that the
simulator loads were not published, so that percepts are drawn from tables of our classifiers; the
32 objects are then the whole population, trials are the units, and their number was planned from
the deviations of a first run of 60 trials. On recordings the first two points are Fig. 8's
questions and have its trials; a person is right with .7 in each; there the printed rewards are not
judged, and changes are means over the objects that both points have. A MOMDP of the relevant
attributes alone (Alg. 1, l. 2) is a level line by construction. Whether cost rises and falls again
is judged at one irrelevant attribute, the first step, and not where it is largest, which nobody
knows without looking. The planner is our tree search. With the paper's own solver
([pomdpsol](pomdpsol.md)), which answers the paper's claims, the first irrelevant attribute makes
MORC explore less, so that this sentence falls there, and the other three stand; it gives up
everything from three irrelevant attributes on, where tree search still earns something."""
SHOWS = """The paper draws reward, cost and success over 0 to 5 irrelevant attributes: reward falls
from above 150 to below 25, cost first rises and then falls as the planner gives up."""


def plan() -> dict[int, int]:
    """Return the trials of each number of irrelevant attributes where percepts are drawn.

    Those of the points that statements are about make an interval at the family's first level
    reach no farther than half of what `paper_values.toml` calls the margin.
    """
    margin = paper_values("fig9")["margin"]
    level = LEVEL / STATEMENTS
    wanted = {name: planned_trials(sd, margin[name] / 2, level) for name, sd in SPREAD.items()}
    return {
        **dict.fromkeys(IRRELEVANT, TRIALS),
        IRRELEVANT[0]: max(wanted["first"], wanted["cost"]),
        IRRELEVANT[1]: wanted["cost"],
        IRRELEVANT[-1]: max(wanted["last"], wanted["cost"]),
    }


def plan_recorded() -> dict[int, int]:
    """Return the same on recordings: where questions are Fig. 8's, its trials; at the end 200."""
    return {
        **dict.fromkeys(IRRELEVANT, TRIALS),
        **dict.fromkeys(IRRELEVANT[:2], fig8.TRIALS),
        IRRELEVANT[-1]: PUBLISHED,
    }


def run(setting: Setting) -> Result:
    """Run the super MOMDP with 0 to 5 irrelevant attributes."""
    numbers = setting.choose(IRRELEVANT, (0, 2))
    ends = (numbers[0], numbers[-1])
    planned = plan()
    runs: dict[str, dict[str, TrialOutcomes]] = {
        DRAWN: {str(k): run_drawn(setting, k, DECLINES, planned[k]) for k in numbers},
        FORCES: {str(k): run_drawn(setting, k, ANSWERS, FORCED) for k in ends},
    }
    evidence: dict[str, dict[str, Evidence | None]] = {
        THEIRS: judge(runs[DRAWN]) | judge_forced(runs[FORCES])
    }
    if RECORDED in setting.protocols:
        planned = plan_recorded()
        runs[RECORDED] = {str(k): run_recorded(setting, k, planned[k]) for k in numbers}
        level = "with the relevant attributes alone reward is level"
        evidence[RECORDED] = {
            **judge_shape(runs[RECORDED], drawn=False),
            level: constructed("irrelevant attributes never enter"),
        }
    told = []
    for kind, points in runs.items():
        first = points[str(ends[0])]
        last = points[str(ends[1])]
        told.append(
            f"{kind}: reward from {first.reward.mean():.0f} to {last.reward.mean():.0f}, "
            f"{(~last.answered).mean():.0%} given up"
        )
    return Result(
        title="Two relevant attributes and more and more irrelevant ones, in one super MOMDP",
        sentence=f"With {ends[0]} to {ends[1]} irrelevant attributes, {'; '.join(told)}.",
        tables=(table_of(runs),),
        evidence=evidence,
        size="The paper has 200 trials a row.",
        notes=(NOTE,),
        shows=SHOWS,
    )


def run_drawn(setting: Setting, irrelevant: int, agent: str, trials: int) -> TrialOutcomes:
    """Run MORC in a super MOMDP by the plotted settings, percepts drawn."""
    return run_agent(
        setting,
        THEIRS,
        plotted_ispy32(setting),
        n=RELEVANT + irrelevant,
        agent=agent,
        trials=setting.trials_of(trials, 4),
    )


def run_recorded(setting: Setting, irrelevant: int, trials: int) -> TrialOutcomes:
    """Run MORC in a super MOMDP on recordings."""
    return run_agent(
        setting,
        RECORDED,
        "ispy32",
        n=RELEVANT + irrelevant,
        agent=DECLINES,
        trials=setting.trials_of(trials, 4),
    )


def table_of(runs: Mapping[str, Runs]) -> Table:
    """Make the table of measures, a row of each kind of run and number of irrelevant attributes."""
    rows: list[tuple[Cell, ...]] = []
    for kind, points in runs.items():
        for k, outcomes in points.items():
            measures = [
                measure(outcomes, name, drawn=kind != RECORDED) for name in (*MEASURES, "abstained")
            ]
            rows.append((kind, int(k), states(int(k)), len(outcomes), *measures))
    columns = ("percepts", "irrelevant", "states", "trials", *LABELS.values(), "abstained")
    return Table("super MOMDPs", columns, tuple(rows))


def states(irrelevant: int) -> int:
    """Return |S|, of six x and one end."""
    return 6 * (1 << (RELEVANT + irrelevant)) + 1


def judge(runs: Runs) -> dict[str, Evidence | None]:
    """Judge where the curve begins and ends, and its shape, where percepts are drawn."""
    paper = paper_values("fig9")
    points = list(runs)
    first = drawn_mean(runs[points[0]], "reward")
    high = paper["first_reward_above"]
    low = paper["last_reward_below"]
    return {
        f"reward starts above {high:g}": above(first, high, of="reward"),
        f"reward ends below {low:g}": ends_below(runs[points[-1]], low),
        **judge_shape(runs, drawn=True),
    }


def ends_below(run: TrialOutcomes, low: float) -> Evidence:
    """Judge that the mean reward is below a bound.

    Rewards that are all equal have no spread. Then what a trial can earn bounds their mean: nothing
    where it is given up, the reward of a right report elsewhere.
    """
    if np.ptp(run.reward) > 0:
        return below(drawn_mean(run, "reward"), low, of="reward")
    enough = 1 - low / paper_values("offline_reward")
    return above(drawn_mean(run, "abstained"), enough, of="the fraction given up")


def judge_forced(runs: Runs) -> dict[str, Evidence | None]:
    """Judge the ends of the curve of MORC that must answer."""
    kept = list(judge(runs).items())[:2]
    return {f"{text}, where MORC must answer (ours)": entry for text, entry in kept}


def judge_shape(runs: Runs, *, drawn: bool) -> dict[str, Evidence | None]:
    """Judge that exploring grows with the first irrelevant attribute, and is given up at last."""
    points = list(runs)
    first, step, last = (runs[points[place]] for place in (0, 1, -1))

    def rise(after: TrialOutcomes, before: TrialOutcomes, name: str) -> Estimate:
        if drawn:
            return drawn_change(drawn_mean(after, name), drawn_mean(before, name))
        fraction = name == "abstained"
        return change_of_means(
            ~after.answered if fraction else after.cost,
            after.object_index,
            ~before.answered if fraction else before.cost,
            before.object_index,
            fraction=fraction,
        )

    more = above(rise(step, first, "cost"), 0, of="cost at the second point less the first, s")
    abstains = above(rise(last, first, "abstained"), 0, of="rise of abstaining")
    less = above(rise(step, last, "cost"), 0, of="cost at the second point less the last, s")
    return {
        "with more irrelevant attributes it explores more": more,
        "then it gives up: it abstains more, and explores less": every([abstains, less]),
    }


def measure(run: TrialOutcomes, name: str, *, drawn: bool) -> Estimate:
    """Estimate a measure; accuracy is that of the relevant attributes alone."""
    if name != "success":
        return drawn_mean(run, name) if drawn else estimate_mean(run, name)
    right = (run.report == run.truth)[:, :RELEVANT].all(axis=1)
    return clustered(right, run.key if drawn else run.object_index, fraction=True)
