"""Fig. 10: learning curves on three data sets, one and two attributes."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from meal_bayes.datasets import load_dataset
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import Estimate
from meal_bayes.evaluation.learning import mean_until
from meal_bayes.experiments import OnlineConfig
from paper_repro.frame import Cell, Result, Setting, Table, asked, paper_values
from paper_repro.online import (
    BASE,
    BEST,
    LEGAL,
    PAPERS,
    Curves,
    at_hours,
    curves_config,
    mean_of,
    paired,
    repeats_of,
    run_curves,
)
from paper_repro.statements import (
    RECORDED,
    THEIRS,
    Evidence,
    above,
    below,
    constructed,
    every,
)

COLUMNS = (
    "agent",
    "repeats",
    "explored, h",
    "accuracy",
    "abstained",
    "reward",
    "accuracy at 0 h, less its",
    "accuracy over H h, less its",
    "reward over H h, less its",
)
PANELS = tuple((dataset, n) for dataset in ("cy101", "roc36", "ispy32") for n in (1, 2))
NOTE = """Curves are compared with Iterative MORC's ("its") by the paired difference of their means
over the first H hours of exploration (the area between the curves), and at fixed budgets. H is
where the other agent's curve ends: Iterative MORC's or Random Legal's.
Who has explored for less by its last batch keeps its last value until then: against Random Legal
MORC-ITRS, {carried}. Accuracy, abstaining and reward of the tables are those after the last batch;
who abstains ("I do not know", for 0 s) is not right. Where two attributes are asked under `theirs`,
Iterative MORC gives up about a fifth of its tests in two of twenty splits, MORC-ITRS in one of
them, and next to none in the others, which is part of the spread of their accuracies.
On recordings Iterative MORC and MORC-ITRS have one planner
and are tested without a bonus, so that at 0 h, after the same pretraining, they are one agent; what
they explored tells them apart. On recordings intervals are of other objects, of which repeats split
the same few. Under `theirs` these objects are the whole population, and repeats, each of a split of
its own, are independent. The published code has CY101 alone, so that `theirs` has its two panels,
and with one attribute the split of the published code, of which the paper's curve is the one run,
beside ours in the last table: percepts are drawn from the learned tables, which are cross-validated
over samples, two attributes share a label, objects are split 15, 40 and 45, with two attributes 30,
35 and 35, and tests are shaped (errata, 10): MORC-ITRS is tested with its bonus, so that its lead
at 0 h is no effect of learning. It is what the paper says of the starting points (that they differ,
at a bigger cost and a higher accuracy), and is judged there. What else the code does (ERRATA.md) is
not in it: agents learn after each trial here, as Alg. 2 has it (l. 3-24), after each batch there,
as Sect. 7.3 has it."""
SHOWS = """The paper draws accuracy over accumulated hours of exploration, six panels: CY101, ROC36
and ISPY32 with one and two attributes, Iterative Random Legal, Iterative MORC and MORC-ITRS, the
last on top along the whole curve. The panels below are of rewards and of accuracies, each less
Iterative MORC's, repeat by repeat, at the hours of the tables, as curves of the same splits move
together."""

Panel = Mapping[str, Curves]


def runs(setting: Setting) -> Iterator[OnlineConfig]:
    """List the runs of every panel, and those on the published code's split."""
    for title, dataset, n, protocol in panels_of(setting):
        if setting.only not in title:
            continue
        repeats = repeats_of(setting, protocol)
        for agent in PAPERS:
            yield curves_config(
                setting, dataset, n=n, agent=agent, repeats=repeats, protocol=protocol
            )
        if protocol == THEIRS and n == 1:
            for agent in (BEST, BASE):
                yield curves_config(setting, agent=agent, **published_split())


def panels_of(setting: Setting) -> Iterator[tuple[str, str, int, str]]:
    """Yield the title, the data set, the number of attributes and the column of every panel."""
    chosen = setting.choose(PANELS, PANELS[2:3])
    titles = [f"{dataset.upper()}, {asked(n)}" for dataset, n in chosen]
    if not any(setting.only in title for title in titles):
        raise SettingsError(
            f"found --only {setting.only!r}; expected a part of one of these titles: "
            f"{'; '.join(titles)}"
        )
    for title, (dataset, n) in zip(titles, chosen, strict=True):
        for protocol in setting.protocols:
            if protocol != THEIRS or dataset == "cy101":  # the published code has CY101 alone
                yield title, dataset, n, protocol


