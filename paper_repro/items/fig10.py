"""Fig. 10: learning curves on three data sets, one and two attributes."""

from collections.abc import Mapping

import numpy as np

from meal_bayes.evaluation import plots
from paper_repro.frame import (
    Cell,
    Estimate,
    Result,
    Setting,
    Table,
    asked,
    paper_values,
    until_decided,
)
from paper_repro.online import (
    BASE,
    BEST,
    LEGAL,
    OURS,
    PAPERS,
    Curves,
    at_hours,
    mean_of,
    mean_until,
    paired,
    run_curves,
    series,
)
from paper_repro.statements import Evidence, above, below, every, joined

COLUMNS = ("agent", "repeats", "explored, h", "accuracy", "reward", "reward over H h, less its",
           "95 % low", "high", "reward over the batches, less its",
           "accuracy over H h, less its")  # fmt: skip
STEPS = {"published": (10, 20, 40), "recorded": (20, 40)}  # repeats
PANELS = tuple((dataset, n) for dataset in ("cy101", "roc36", "ispy32") for n in (1, 2))
NOTE = """Curves are compared by the paired difference of their means over the first H hours of
exploration, H being where Iterative MORC ends (the area between the curves), and at fixed budgets;
accuracy is what the paper draws, reward what the agents plan for. The mean over the batches
compares equal numbers of trials, whatever they cost: an agent whose first batch lasts long may be
ahead by it and behind after equal hours. In the published protocol percepts are drawn from the
learned tables, which are cross-validated over samples, and Random Legal may ask a person at the
start (ISPY32)."""
SHOWS = """The paper draws accuracy over accumulated hours of exploration, six panels: CY101, ROC36
and ISPY32 with one and two attributes, Iterative Random Legal, Iterative MORC and MORC-ITRS, the
last on top along the whole curve. The panels below have the same axes and order."""

Panel = Mapping[str, Curves]


def run(setting: Setting) -> Result:
    """Run every panel in both protocols until its statements are decided."""
    evidence: dict[str, dict[str, Evidence | None]] = {name: {} for name in setting.protocols}
    tables, figures = [], {}
    leads: dict[str, list[str]] = {name: [] for name in setting.protocols}
    for dataset, n in setting.choose(PANELS, PANELS[2:3]):
        title = f"{dataset.upper()}, {asked(n)}"
        for protocol in setting.protocols:
            steps = setting.repeat_steps(STEPS[protocol])
            if not steps:
                evidence[protocol] |= dict.fromkeys(texts(title))
                continue
            code = protocol == "published"

            def run_one(
                agent: str, repeats: int, of: str = dataset, n: int = n, where: str = protocol
            ) -> Curves:
                return run_curves(setting, of, n, agent, repeats, where)

            agents = PAPERS if code else (*PAPERS, *OURS)
            panel, found = until_decided(
                agents, steps, run_one,
                lambda some, title=title: judge(some, title),  # type: ignore[misc]
            )  # fmt: skip
            evidence[protocol] |= found
            tables.append(compared(panel, f"{title}, {protocol}"))
            figures[f"_{dataset}_{n}" + "_published" * code] = plots.learning_curve(
                [series(curves, curves.accuracy, name) for name, curves in panel.items()]
            )
            lead = area(panel[BEST], panel[BASE], "reward")
            leads[protocol].append(f"{dataset}_{n} {paired(*lead).estimate:+.1f}")
    words = {name: "reward less its: " + ", ".join(found) for name, found in leads.items() if found}
    return Result(
        title="Learning curves, accuracy against hours of exploration",
        paper="MORC-ITRS on top along the whole curve, in all six panels",
        published=words.get("published", ""),
        ours=words.get("recorded", ""),
        tables=tuple(tables),
        statements=joined(evidence.get("recorded"), evidence["published"]),
        notes=(NOTE,),
        figures=figures,
        shows=SHOWS if figures else "",
    )


def texts(title: str) -> tuple[str, ...]:
    """Return the statements about a panel."""
    return (
        f"{title}: MORC-ITRS above Iterative MORC in accuracy over the first H hours",
        f"{title}: MORC-ITRS above Iterative MORC in reward over the first H hours",
        f"{title}: MORC-ITRS on top along the whole curve (accuracy at every budget)",
        f"{title}: MORC-ITRS spends more than Iterative MORC in the first batch, and starts later",
        f"{title}: MORC-ITRS starts earlier than Iterative Random Legal",
    )


def judge(panel: Panel, title: str) -> dict[str, Evidence]:
    """Judge the statements about a panel, from the curves of the paper's three agents."""
    best, base, legal = (panel[name] for name in (BEST, BASE, LEGAL))
    pair = (BEST, BASE)
    number = min(len(best), len(base))
    ends = min(best.hours[:, -1].min(), base.hours[:, -1].min(), legal.hours[:, -1].min())
    budgets = [hours for hours in paper_values("budgets_h") if hours <= ends] or [float(ends)]
    leads = {
        (other, hours): paired(
            at_hours(best.hours, best.accuracy, hours),
            at_hours(panel[other].hours, panel[other].accuracy, hours),
        )
        for other in (BASE, LEGAL)
        for hours in budgets
    }
    starts = {name: curves.hours[:, 1] for name, curves in panel.items()}
    last = min(len(best), len(legal))
    outcomes = (
        above(paired(*area(best, base, "accuracy")), 0, number, pair, of="accuracy less its"),
        above(paired(*area(best, base, "reward")), 0, number, pair, of="reward less its"),
        every(
            above(found, 0, number, (BEST, other), of=f"accuracy at {hours:g} h less {other}'s")
            for (other, hours), found in leads.items()
        ),
        above(paired(starts[BEST], starts[BASE]), 0, number, pair, of="hours less its"),
        below(paired(starts[BEST], starts[LEGAL]), 0, last, (BEST, LEGAL), of="hours less its"),
    )
    return dict(zip(texts(title), outcomes, strict=True))


def area(first: Curves, second: Curves, measure: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of two agents' curves until the second ends, each (S,)."""
    number = min(len(first), len(second))
    end = second.hours[:number, -1]
    sides = [
        mean_until(one.hours[:number], getattr(one, measure)[:number], end)
        for one in (first, second)
    ]
    return sides[0], sides[1]


def compared(panel: Panel, title: str) -> Table:
    """Compare the agents of a panel with Iterative MORC: areas, and rewards at fixed budgets."""
    rows: list[tuple[Cell, ...]] = []
    budgets, base = paper_values("budgets_h"), panel[BASE]
    for name, curves in panel.items():
        lead = paired(*area(curves, base, "reward"))
        trials = paired(curves.reward[:, 1:].mean(axis=1), base.reward[:, 1:].mean(axis=1))
        accuracy = paired(*area(curves, base, "accuracy"))
        at = [
            paired(at_hours(curves.hours, curves.reward, h), at_hours(base.hours, base.reward, h))
            for h in budgets
        ]
        rows.append(
            (
                name,
                len(curves),
                mean_of(curves.hours[:, -1]),
                mean_of(curves.accuracy[:, -3:].mean(axis=1)),
                mean_of(curves.reward[:, -1]),
                Estimate.of(lead),
                lead.low,
                lead.high,
                Estimate.of(trials),
                Estimate.of(accuracy),
                *map(Estimate.of, at),
            )
        )
    return Table(title, (*COLUMNS, *(f"reward at {h:g} h" for h in budgets)), tuple(rows))
