"""Fig. 8: five strategies, and ours, on ISPY32 with one, two and three attributes."""

from collections.abc import Mapping
from itertools import product

from frame import Cell, Claim, Result, Setting, Table, asked, main, paper_values
from trials import AGAINST, Trials, paired_table, run_agents

from meal_bayes.evaluation import Interval, canvas, plots

PAPERS = ("random", "random_legal", "predefined", "predefined_plus", "morc")
AGENTS = (*PAPERS, "bayes")
OTHERS = [agent for agent in AGENTS if agent != AGAINST]
MEASURES = {"reward": "reward", "cost": "cost, s", "success": "accuracy"}
NOTE = "No numbers are printed. MORC is best where none of the five is better by over two s.e."

Runs = Mapping[int, Trials]  # by the number of attributes


def run(setting: Setting) -> Result:
    """Run all strategies on the same queries."""
    runs = {protocol: _runs(setting, protocol) for protocol in setting.protocols}
    numbers, best = setting.of("fig8", "attributes"), paper_values("fig8")["best"]
    rows: list[tuple[Cell, ...]] = [
        (n, agent, *(r[n].mean(agent, m) for m in MEASURES for r in runs.values()))
        for n, agent in product(numbers, AGENTS)
    ]
    labels = [f"{label}: {name}" for label in MEASURES.values() for name in runs]
    columns = ("attributes", "agent", *labels)
    claims = []
    for n, measure in product(numbers, ("reward", "success")):
        stands = {name: is_best(r[n], best, measure) for name, r in runs.items()}
        text = f"MORC is best in {MEASURES[measure]} at {asked(n)}"
        claims.append(Claim(text, stands.get("recorded"), stands["published"]))
    figures = {f"_{m}_{name}": figure(r, m) for name, r in runs.items() for m in MEASURES}
    own = [f"{list(runs.values())[-1][n].mean(best, 'reward').mean:.0f}" for n in numbers]
    compared = {f"{name}, {asked(n)}": r[n] for n in numbers for name, r in runs.items()}
    return Result(
        item="fig8",
        title="Strategies on ISPY32",
        paper="MORC best in reward and success",
        ours="MORC's reward " + ", ".join(own),
        tables=(Table("strategies", columns, tuple(rows)), paired_table(compared, OTHERS)),
        claims=tuple(claims),
        notes=(NOTE,),
        figures=figures,
        seconds=sum(trials.seconds for r in runs.values() for trials in r.values()),
    )


def _runs(setting: Setting, protocol: str) -> Runs:
    count, fewer = setting.of("fig8", "trials"), setting.of("fig8", "ours")
    return {
        n: run_agents(setting, protocol, "ispy32", n, PAPERS, count)
        + run_agents(setting, protocol, "ispy32", n, ["bayes"], fewer)
        for n in setting.of("fig8", "attributes")
    }


def is_best(trials: Trials, best: str, measure: str) -> bool:
    """Whether no other of the paper's strategies is clearly better."""
    others = [trials.against(agent, best, measure) for agent in PAPERS if agent != best]
    return all(other.mean <= 2 * other.se for other in others)


def figure(runs: Runs, measure: str) -> canvas.Axes:
    """Draw one measure, a group of bars a number of attributes, with standard errors."""
    groups = {}
    for agent in AGENTS:
        found = [trials.mean(agent, measure) for trials in runs.values()]
        groups[agent] = [Interval(m, se, m - se, m + se) for m, se in found]
    ax = plots.bars(groups, [asked(n) for n in runs], y_label=MEASURES[measure])
    ax.legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize=8, frameon=False)
    return ax


if __name__ == "__main__":
    main(run)
