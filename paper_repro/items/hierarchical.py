"""Figs 8, 10 and 11 by one hierarchical model of outcomes, beside the design-based intervals."""

from collections.abc import Sequence
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
COLUMNS = ("", "agent", "trials", "accuracy less the paper's agent's", "by the model", "low",
           "high", "Pr(ahead)", "Pr(equivalent)")  # fmt: skip
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


def run(setting: Setting) -> Result:
    """Fit the model to the trials of Figs 8, 10 and 11, which the logs hold."""
    hours, repeats = (
        paper_values("fig11")["hours"], setting.repeats_of(REPEATS, column=RECORDED)
    )  # fmt: skip
    draws = setting.choose(DRAWS, 50)
    pairs: dict[str, Pairs] = {"Fig. 8": [], "Fig. 10": [], "Fig. 11": []}
    for n in setting.choose((1, 2, 3), (2,)):
        runs = {
            agent: run_strategy(setting, RECORDED, n, agent, setting.trials_of(OFFLINE_TRIALS, 6))
            for agent in (*BASELINES, AGAINST, OWN)
        }
        joined = TrialOutcomes.join(list(runs.values()))
        for row in compare_outcomes(joined, reference=AGAINST, draws=draws, seed=setting.seed):
            plain = difference(runs[row.agent], runs[AGAINST], measure="success")
            pairs["Fig. 8"].append((replace(row, attributes=asked(n)), plain))
    told = []
    for dataset, n in setting.choose(PANELS, PANELS[2:3]):
        title = f"{dataset.upper()}, {asked(n)}"
        by_attributes = (dataset, n) == PANELS[0]
        if setting.only not in title:
            continue
        panel = {}
        ratio = 0.0
        for agent in (*PAPERS, OUR_AGENT):
            curves = run_curves(setting, dataset, n, agent, repeats)
            last = [np.searchsorted(explored, hours, side="right") - 1 for explored in curves.hours]
            panel[agent] = [tests[b] for tests, b in zip(curves.tests, last, strict=True)]
            ratio = curves.ratio
        outcomes = [tests for splits in panel.values() for tests in splits]
        splits = [s for parts in panel.values() for s, tests in enumerate(parts) for _ in tests.key]
        rows = compare_outcomes(
            TrialOutcomes.join(outcomes),
            reference=BEST,
            repeats=splits,
            draws=draws,
            by_attributes=by_attributes,
            seed=setting.seed,
        )
        for row in rows:
            if row.attributes and row.agent not in PAPERS:
                continue
            accuracy, best = (accuracies(panel[name], row.attributes) for name in (row.agent, BEST))
            plain = resampled((accuracy - best)[~np.isnan(accuracy - best)], ratio)
            figure = "Fig. 11" if row.attributes else "Fig. 10"
            pairs[figure].append((replace(row, attributes=row.attributes or title), plain))
            if row.agent == BASE and not row.attributes:
                told.append(f"{1 - row.ahead:.2f} ({title}; equivalent {row.equivalent:.2f})")
    cells: list[tuple[Cell, ...]] = [
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
    return Result(
        title="Figs 8, 10 and 11 by one hierarchical model of outcomes",
        sentence=f"Pr(MORC-ITRS is more accurate than Iterative MORC after {hours:g} h) is, by the "
        f"model, {', '.join(told) or 'not computed here'}.",
        tables=(Table("accuracy on recordings", COLUMNS, tuple(cells)),),
        evidence={},
        size=f"{setting.trials_of(OFFLINE_TRIALS, 6)} trials an agent offline, {repeats} repeats.",
        notes=(NOTE.format(hours=hours, margin=MARGINS["success"]),),
        shows=SHOWS,
    )


def agree(row: AgentEffect, plain: Estimate) -> bool:
    """Return whether both intervals leave 0 out, or neither does.

    The model takes what an agent owes to the objects that taught it for luck drawn anew, and is
    too sure of it where repeats teach the same objects.
    """
    interval = plain.interval()
    return (row.low > 0 or row.high < 0) == (interval.low > 0 or interval.high < 0)


def accuracies(splits: Sequence[TrialOutcomes], attributes: str) -> np.ndarray:
    """Return the accuracy in each split, (S,), of the trials that ask an attribute, or of all."""
    chosen = [
        tests.success[(tests.attribute[:, 0] == attributes) | (not attributes)] for tests in splits
    ]
    return np.array([right.mean() if len(right) else np.nan for right in chosen])
