"""Sect. 7: what the size of the reward does: a robot that is risk averse, or risk seeking."""

from collections.abc import Mapping

from meal_bayes.evaluation import difference
from meal_bayes.trial_log import TrialOutcomes
from paper_repro.frame import Cell, Result, Setting, Table, until_decided
from paper_repro.offline import AGAINST, MEASURES, Runs, estimate, run_agent
from paper_repro.statements import Evidence, above, joined

REWARDS = (100.0, 300.0, 500.0, 1000.0, 2000.0)
PLACE, N = "ispy32", 2
STEPS = (200, 400, 800)  # trials
NOTE = """A report is worth the reward where it is right and loses as much where it is wrong. The
smaller it is, the sooner the robot reports or gives up (risk seeking); the larger, the longer it
explores (risk averse). The same queries at every size."""


def run(setting: Setting) -> Result:
    """Run MORC on the same queries under rewards of several sizes."""
    rewards = setting.choose(REWARDS, (100.0, 500.0))
    names = {f"{size:g}": size for size in rewards}
    runs: dict[str, Runs] = {}
    evidence: dict[str, Mapping[str, Evidence]] = {}
    for protocol in setting.protocols:

        def run_one(name: str, trials: int, where: str = protocol) -> TrialOutcomes:
            size = names[name]
            return run_agent(setting, where, PLACE, N, AGAINST, trials, reward=size)

        runs[protocol], evidence[protocol] = until_decided(
            names, setting.trial_steps(STEPS, 6), run_one, judge
        )
    rows: list[tuple[Cell, ...]] = [
        (size, *(estimate(run[f"{size:g}"], m) for m in MEASURES for run in runs.values()))
        for size in rewards
    ]
    columns = ("reward", *(f"{m}: {protocol}" for m in MEASURES for protocol in runs))
    words = {
        protocol: " to ".join(f"{run[name].cost.mean():.0f} s" for name in (min(names, key=float),
                              max(names, key=float)))
        for protocol, run in runs.items()
    }  # fmt: skip
    return Result(
        title=f"MORC on {PLACE.upper()}, {N} attributes, under rewards of several sizes",
        paper="the larger the reward, the more it explores",
        published=words["published"],
        ours=words.get("recorded", ""),
        tables=(Table("rewards", columns, tuple(rows)),),
        statements=joined(evidence.get("recorded"), evidence["published"]),
        notes=(NOTE,),
    )


def judge(runs: Runs) -> dict[str, Evidence]:
    """Judge that a larger reward makes the robot explore more, and err less."""
    small, large = (choose(runs, key=float) for choose in (min, max))
    number = min(len(runs[small]), len(runs[large]))
    return {
        f"with a reward of {large} it explores more than with {small}": above(
            difference(runs[large], runs[small], measure="cost"), 0, number, (small, large),
            of="extra cost, s",
        ),
        f"with a reward of {large} it is right more often than with {small}": above(
            difference(runs[large], runs[small], measure="success"), 0, number, (small, large),
            of="extra accuracy",
        ),
    }  # fmt: skip
