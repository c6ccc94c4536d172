"""Sect. 7.1: what the bonus of success and the penalty of failure do to exploring and giving up."""

from meal_bayes.agents import Agent
from meal_bayes.evaluation import difference, estimate_mean
from meal_bayes.trials import TrialOutcomes
from paper_repro.agents import weighing
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.inference import LEVEL, drawn_difference, drawn_mean, planned_trials
from paper_repro.offline import AGAINST, MEASURES, Runs, run_agent
from paper_repro.published import plotted_ispy32
from paper_repro.statements import THEIRS, Evidence, above, below

REWARDS = (100.0, 500.0, 2000.0)
LARGE = REWARDS[-1]
PLACE = "ispy32"
N = 2
TRIALS = 400  # on recordings
STATEMENTS = 3
# Where percepts are drawn giving up is to be known to .05, were one pair in four to change.
DRAWN = planned_trials(0.5, 0.05, LEVEL / STATEMENTS)
MEASURED = (*MEASURES, "abstained")
NOTE = """A report is worth the bonus where it is right and loses the penalty where it is wrong. The
paper says that larger bonuses and penalties make the robot explore more, that a very large bonus
alone makes it risk seeking, and a very large penalty alone risk averse. The first is judged by the
seconds that it explores, as both grow from 100 to 2000. The other two are judged by giving up, as
one of the two grows from 500 to 2000 and the other stays at 500: MORC gives up by "I do not know"
for 0 s: who seeks risk reports where others would give up, who avoids it gives up where others
would report. Rewards of the table are those of the trial, in which a report is worth 500 where one
alone has grown. The same queries at every size. Under `theirs` percepts are drawn from tables of
our classifiers."""


def run(setting: Setting) -> Result:
    """Run MORC on the same queries under rewards of several sizes, together and one alone."""
    trials = {
        name: setting.trials_of(DRAWN if name == THEIRS else TRIALS, 6)
        for name in setting.protocols[:2]
    }
    usual = paper_values("offline_reward")
    alone = {
        f"bonus {LARGE:g}": weighing(LARGE, -usual),
        f"penalty {LARGE:g}": weighing(usual, -LARGE),
    }
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
            rows.append((protocol, name, *(mean(outcomes, m) for m in MEASURED)))
    told = []
    for protocol, run in runs.items():
        low, high = (run[f"both {REWARDS[end]:g}"].cost.mean() for end in (0, -1))
        quits = [f"{(~run[name].answered).mean():.0%}" for name in (f"both {usual:g}", *alone)]
        told.append(
            f"{protocol}, from {low:.0f} s to {high:.0f} s, and it gives up {quits[0]} of "
            f"its trials, with the large bonus alone {quits[1]}, with the large penalty "
            f"alone {quits[2]}"
        )
    return Result(
        title=f"MORC on {PLACE.upper()}, {N} attributes, under rewards of several sizes",
        sentence=f"From rewards of {REWARDS[0]:g} to {REWARDS[-1]:g} MORC's exploration changes, "
        f"{'; '.join(told)}.",
        size=", ".join(f"{count} trials a row of {name}" for name, count in trials.items()) + ".",
        tables=(Table("rewards", ("percepts", "what is large", *MEASURED), tuple(rows)),),
        evidence={name: judge(run, drawn=name == THEIRS) for name, run in runs.items()},
        notes=(NOTE,),
    )


def judge(runs: Runs, *, drawn: bool) -> dict[str, Evidence | None]:
    """Judge exploring as both rewards grow, and giving up as one of them does."""
    usual = f"both {paper_values('offline_reward'):g}"
    compare = drawn_difference if drawn else difference
    small = min(
        (name for name in runs if name.startswith("both ")), key=lambda name: float(name[5:])
    )
    both = f"both {LARGE:g}"
    bonus = f"bonus {LARGE:g}"
    penalty = f"penalty {LARGE:g}"
    extra = compare(runs[both], runs[small], measure="cost")
    fewer = compare(runs[bonus], runs[usual], measure="abstained")
    more = compare(runs[penalty], runs[usual], measure="abstained")
    explores = f"larger rewards make it explore more: {both} against {small.removeprefix('both ')}"
    seeks = "a very large bonus alone makes it risk seeking: it gives up less"
    averse = "a very large penalty alone makes it risk averse: it gives up more"
    return {
        explores: above(extra, 0, of="extra cost, s"),
        seeks: below(fewer, 0, of="rise of giving up"),
        averse: above(more, 0, of="rise of giving up"),
    }