def run(setting: Setting) -> Result:
    """Run every panel, of the data set that was published under the paper's settings too."""
    evidence: dict[str, dict[str, Evidence | None]] = {name: {} for name in setting.protocols}
    panels: dict[tuple[str, str], Panel] = {}  # by title and column
    placed = list[Table]()
    for title, dataset, n, protocol in panels_of(setting):
        if setting.only not in title:
            evidence[protocol] |= dict.fromkeys(texts(title))
            continue
        panel = run_panel(setting, dataset, n, protocol)
        panels[title, protocol] = panel
        evidence[protocol] |= judge(panel, title, one_agent=protocol == RECORDED)
        if protocol == THEIRS and n == 1:
            published, others = published_split_leads(setting, panel)
            placed.append(place(title, published, others))
    tables = [compared(panel, f"{title}, {column}") for (title, column), panel in panels.items()]
    carried = []
    for (title, protocol), panel in panels.items():
        own = panel[BEST].hours[:, -1].mean()
        longest = panel[LEGAL].hours[:, -1].mean()
        carried.append(f"{title}, {protocol}, from {own:.1f} to {longest:.1f} h")
    return Result(
        title="Learning curves, accuracy against hours of exploration",
        sentence=_sentence(panels),
        tables=(*tables, *placed),
        evidence=evidence,
        size=f"{repeats_of(setting, RECORDED)} repeats; theirs: {repeats_of(setting, THEIRS)}.",
        notes=(NOTE.format(carried="; ".join(carried)),) if tables else (),
        shows=SHOWS if tables else "",
        effects=_effects(panels),
    )


def run_panel(setting: Setting, dataset: str, n: int, protocol: str) -> Panel:
    """Run the paper's three agents on the same splits and tasks."""
    repeats = repeats_of(setting, protocol)
    return {
        agent: run_curves(setting, dataset, n=n, agent=agent, repeats=repeats, protocol=protocol)
        for agent in PAPERS
    }


def lead_over_hours(panel: Panel) -> Estimate:
    """Estimate MORC-ITRS's lead in accuracy over the hours that Iterative MORC explores."""
    return paired(*area(panel[BEST], panel[BASE], "accuracy"), panel[BEST].ratio)


def at_start(first: Curves, second: Curves) -> Estimate:
    """Estimate by how much an agent is more accurate than another before both explore."""
    return paired(first.accuracy[:, 0], second.accuracy[:, 0], second.ratio)


def _sentence(panels: Mapping[tuple[str, str], Panel]) -> str:
    """Say by how much MORC-ITRS is ahead over the hours, in each column."""
    if not panels:
        return "The learning curves are not run here."
    told = []
    recorded = [
        lead_over_hours(panel).estimate
        for (_, protocol), panel in panels.items()
        if protocol == RECORDED
    ]
    if recorded:
        told.append(
            f"{min(recorded):+.3f} to {max(recorded):+.3f} on recordings (panels: {len(recorded)})"
        )
    for (title, protocol), panel in panels.items():
        if protocol == THEIRS:
            lead = lead_over_hours(panel)
            start = at_start(panel[BEST], panel[BASE])
            told.append(
                f"{lead.estimate:+.3f} by the code's settings ({title}), after "
                f"{start.estimate:+.3f} before it explores"
            )
    return (
        "Over the hours that Iterative MORC explores, MORC-ITRS's accuracy less its is "
        f"{'; '.join(told)}."
    )


def _effects(panels: Mapping[tuple[str, str], Panel]) -> dict[str, str]:
    """Return what testing with the bonus does before any learning, by the code's settings."""
    told = []
    for (title, protocol), panel in panels.items():
        if protocol == THEIRS:
            start = at_start(panel[BEST], panel[BASE])
            told.append(f"{start.estimate:+.3f} ± {start.se:.3f} ({title})")
    if not told:
        return {}
    return {
        "10": "MORC-ITRS's accuracy less Iterative MORC's before both explore, when it alone is "
        f"tested with its bonus: {', '.join(told)}"
    }


def published_split_leads(setting: Setting, panel: Panel) -> tuple[float, np.ndarray]:
    """Return MORC-ITRS's lead on the one split of the published code, and on those of a panel."""
    one = {agent: run_curves(setting, agent=agent, **published_split()) for agent in (BEST, BASE)}
    published = np.subtract(*area(one[BEST], one[BASE], "accuracy"))
    others = np.subtract(*area(panel[BEST], panel[BASE], "accuracy"))
    return float(published[0]), others


def published_split() -> dict[str, Any]:
    """Return the arguments of a run on the one split of the published code."""
    paper = paper_values("fig10")
    pretraining = tuple(paper["pretraining"])
    training = tuple(paper["training"])
    taught = {*pretraining, *training}
    tests = tuple(name for name in load_dataset("cy101").objects if name not in taught)
    split = (pretraining, training, tests)
    return {"dataset": "cy101", "n": 1, "repeats": 1, "protocol": THEIRS, "split": split}


