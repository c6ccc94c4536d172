"""Figs 8, 10 and 11 by one hierarchical model of outcomes, beside the design-based intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from meal_bayes.evaluation import Estimate, compare_outcomes, difference, resampled
from meal_bayes.evaluation.outcome_model import MARGINS, AgentEffect
from meal_bayes.trials import TrialOutcomes
from paper_repro.frame import Cell, Result, Setting, Table, asked, paper_values
from paper_repro.items.fig8 import BASELINES, run_strategy
from paper_repro.items.fig10 import PANELS
from paper_repro.offline import AGAINST, OWN
from paper_repro.online import BASE, BEST, OUR_AGENT, PAPERS, REPEATS, run_curves
from paper_repro.statements import RECORDED

DRAWS = 300  # in each of two chains
OFFLINE_TRIALS = 400  # of Fig. 8's; a fit takes minutes
COLUMNS = (
    "",
    "agent",
    "trials",
    "accuracy less the paper's agent's",
    "by the model",
    "low",
    "high",
    "Pr(ahead)",
    "Pr(equivalent)",
)
NOTE = """Accuracy on recordings less that of the paper's agent: of MORC in Fig. 8, of MORC-ITRS
after {hours:g} h of exploration in Figs 10 and 11 (tests after the last batch that ended by then).
The first column has the paired difference and its standard error by design, clustered by object or
over splits of the same objects. The others are of the model of `meal-bayes compare`: an effect,
shrunk towards those of other agents (in Fig. 11 of other attributes), its 95 % credible interval,
Pr(the agent is more accurate than the paper's), and Pr(they differ by less than {margin:g}), the
region of practical equivalence. Each number of attributes and each panel is one fit; Fig. 11 is of
CY101's panel. Pr(ahead) is withheld where one of both intervals leaves 0 out and the other does
not: the model takes what an agent owes to the objects that taught it for luck of each repeat, and
is too sure where repeats teach the same objects. Of Fig. 8 these are the first 400 of 1,184 trials,
whose leads with two attributes are smaller on its own page ([fig8](fig8.md)). How often intervals
of both kinds contain the truth in worlds of either kind: `python benchmarks/compare.py`
(benchmarks/README.md)."""
SHOWS = """Colored dots and lines: effects by the model and their 95 % credible intervals. Gray
lines below them: by design. Gray band: practical equivalence. Left of 0 the paper's agent is
ahead."""

Pairs = list[tuple[AgentEffect, Estimate]]  # by the model, and by design
Panel = Mapping[str, list[TrialOutcomes]]  # tests of each repeat, by agent


def run(setting: Setting) -> Result:
    """Fit the model to the trials of Figs 8, 10 and 11, which the logs hold."""
    hours = paper_values("fig11")["hours"]
    repeats = setting.repeats_of(REPEATS, column=RECORDED)
    pairs: dict[str, Pairs] = {"Fig. 8": [], "Fig. 10": [], "Fig. 11": []}
    for n in setting.choose((1, 2, 3), (2,)):
        pairs["Fig. 8"] += offline_pairs(setting, n)
    told = []
    for dataset, n in setting.choose(PANELS, PANELS[2:3]):
        title = f"{dataset.upper()}, {asked(n)}"
        if setting.only not in title:
            continue
        panel, ratio = online_panel(setting, dataset, n, repeats=repeats, hours=hours)
        by_attributes = (dataset, n) == PANELS[0]  # Fig. 11 is of CY101's single attributes
        for row, plain in online_pairs(setting, panel, ratio, by_attributes=by_attributes):
            figure = "Fig. 11" if row.attributes else "Fig. 10"
            pairs[figure].append((replace(row, attributes=row.attributes or title), plain))
            if row.agent == BASE and not row.attributes:
                told.append(f"{1 - row.ahead:.2f} ({title}; equivalent {row.equivalent:.2f})")
    return Result(
        title="Figs 8, 10 and 11 by one hierarchical model of outcomes",
        sentence=f"Pr(MORC-ITRS is more accurate than Iterative MORC after {hours:g} h) is, by the "
        f"model, {', '.join(told) or 'not computed here'}.",
        tables=(table_of(pairs),),
        evidence={},
        size=f"{setting.trials_of(OFFLINE_TRIALS, 6)} trials an agent offline, {repeats} repeats.",
        notes=(NOTE.format(hours=hours, margin=MARGINS["success"]),),
        shows=SHOWS,
    )


def draws_of(setting: Setting) -> int:
    """Return the draws of the posterior in each chain."""
    return setting.choose(DRAWS, 50)


def offline_pairs(setting: Setting, n: int) -> Pairs:
    """Compare Fig. 8's agents with MORC at a number of attributes, by the model and by design."""
    trials = setting.trials_of(OFFLINE_TRIALS, 6)
    agents = (*BASELINES, AGAINST, OWN)
    runs = {agent: run_strategy(setting, RECORDED, n, agent, trials) for agent in agents}
    rows = compare_outcomes(
        TrialOutcomes.join(list(runs.values())),
        reference=AGAINST,
        draws=draws_of(setting),
        seed=setting.seed,
    )
    pairs = []
    for row in rows:
        plain = difference(runs[row.agent], runs[AGAINST], measure="success")
        pairs.append((replace(row, attributes=asked(n)), plain))
    return pairs


def online_panel(
    setting: Setting, dataset: str, n: int, *, repeats: int, hours: float
) -> tuple[Panel, float]:
    """Return a panel's tests after some hours of exploration.

    Returns
    -------
    panel : each agent's tests after the last batch that ended by then, S repeats.
    ratio : of test objects to others, by which differences over repeats are corrected.
    """
    panel = {}
    ratio = 0.0
    for agent in (*PAPERS, OUR_AGENT):
        curves = run_curves(setting, dataset, n=n, agent=agent, repeats=repeats)
        last = [np.searchsorted(explored, hours, side="right") - 1 for explored in curves.hours]
        panel[agent] = [tests[b] for tests, b in zip(curves.tests, last, strict=True)]
        ratio = curves.ratio
    return panel, ratio


def online_pairs(setting: Setting, panel: Panel, ratio: float, *, by_attributes: bool) -> Pairs:
    """Compare a panel's agents with MORC-ITRS; of single attributes, with the paper's agents."""
    outcomes = [tests for splits in panel.values() for tests in splits]
    # The repeat of each trial: agents of one repeat share its split of the objects.
    repeats = [s for splits in panel.values() for s, tests in enumerate(splits) for _ in tests.key]
    rows = compare_outcomes(
        TrialOutcomes.join(outcomes),
        reference=BEST,
        repeats=repeats,
        draws=draws_of(setting),
        by_attributes=by_attributes,
        seed=setting.seed,
    )
    pairs = []
    for row in rows:
        if row.attributes and row.agent not in PAPERS:
            continue  # Fig. 11 has the paper's agents alone
        lead = accuracies(panel[row.agent], row.attributes)
        lead = lead - accuracies(panel[BEST], row.attributes)
        # nan where a split's tests ask nothing of this attribute
        pairs.append((row, resampled(lead[~np.isnan(lead)], ratio)))
    return pairs


def table_of(pairs: Mapping[str, Pairs]) -> Table:
    """Make the table of both estimates, a row of each agent in each panel."""
    rows: list[tuple[Cell, ...]] = [
        (
            f"{figure}: {row.attributes}",
            row.agent,
            row.trials,
            plain,
            row.effect,
            row.low,
            row.high,
            row.ahead if agree(row, plain) else None,
            row.equivalent,
        )
        for figure, group in pairs.items()
        for row, plain in group
    ]
    return Table("accuracy on recordings", COLUMNS, tuple(rows))


def agree(row: AgentEffect, plain: Estimate) -> bool:
    """Return whether both intervals leave 0 out, or neither does.

    The model takes what an agent owes to the objects that taught it for luck drawn anew, and is
    too sure of it where repeats teach the same objects.
    """
    interval = plain.interval()
    return (row.low > 0 or row.high < 0) == (interval.low > 0 or interval.high < 0)


def accuracies(splits: Sequence[TrialOutcomes], attributes: str) -> np.ndarray:
    """Return the accuracy in each split, (S,), of the trials that ask an attribute, or of all."""
    means = np.full(len(splits), np.nan)
    for s, tests in enumerate(splits):
        asks = tests.attribute[:, 0] == attributes
        right = tests.success[asks] if attributes else tests.success
        if len(right):
            means[s] = right.mean()
    return means
