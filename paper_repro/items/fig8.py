"""Fig. 8: five strategies on ISPY32 with one, two and three attributes."""

from collections.abc import Mapping
from itertools import product

from meal_bayes.evaluation import Interval, canvas, plots
from paper_repro.frame import Cell, Result, Setting, Table, asked, paper_values, until_decided
from paper_repro.statements import Evidence, above, below, best, change_of_means, every, joined
from paper_repro.trials import (
    AGAINST,
    Columns,
    Runs,
    against,
    paired_table,
    run_agent,
    seconds_of,
)

BASELINES = ("random", "random_legal", "predefined", "predefined_plus")
AGENTS = (*BASELINES, AGAINST)
MEASURES = {"reward": "reward", "cost": "cost, s", "success": "accuracy"}
STEPS = (200, 400, 800)  # trials; the paper's are 200
NOTE = """No numbers are printed. Best is ahead of every other strategy of the paper by more than
the interval of the paired difference excludes. In the published protocol Random Legal may ask a
person at the start, as in the published code; in the recorded one it explores, as the paper's text
says (ERRATA.md, 21). Claims about cost compare three attributes with one, object by object."""
SHOWS = """The paper draws reward, cost and success of the five strategies over the number of
attributes: MORC above the others in reward and success, its cost rising with the number of
attributes, Random's falling, the other baselines' level. The bars are in the same order."""


def run(setting: Setting) -> Result:
    """Run all strategies on the same queries."""
    numbers = setting.choose((1, 2, 3), (1, 2))
    runs: dict[str, dict[int, Runs]] = {}
    evidence: dict[str, dict[str, Evidence]] = {}
    for protocol in setting.protocols:
        runs[protocol], evidence[protocol] = {}, {}
        for n in numbers:

            def run_one(agent: str, trials: int, n: int = n, where: str = protocol) -> Columns:
                return run_agent(setting, where, "ispy32", n, agent, trials)

            runs[protocol][n], found = until_decided(
                AGENTS, setting.trial_steps(STEPS, 6), run_one,
                lambda some, n=n: judge_best(some, n),  # type: ignore[misc]
            )  # fmt: skip
            evidence[protocol] |= found
        evidence[protocol] |= judge_costs(runs[protocol])
    columns = ("attributes", "agent", *(f"{m}: {p}" for m in MEASURES.values() for p in runs))
    rows: list[tuple[Cell, ...]] = [
        (n, agent, *(run[n][agent].mean(m) for m in MEASURES for run in runs.values()))
        for n, agent in product(numbers, AGENTS)
    ]
    compared = {f"{p}, {asked(n)}": run[n] for n in numbers for p, run in runs.items()}
    return Result(
        title="Strategies on ISPY32",
        paper="MORC best in reward and success",
        published=_words(runs["published"]),
        ours=_words(runs["recorded"]) if "recorded" in runs else "",
        tables=(
            Table("strategies", columns, tuple(rows)),
            paired_table(compared, [agent for agent in AGENTS if agent != AGAINST]),
        ),
        statements=joined(evidence.get("recorded"), evidence["published"]),
        notes=(NOTE,),
        figures={f"_{m}_{p}": figure(run, m) for p, run in runs.items() for m in MEASURES},
        shows=SHOWS,
        seconds=seconds_of(compared),
        effects=_effects(runs) if "recorded" in runs else {},
    )


def judge_best(runs: Runs, n: int) -> dict[str, Evidence]:
    """Judge that MORC is ahead of the paper's other strategies at a number of attributes."""
    evidence = {}
    for measure, word in (("reward", "reward"), ("success", "accuracy")):
        ahead = {name: against(runs[AGAINST], runs[name], measure) for name in BASELINES}
        number = min(len(runs[name]) for name in (AGAINST, *BASELINES))
        text = f"MORC is best in {word} at {asked(n)}"
        evidence[text] = best(ahead, number, (AGAINST,), of=word)
    return evidence


def judge_costs(runs: Mapping[int, Runs]) -> dict[str, Evidence]:
    """Judge how costs change from the fewest to the most attributes."""
    few, many = min(runs), max(runs)
    margin = paper_values("fig8")["margin"]["cost"]

    def change(agent: str) -> tuple[Interval, int]:
        after, before = runs[many][agent], runs[few][agent]
        return change_of_means(after.cost, after.objects, before.cost, before.objects), len(after)

    rest = [
        below(*_ordered(change(name), margin), of=f"rise of {name}'s cost, s")
        for name in BASELINES[1:]
    ]
    return {
        "Random's cost falls with the number of attributes": below(
            *_ordered(change("random"), 0.0), of="rise of its cost, s"
        ),
        "MORC's cost rises with the number of attributes": above(
            *_ordered(change(AGAINST), 0.0), of="rise of its cost, s"
        ),
        f"the other baselines' cost rises by less than {margin:g} s": every(rest),
    }


def _ordered(change: tuple[Interval, int], bound: float) -> tuple[Interval, float, int]:
    return change[0], bound, change[1]


def figure(runs: Mapping[int, Runs], measure: str) -> canvas.Axes:
    """Draw one measure, a group of bars a number of attributes, with standard errors."""
    groups = {}
    for agent in AGENTS:
        found = [run[agent].mean(measure) for run in runs.values()]
        groups[agent] = [Interval(m, se, m - se, m + se) for m, se in found]
    ax = plots.bars(groups, [asked(n) for n in runs], y_label=MEASURES[measure])
    ax.legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize=8, frameon=False)
    return ax


def _words(runs: Mapping[int, Runs]) -> str:
    """Return MORC's reward, and its lead over the best baseline with its sign, by attributes."""
    told = []
    for run in runs.values():
        leads = [against(run[AGAINST], run[name]).estimate for name in BASELINES]
        told.append(f"{run[AGAINST].reward.mean():.0f} ({min(leads):+.0f})")
    return "MORC's reward (lead): " + ", ".join(told)


def _effects(runs: Mapping[str, Mapping[int, Runs]]) -> dict[str, str]:
    rewards = [run[min(run)]["random_legal"].mean("reward") for run in runs.values()]
    theirs, ours = (f"{one.mean:.1f} ± {one.se:.1f}" for one in rewards)
    return {"21": f"Random Legal's reward on ISPY32, 1 attribute: {theirs}; exploring only, on "
                  f"recordings, {ours}"}  # fmt: skip
