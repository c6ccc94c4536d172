"""Fig. 11: CY101, accuracy of each attribute after two hours of exploration."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from meal_bayes.evaluation import Interval, plots
from paper_repro.frame import Cell, Estimate, Result, Setting, Table, paper_values, until_decided
from paper_repro.online import (
    ATTRIBUTES,
    BASE,
    BEST,
    STEPS,
    Curves,
    mean_of,
    paired,
    run_curves,
)
from paper_repro.statements import (
    Evidence,
    above,
    at_least,
    below,
    every,
    joined,
    mean_interval,
)

NAMES = ATTRIBUTES["cy101"]
AGENTS = (BASE, BEST)  # the two that the paper draws
NOTE = """Read off the curves of Fig. 10 by linear interpolation; an agent that explores for less is
read at the end of its curve. Bars are ranked by MORC-ITRS, as in the paper. Easy: above the mean of
the other attributes, for both methods."""
SHOWS = """The paper draws two bars for each of ten attributes, ranked by MORC-ITRS: PLASTIC, HARD
and EMPTY are last, below 80 %, BLUE, FULL and CONTAINER are among the first; MORC-ITRS is ahead on
7."""

Scores = Mapping[str, NDArray[np.float64]]  # (S,P) by agent


def run(setting: Setting) -> Result:
    """Read the curves of Fig. 10 at two hours, attribute by attribute, in both protocols."""
    paper, steps = paper_values("fig11"), setting.repeat_steps(STEPS)
    found: dict[str, Scores] = {}
    evidence: dict[str, Mapping[str, Evidence | None]] = {}
    for protocol in setting.protocols:
        if not steps:
            evidence[protocol] = dict.fromkeys(texts())
            continue

        def run_one(agent: str, repeats: int, where: str = protocol) -> NDArray[np.float64]:
            curves = run_curves(setting, "cy101", 1, agent, repeats, where)
            return at_two_hours(curves, paper["hours"])

        found[protocol], evidence[protocol] = until_decided(AGENTS, steps, run_one, judge)
    rows: list[tuple[Cell, ...]] = []
    figures, words = {}, {}
    for protocol, scores in found.items():
        order = np.argsort(-np.nanmean(scores[BEST], axis=0), kind="stable")
        lead = np.nanmean(scores[BEST], axis=0) - np.nanmean(scores[BASE], axis=0)
        words[protocol] = f"MORC-ITRS ahead on {int((lead > 0).sum())} of {len(NAMES)}, by the mean"
        cells = {name: [_mean(scores[name][:, p]) for p in order] for name in AGENTS}
        rows += [(protocol, NAMES[p], cells[BASE][i], cells[BEST][i]) for i, p in enumerate(order)]
        groups = {a: [Interval(m, s, m - s, m + s) for m, s in cells[a]] for a in AGENTS}
        ax = plots.bars(groups, [NAMES[p] for p in order], y_label="accuracy", fraction=True)
        ax.tick_params(axis="x", rotation=45)
        figures[f"_{protocol}"] = ax
    return Result(
        title=f"CY101, accuracy of each attribute at {paper['hours']:g} h of exploration",
        paper=f"MORC-ITRS best on {paper['wins']} of 10",
        published=words.get("published", ""),
        ours=words.get("recorded", ""),
        tables=(Table("accuracy, ranked by MORC-ITRS", ("protocol", "attribute", *AGENTS),
                      tuple(rows)),) if rows else (),
        statements=joined(evidence.get("recorded"), evidence["published"]),
        notes=(NOTE,),
        figures=figures,
        shows=SHOWS if figures else "",
    )  # fmt: skip


def texts() -> tuple[str, ...]:
    """Return the statements about the figure."""
    paper = paper_values("fig11")
    return (
        f"MORC-ITRS is best on {paper['wins']} of 10",
        *(f"{name} is below {paper['hard_below']:g} for both" for name in paper["hard"]),
        *(f"{name} is easy" for name in paper["easy"]),
    )


def judge(scores: Scores) -> dict[str, Evidence]:
    """Judge the statements from the accuracy of each attribute, (S,P) for each agent."""
    paper, pair = paper_values("fig11"), (BEST, BASE)
    number = min(map(len, scores.values()))
    own = {agent: np.nan_to_num(values[:number], nan=0.5) for agent, values in scores.items()}
    ahead = [
        above(paired(own[BEST][:, p], own[BASE][:, p]), 0, number, pair) for p in range(len(NAMES))
    ]
    outcomes = [at_least(paper["wins"], ahead, of="attributes, MORC-ITRS ahead")]
    for name in paper["hard"]:
        p = NAMES.index(name)
        outcomes.append(every(
            below(mean_interval(values[:, p], range(number)), paper["hard_below"], number, pair,
                  of=f"{agent}'s accuracy")
            for agent, values in own.items()
        ))  # fmt: skip
    for name in paper["easy"]:
        p = NAMES.index(name)
        others = [q for q in range(len(NAMES)) if q != p]
        outcomes.append(every(
            above(paired(values[:, p], values[:, others].mean(axis=1)), 0, number, pair,
                  of=f"{agent}'s accuracy less that of the others")
            for agent, values in own.items()
        ))  # fmt: skip
    return dict(zip(texts(), outcomes, strict=True))


def at_two_hours(curves: Curves, hours: float) -> NDArray[np.float64]:
    """Read the accuracy of each attribute at some hours, (S,P)."""
    found = np.full((len(curves), curves.by_attribute.shape[-1]), np.nan)
    for s, p in np.ndindex(found.shape):
        values = curves.by_attribute[s, :, p]
        known = ~np.isnan(values)
        if known.any():
            found[s, p] = np.interp(hours, curves.hours[s, known], values[known])
    return found


def _mean(values: NDArray[np.float64]) -> Estimate:
    known = values[~np.isnan(values)]
    return mean_of(known) if len(known) else mean_of(np.array([np.nan]))