def place(title: str, published: float, others: np.ndarray) -> Table:
    """Place the lead on the one split of the published code among those on our splits."""
    columns = ("lead in accuracy over H h", "splits", "lead", "sd", "least", "most", "below it")
    spread = float(np.std(others, ddof=1))
    ours = (float(np.mean(others)), spread, float(np.min(others)), float(np.max(others)))
    below_it = f"{(others < published).sum()} of {len(others)}"
    rows: tuple[tuple[Cell, ...], ...] = (
        ("the published code's", 1, published, None, None, None, below_it),
        ("ours", len(others), *ours, None),
    )
    return Table(f"{title}, on the published code's one split and on ours", columns, rows)


def texts(title: str) -> tuple[str, ...]:
    """Return the statements about a panel."""
    return (
        f"{title}: MORC-ITRS above Iterative MORC in accuracy over the first H hours",
        f"{title}: MORC-ITRS above Iterative Random Legal in accuracy over the first H hours",
        f"{title}: MORC-ITRS starts more accurate than both, before training",
        f"{title}: MORC-ITRS starts at a higher cost than Iterative MORC, before training",
        f"{title}: MORC-ITRS is more accurate than Iterative MORC after the last batch",
        f"{title}: MORC-ITRS has explored for less time than Iterative MORC by then",
    )


def judge(panel: Panel, title: str, *, one_agent: bool) -> dict[str, Evidence | None]:
    """Judge the statements about a panel, from the curves of the paper's three agents.

    Parameters
    ----------
    one_agent : Iterative MORC and MORC-ITRS are one before training, tested without a bonus.
    """
    best = panel[BEST]
    base = panel[BASE]
    legal = panel[LEGAL]
    ratio = best.ratio
    starts = [
        above(at_start(best, other), 0, of=f"accuracy before training less {name}'s")
        for name, other in ((BASE, base), (LEGAL, legal))
    ]
    dearer = paired(best.cost[:, 0], base.cost[:, 0], ratio)
    same = constructed("with one planner, and tests without a bonus, they are one agent there")
    final = paired(best.accuracy[:, -1], base.accuracy[:, -1], ratio)
    spent = paired(best.hours[:, -1], base.hours[:, -1], ratio)
    outcomes = (
        above(paired(*area(best, base, "accuracy"), ratio), 0, of="accuracy less its"),
        above(paired(*area(best, legal, "accuracy"), ratio), 0, of="accuracy less its"),
        same if one_agent else every(starts),
        same if one_agent else above(dearer, 0, of="cost of a test before training less its, s"),
        above(final, 0, of="accuracy less its"),
        below(spent, 0, of="hours less its"),
    )
    return dict(zip(texts(title), outcomes, strict=True))


def area(first: Curves, second: Curves, measure: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of two agents' curves until the second ends, each (S,).

    Whoever explored for less keeps its last value until then: agents are compared at equal hours.
    """
    ends = second.hours[: len(first), -1]
    return _means_until(first, measure, ends), _means_until(second, measure, ends)


def _means_until(curves: Curves, measure: str, ends: np.ndarray) -> np.ndarray:
    """Return the mean of each repeat's curve over the hours until its end, (S,)."""
    values = getattr(curves, measure)
    rows = zip(curves.hours, values, ends, strict=False)  # of the repeats that both have
    return np.array([mean_until(hours, curve, end) for hours, curve, end in rows])


def lead_at(first: Curves, second: Curves, measure: str, h: float) -> Estimate | None:
    """Estimate a lead at some hours; None where a repeat of either explored for less."""
    lead = at_hours(first.hours, getattr(first, measure), h)
    rival = at_hours(second.hours, getattr(second, measure), h)
    number = min(len(lead), len(rival))
    explored = np.isfinite(lead[:number] + rival[:number]).all()
    return paired(lead, rival, second.ratio) if explored else None


def compared(panel: Panel, title: str) -> Table:
    """Compare the agents of a panel with Iterative MORC: areas, and both measures at budgets."""
    rows: list[tuple[Cell, ...]] = []
    base = panel[BASE]
    ratio = base.ratio
    measures = ("reward", "accuracy")
    points = {f"{m} at {h:g} h": (m, h) for m in measures for h in paper_values("budgets_h")}
    for name, curves in panel.items():
        rows.append(
            (
                name,
                len(curves),
                mean_of(curves.hours[:, -1], ratio),
                mean_of(curves.accuracy[:, -1], ratio, fraction=True),
                mean_of(curves.abstained[:, -1], ratio, fraction=True),
                mean_of(curves.reward[:, -1], ratio),
                at_start(curves, base),
                paired(*area(curves, base, "accuracy"), ratio),
                paired(*area(curves, base, "reward"), ratio),
                *(lead_at(curves, base, measure, h) for measure, h in points.values()),
            )
        )
    return Table(title, (*COLUMNS, *points), tuple(rows))
