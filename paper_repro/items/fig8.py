"""Fig. 8: five strategies on ISPY32 with one, two and three attributes."""

from collections.abc import Callable, Mapping, Sequence
from itertools import product

from meal_bayes.evaluation import Interval, canvas, difference, plots
from meal_bayes.trial_log import TrialOutcomes
from paper_repro.frame import Cell, Result, Setting, Table, asked, paper_values, until_decided
from paper_repro.offline import AGAINST, Runs, estimate, paired_table, run_agent
from paper_repro.statements import Evidence, above, below, best, change_of_means, every, joined

BASELINES = ("random", "random_legal", "predefined", "predefined_plus")
AGENTS = (*BASELINES, AGAINST)
MEASURES = {"reward": "reward", "cost": "cost, s", "success": "accuracy"}
STEPS = (200, 400, 800, 1600)  # trials; the paper's are 200
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
    played = {named(agent, n): (agent, n) for n in numbers for agent in AGENTS}
    runs: dict[str, dict[int, Runs]] = {}
    evidence: dict[str, dict[str, Evidence]] = {}
    for protocol in setting.protocols:

        def run_one(name: str, trials: int, where: str = protocol) -> TrialOutcomes:
            agent, n = played[name]
            return run_agent(setting, where, "ispy32", n, agent, trials)

        found, evidence[protocol] = until_decided(
            played, setting.trial_steps(STEPS, 6), run_one,
            lambda some: judge(by_number(some, numbers)),
        )  # fmt: skip
        runs[protocol] = by_number(found, numbers)
    shown = ("trials", *MEASURES.values())
    columns = ("attributes", "agent", *(f"{m}: {p}" for m in shown for p in runs))
    rows: list[tuple[Cell, ...]] = []
    for n, agent in product(numbers, AGENTS):
        own = [run[n][agent] for run in runs.values()]
        rows.append(
            (n, agent, *map(len, own), *(estimate(one, m) for m in MEASURES for one in own))
        )
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
        effects=_effects(runs) if "recorded" in runs else {},
    )


def named(agent: str, n: int) -> str:
    """Name a strategy at a number of attributes."""
    return f"{agent} at {asked(n)}"


def by_number(found: Runs, numbers: Sequence[int]) -> dict[int, Runs]:
    """Sort trials by the number of attributes, and then by strategy."""
    return {n: {agent: found[named(agent, n)] for agent in AGENTS} for n in numbers}


def judge(runs: Mapping[int, Runs]) -> dict[str, Evidence]:
    """Judge what the paper says of every number of attributes, and of the costs over them."""
    best_of_all = [judge_best(own, n) for n, own in runs.items()]
    return {text: one for some in (*best_of_all, judge_costs(runs)) for text, one in some.items()}


def judge_best(runs: Runs, n: int) -> dict[str, Evidence]:
    """Judge that MORC is ahead of the paper's other strategies at a number of attributes."""
    evidence = {}
    for measure, word in (("reward", "reward"), ("success", "accuracy")):
        ahead = {
            named(name, n): difference(runs[AGAINST], runs[name], measure=measure)
            for name in BASELINES
        }
        number = min(len(runs[name]) for name in (AGAINST, *BASELINES))
        text = f"MORC is best in {word} at {asked(n)}"
        evidence[text] = best(ahead, number, (named(AGAINST, n),), of=word)
    return evidence


def judge_costs(runs: Mapping[int, Runs]) -> dict[str, Evidence]:
    """Judge how costs change from the fewest to the most attributes."""
    few, many = min(runs), max(runs)
    margin = paper_values("fig8")["margin"]["cost"]

    def rise(judged: Callable[..., Evidence], agent: str, bound: float = 0.0) -> Evidence:
        after, before = runs[many][agent], runs[few][agent]
        change = change_of_means(after.cost, after.object_index, before.cost, before.object_index)
        number, both = min(len(after), len(before)), (named(agent, few), named(agent, many))
        return judged(change, bound, number, both, of=f"rise of {agent}'s cost, s")

    return {
        "Random's cost falls with the number of attributes": rise(below, "random"),
        "MORC's cost rises with the number of attributes": rise(above, AGAINST),
        f"the other baselines' cost rises by less than {margin:g} s": every(
            rise(below, name, margin) for name in BASELINES[1:]
        ),
    }


def figure(runs: Mapping[int, Runs], measure: str) -> canvas.Axes:
    """Draw one measure, a group of bars a number of attributes, with standard errors."""
    groups = {}
    for agent in AGENTS:
        found = [estimate(run[agent], measure) for run in runs.values()]
        groups[agent] = [Interval(m, se, m - se, m + se) for m, se in found]
    return plots.bars(groups, [asked(n) for n in runs], y_label=MEASURES[measure])


def _words(runs: Mapping[int, Runs]) -> str:
    """Return MORC's reward, and its lead over the best baseline with its sign, by attributes."""
    told = []
    for run in runs.values():
        leads = [difference(run[AGAINST], run[name]).estimate for name in BASELINES]
        told.append(f"{run[AGAINST].reward.mean():.0f} ({min(leads):+.0f})")
    return "MORC's reward (lead): " + ", ".join(told)


def _effects(runs: Mapping[str, Mapping[int, Runs]]) -> dict[str, str]:
    rewards = [estimate(run[min(run)]["random_legal"], "reward") for run in runs.values()]
    theirs, ours = (f"{one.mean:.1f} ± {one.se:.1f}" for one in rewards)
    return {"21": f"Random Legal's reward on ISPY32, 1 attribute: {theirs}; exploring only, on "
                  f"recordings, {ours}"}  # fmt: skip
