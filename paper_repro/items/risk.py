"""Sect. 7.1: what a larger bonus of success, alone or with the penalty, does to exploring."""

from dataclasses import replace

from meal_bayes.agents import Agent
from meal_bayes.evaluation import Estimate, clustered, difference, estimate_mean
from meal_bayes.trials import TrialOutcomes
from paper_repro.agents import weighing
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.inference import LEVEL, drawn_difference, drawn_mean, planned_trials
from paper_repro.offline import AGAINST, MEASURES, Runs, run_agent
from paper_repro.published import plotted_ispy32
from paper_repro.statements import THEIRS, Evidence, above, below

REWARDS = (100.0, 500.0, 2000.0)
LARGE = REWARDS[-1]
BONUS = f"bonus {LARGE:g}"
PLACE = "ispy32"
N = 2
TRIALS = 400  # on recordings
STATEMENTS = 3
MOST = 0.5  # of the trials
# Where percepts are drawn a fraction is to be known to .05, were one pair in four to change.
DRAWN = planned_trials(0.5, 0.05, LEVEL / STATEMENTS)
MEASURED = (*MEASURES, "abstained")
AT_ONCE = "reports before any behavior"
SEEKS = "a very large bonus alone makes it risk seeking: it explores less"
EXAMPLE = "a very large bonus alone makes it report before any behavior in most trials"
NOTE = """A report is worth the bonus where it is right and loses the penalty where it is wrong. The
paper says that larger bonuses and penalties make the robot explore more, and that a very large
bonus alone makes it risk seeking; its example is "reporting before taking any exploration
behaviors". The first is judged by the seconds that it explores, as both grow from 100 to 2000. The
second is judged as the bonus alone grows from 500 to 2000 and the penalty stays at 500: whether it
explores for fewer seconds, and whether it reports before any behavior in most trials. Rewards of
the table are those of the trial, in which a report is worth 500 where the bonus alone has grown.
The same queries at every size. Under `theirs` percepts are drawn from tables of our classifiers."""


def run(setting: Setting) -> Result:
    """Run MORC on the same queries under rewards of several sizes, together and one alone."""
    trials = {
        name: setting.trials_of(DRAWN if name == THEIRS else TRIALS, 6)
        for name in setting.protocols
    }
    usual = paper_values("offline_reward")
    alone = {BONUS: weighing(LARGE, -usual)}
    runs: dict[str, dict[str, TrialOutcomes]] = {}
    for protocol, count in trials.items():
        table = plotted_ispy32(setting) if protocol == THEIRS else PLACE
        agents: dict[str, tuple[str | Agent, float]] = {
            **{f"both {size:g}": (AGAINST, size) for size in REWARDS},
            **{name: (agent, usual) for name, agent in alone.items()},
        }
        runs[protocol] = {
            name: run_agent(setting, protocol, table, n=N, agent=agent, trials=count, reward=size)
            for name, (agent, size) in agents.items()
        }
    rows: list[tuple[Cell, ...]] = []
    for protocol, run in runs.items():
        mean = drawn_mean if protocol == THEIRS else estimate_mean
        for name, outcomes in run.items():
            means = (mean(outcomes, measure) for measure in MEASURED)
            rows.append(
                (protocol, name, *means, reporting_at_once(outcomes, drawn=protocol == THEIRS))
            )
    told = []
    for protocol, run in runs.items():
        low, high = (run[f"both {REWARDS[end]:g}"].cost.mean() for end in (0, -1))
        before, after = (run[name].cost.mean() for name in (f"both {usual:g}", BONUS))
        at_once = reporting_at_once(run[BONUS], drawn=True).estimate * len(run[BONUS])
        told.append(
            f"{protocol}, from {low:.0f} s to {high:.0f} s; as the bonus alone grows from "
            f"{usual:g} to {LARGE:g}, from {before:.0f} s to {after:.0f} s, and it reports before "
            f"any behavior in {at_once:.0f} of {len(run[BONUS])} trials"
        )
    return Result(
        title=f"MORC on {PLACE.upper()}, {N} attributes, under rewards of several sizes",
        sentence=f"From rewards of {REWARDS[0]:g} to {REWARDS[-1]:g} MORC's exploration changes, "
        f"{'; '.join(told)}.",
        size=", ".join(f"{count} trials a row of {name}" for name, count in trials.items()) + ".",
        tables=(Table("rewards", ("percepts", "what is large", *MEASURED, AT_ONCE), tuple(rows)),),
        evidence={name: judge(run, drawn=name == THEIRS) for name, run in runs.items()},
        notes=(NOTE,),
    )


def reporting_at_once(outcomes: TrialOutcomes, *, drawn: bool) -> Estimate:
    """Estimate the fraction of trials in which a report comes before any behavior."""
    at_once = outcomes.answered & (outcomes.executed.sum(axis=1) == 0)
    units = outcomes.key if drawn else outcomes.object_name
    estimate = clustered(at_once, units, fraction=True)
    return replace(estimate, cluster="trials") if drawn else estimate


def judge(runs: Runs, *, drawn: bool) -> dict[str, Evidence | None]:
    """Judge exploring as both rewards grow, and as the bonus alone does."""
    usual = f"both {paper_values('offline_reward'):g}"
    compare = drawn_difference if drawn else difference
    small = min(
        (name for name in runs if name.startswith("both ")), key=lambda name: float(name[5:])
    )
    both = f"both {LARGE:g}"
    explores = f"larger rewards make it explore more: {both} against {small.removeprefix('both ')}"
    return {
        explores: above(compare(runs[both], runs[small], measure="cost"), 0, of="extra cost, s"),
        SEEKS: below(compare(runs[BONUS], runs[usual], measure="cost"), 0, of="extra cost, s"),
        EXAMPLE: above(reporting_at_once(runs[BONUS], drawn=drawn), MOST, of="fraction of trials"),
    }
