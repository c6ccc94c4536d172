"""Fig. 11: CY101, accuracy of each attribute after two hours of exploration."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.online import (
    ATTRIBUTES,
    BASE,
    BEST,
    LEGAL,
    PAPERS,
    Curves,
    mean_of,
    repeats_of,
    run_curves,
)
from paper_repro.statements import Evidence, above, below, every, placed

NAMES = ATTRIBUTES["cy101"]
NOTE = """Read off the curves of Fig. 10 by linear interpolation; an agent that explores for less
is read at the end of its curve, and an attribute that no test of a split asks counts as .5. Dots
are ranked by MORC-ITRS, as in the paper. Best on seven: the paper shows one split, which is placed
among ours: on how many attributes MORC-ITRS is ahead of both others. Easy: Iterative MORC
and MORC-ITRS, of which the sentence speaks, are both above their mean over the attributes that are
not easy; Random Legal is weak where it is behind both of them on the easy ones. Under `theirs`
percepts are drawn from tables of our classifiers."""
SHOWS = """The paper draws three bars for each of ten attributes, ranked by MORC-ITRS: PLASTIC, HARD
and EMPTY are last, no more than 80 % for all three, BLUE, FULL and CONTAINER are among the first;
MORC-ITRS is ahead on 7."""

Scores = Mapping[str, NDArray[np.float64]]  # (S,P) by agent


def run(setting: Setting) -> Result:
    """Read the curves of Fig. 10 at two hours, attribute by attribute."""
    paper, size = paper_values("fig11"), []
    evidence: dict[str, Mapping[str, Evidence | None]] = {}
    rows: list[tuple[Cell, ...]] = []
    told = []
    for protocol in setting.protocols[:2]:
        repeats = repeats_of(setting, protocol, 1)
        size.append(f"{repeats} repeats ({protocol})")
        curves = {
            agent: run_curves(setting, "cy101", 1, agent, repeats, protocol) for agent in PAPERS
        }
        scores = {agent: at_two_hours(entry, paper["hours"]) for agent, entry in curves.items()}
        ratio = curves[BEST].ratio
        evidence[protocol] = judge(scores, ratio)
        order = np.argsort(-np.nanmean(scores[BEST], axis=0), kind="stable")
        cells = {
            name: [mean_of(scores[name][:, p], ratio, fraction=True) for p in order]
            for name in PAPERS
        }
        rows += [(protocol, NAMES[p], *(cells[a][i] for a in PAPERS)) for i, p in enumerate(order)]
        ahead = wins(scores)
        mean = {agent: np.nanmean(score, axis=0)[None] for agent, score in scores.items()}
        told.append(f"on {ahead.mean():.1f} in a split ({ahead.min()} to {ahead.max()}), by mean "
                    f"accuracy on {wins(mean)[0]} ({protocol})")  # fmt: skip
    return Result(
        title=f"CY101, accuracy of each attribute at {paper['hours']:g} h of exploration",
        sentence=f"Of ten attributes MORC-ITRS is best {'; '.join(told)}; the paper shows "
        f"{paper['wins']}.",
        tables=(Table("accuracy, ranked by MORC-ITRS", ("percepts", "attribute", *PAPERS),
                      tuple(rows)),),
        evidence=evidence,
        size=f"{', '.join(size)}.",
        notes=(NOTE,),
        shows=SHOWS,
    )  # fmt: skip


def wins(scores: Scores) -> NDArray[np.int64]:
    """Count the attributes on which MORC-ITRS is ahead of both others, (S,)."""
    others = np.max([values for agent, values in scores.items() if agent != BEST], axis=0)
    return np.asarray((scores[BEST] > others).sum(axis=1))


def judge(scores: Scores, ratio: float) -> dict[str, Evidence | None]:
    """Judge the statements from the accuracy of each attribute, (S,P) for each agent."""
    paper = paper_values("fig11")
    accuracy = {agent: np.nan_to_num(values, nan=0.5) for agent, values in scores.items()}
    one = placed(wins(accuracy), paper["wins"], of="number of attributes")
    evidence: dict[str, Evidence | None] = {f"MORC-ITRS is best on {paper['wins']} of 10": one}
    for name in paper["hard"]:
        p = NAMES.index(name)
        evidence[f"{name} is no more than {paper['hard_below']:g} for all three"] = every([
            below(mean_of(values[:, p], ratio, fraction=True), paper["hard_below"],
                  of=f"{agent}'s accuracy")
            for agent, values in accuracy.items()
        ])  # fmt: skip
    easy = [NAMES.index(name) for name in paper["easy"]]
    others = [p for p in range(len(NAMES)) if p not in easy]
    for p in easy:
        evidence[f"{NAMES[p]} is easy for Iterative MORC and MORC-ITRS"] = every([
            above(mean_of(accuracy[agent][:, p] - accuracy[agent][:, others].mean(axis=1), ratio),
                  0, of=f"{agent}'s accuracy less that of the others")
            for agent in (BASE, BEST)
        ])  # fmt: skip
    evidence["Random Legal is relatively weak on the easy ones"] = every([
        below(mean_of((accuracy[LEGAL] - accuracy[agent])[:, easy].mean(axis=1), ratio), 0,
              of=f"its accuracy less that of {agent}")
        for agent in (BASE, BEST)
    ])  # fmt: skip
    return evidence


def at_two_hours(curves: Curves, hours: float) -> NDArray[np.float64]:
    """Read the accuracy of each attribute at some hours, (S,P)."""
    accuracy = np.full((len(curves), curves.by_attribute.shape[-1]), np.nan)
    for s, p in np.ndindex(accuracy.shape):
        values = curves.by_attribute[s, :, p]
        known = ~np.isnan(values)
        if known.any():
            accuracy[s, p] = np.interp(hours, curves.hours[s, known], values[known])
    return accuracy
