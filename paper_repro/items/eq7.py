"""Eq. 7: successes within a budget of exploration, the goal that the reward stands for."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from meal_bayes.evaluation import Interval, bootstrap_interval, canvas, plots
from meal_bayes.seeds import stream
from meal_bayes.trial_log import TrialOutcomes
from paper_repro.frame import Cell, Result, Setting, Table, asked, until_decided
from paper_repro.offline import AGAINST, Runs, run_agent
from paper_repro.statements import Evidence, best, joined

BASELINES = ("random", "random_legal", "predefined", "predefined_plus")
BUDGETS = (600.0, 1800.0, 3600.0, 7200.0)  # s
PLACES = (("roc36", 2), ("ispy32", 2))
STEPS = (200, 400, 800)  # trials; those of Table 3 and Fig. 8
NOTE = """The goal of OFFLINE-MEAL is as many right reports as possible while the costs sum up to
less than a budget (Eq. 7). Tasks come in their order, and again in it when all have been answered.
A report costs no time, so who guesses at once answers most queries: Random is ahead of everyone by
Eq. 7 wherever its costs are small, which is why the paper plans for the reward (Eq. 4) instead."""
SHOWS = """The paper draws no such figure. Successes, one line a strategy, over budgets in hours."""


def run(setting: Setting) -> Result:
    """Count successes within budgets on recorded percepts, and in the published protocol."""
    steps, evidence = setting.trial_steps(STEPS, 6), dict[str, dict[str, Evidence]]()
    compared: dict[str, Runs] = {}
    for protocol in setting.protocols:
        evidence[protocol] = {}
        for dataset, n in PLACES:

            def run_one(
                agent: str, trials: int, where: str = protocol, of: str = dataset, n: int = n
            ) -> TrialOutcomes:
                return run_agent(setting, where, of, n, agent, trials)

            title = f"{dataset.upper()}, {asked(n)}"
            runs, found = until_decided(
                (*BASELINES, AGAINST), steps, run_one,
                lambda some, title=title: judge(some, title),  # type: ignore[misc]
            )  # fmt: skip
            evidence[protocol] |= found
            compared[f"{title}, {protocol}"] = runs
    rows: list[tuple[Cell, ...]] = [
        (title, agent, *(repeated_successes(own.success, own.cost, budget) for budget in BUDGETS))
        for title, runs in compared.items()
        for agent, own in runs.items()
    ]
    columns = ("", "agent", *(f"within {budget / 3600:.2g} h" for budget in BUDGETS))
    words = {
        protocol: f"MORC within {BUDGETS[2] / 3600:g} h: " + ", ".join(
            f"{row[0].split(',')[0]} {row[4]}" for row in rows  # type: ignore[union-attr]
            if row[1] == AGAINST and str(row[0]).endswith(protocol)
        )
        for protocol in setting.protocols
    }  # fmt: skip
    return Result(
        title="Successes within a budget of exploration (Eq. 7)",
        paper="as many as possible",
        published=words["published"],
        ours=words.get("recorded", ""),
        tables=(Table("successes", columns, tuple(rows)),),
        statements=joined(evidence.get("recorded"), evidence["published"]),
        notes=(NOTE,),
        figures={
            f"_{title.split(',')[0].lower()}_{title.rsplit(' ', 1)[1]}": figure(runs)
            for title, runs in compared.items()
        },
        shows=SHOWS,
    )


def repeated_successes(success: NDArray[np.int8], cost: NDArray[np.float64], budget: float) -> int:
    """Count successes of trials whose summed costs stay below a budget (Eq. 7).

    Trials come in their order, and again when all are done; those that cost nothing at all once.
    """
    total = float(cost.sum())
    rounds, left = divmod(budget, total) if total > 0 else (0.0, budget)
    inside = np.cumsum(cost) < left
    return round(rounds * float(success.sum()) + float(success[inside].sum()))


def judge(runs: Runs, title: str) -> dict[str, Evidence]:
    """Judge that MORC has more successes an hour than every baseline, and than those that explore.

    Successes within a long budget are those of an hour times its hours; whole objects are drawn
    again for the interval.
    """
    ahead = {name: _lead(runs[AGAINST], runs[name]) for name in BASELINES}
    number = min(len(run) for run in runs.values())
    exploring = {name: one for name, one in ahead.items() if name != "random"}
    return {
        f"{title}: MORC has the most successes within a budget": best(
            ahead, number, (AGAINST,), of="successes an hour"
        ),
        f"{title}: MORC has more successes than the baselines that explore": best(
            exploring, number, (AGAINST,), of="successes an hour"
        ),
    }


def _lead(first: TrialOutcomes, second: TrialOutcomes) -> Interval:
    number = min(len(first), len(second))
    both = np.stack(
        [own[:number] for one in (first, second) for own in (one.success, one.cost)], axis=1
    )
    objects = first.object_index[:number]
    return bootstrap_interval(both, objects, stream(0, "eq7"), statistic=_hourly)


def _hourly(both: NDArray[np.float64]) -> float:
    """Successes an hour of the first less those of the second, from (T,4)."""
    first, first_cost, second, second_cost = both.sum(axis=0)
    return float(3600 * (first / max(first_cost, 1.0) - second / max(second_cost, 1.0)))


def figure(runs: Mapping[str, TrialOutcomes]) -> canvas.Axes:
    """Draw successes over budgets; Random's line leaves the picture."""
    hours = np.linspace(0, BUDGETS[-1] / 3600, 60)
    lines = [
        plots.Series(
            agent, hours,
            np.array([repeated_successes(one.success, one.cost, 3600 * h) for h in hours], float),
        )
        for agent, one in runs.items()
    ]  # fmt: skip
    ax = plots.lines(lines, x_label="budget, h", y_label="successes")
    ax.set_ylim(0, 1.1 * max(float(line.y[-1]) for line in lines if line.name != "random"))
    return ax
