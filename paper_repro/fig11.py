"""Fig. 11: CY101, accuracy of each attribute after two hours of exploration."""

import numpy as np
from frame import Cell, Claim, Estimate, Result, Setting, Table, main, paper_values
from online import OURS, PAPERS, mean_of, panel

import meal_bayes
from meal_bayes.evaluation import Interval, plots
from meal_bayes.trial_log import BatchOutcomes

AGENTS = (*PAPERS, *OURS)


def run(setting: Setting) -> Result:
    """Read the curves of Fig. 10 at two hours, attribute by attribute."""
    paper, names = paper_values("fig11"), meal_bayes.load_domain("cy101").attributes
    repeats = setting.of("fig10", "repeats")["cy101_1"]
    results = list(panel(setting, "cy101", 1, AGENTS, repeats).results())
    hours = paper["hours"]
    found = {agent: [_at(results, agent, name, hours) for name in names] for agent in AGENTS}
    rows: list[tuple[Cell, ...]] = [
        (name, *(found[agent][p] for agent in AGENTS)) for p, name in enumerate(names)
    ]
    scores = np.array([[found[agent][p].mean for p in range(len(names))] for agent in PAPERS])
    wins = int((scores.argmax(axis=0) == PAPERS.index(paper["best"])).sum())
    of = {name: [found[agent][p].mean for agent in PAPERS] for p, name in enumerate(names)}
    claims = [Claim(f"MORC-ITRS is best on {paper['wins']} of 10", wins >= paper["wins"])]
    claims += [Claim(f"{name} below .8 for all", max(of[name]) < paper["hard_below"])
               for name in paper["hard"]]  # fmt: skip
    easy = float(np.median([value for values in of.values() for value in values]))
    claims += [Claim(f"{name} is easy (above the median)", min(of[name]) > easy)
               for name in paper["easy"]]  # fmt: skip
    groups = {a: [Interval(m, s, m - s, m + s) for m, s in found[a]] for a in AGENTS}
    ax = plots.bars(groups, list(names), y_label=f"accuracy at {hours:g} h", fraction=True)
    ax.legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize=8, frameon=False)
    ax.tick_params(axis="x", rotation=45)
    return Result(
        item="fig11",
        title=f"CY101, accuracy of each attribute at {hours:g} h of exploration",
        paper=f"MORC-ITRS best on {paper['wins']} of 10",
        ours=f"MORC-ITRS best of the paper's three on {wins} of 10",
        tables=(Table("accuracy, linear between batches", ("attribute", *AGENTS), tuple(rows)),),
        claims=tuple(claims),
        notes=("Agents that explore for less than that are read at the end of their curve.",),
        figures={"": ax},
    )


def _at(results: list[BatchOutcomes], agent: str, attribute: str, hours: float) -> Estimate:
    """Accuracy of one attribute at some hours, and its standard error over repeats."""
    repeats: dict[int, list[tuple[float, float]]] = {}
    for result in results:
        if result.agent == agent:
            asked = result.outcomes.attribute[:, 0] == attribute
            found = result.outcomes.success[asked]
            share = float(found.mean()) if asked.any() else np.nan
            repeats.setdefault(result.repeat, []).append((result.hours, share))
    curves = [np.array(points) for points in repeats.values()]
    values = np.array([np.interp(hours, curve[:, 0], curve[:, 1]) for curve in curves])
    return mean_of(values[~np.isnan(values)])


if __name__ == "__main__":
    main(run)
