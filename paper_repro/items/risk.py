"""Sect. 7: what the size of the reward does to how long a robot explores."""

from meal_bayes.evaluation import difference, mean_effect
from meal_bayes.trials import TrialOutcomes
from paper_repro.frame import Cell, Result, Setting, Table
from paper_repro.offline import AGAINST, MEASURES, Runs, run_agent
from paper_repro.published import plotted_ispy32
from paper_repro.statements import THEIRS, Evidence, above

REWARDS = (100.0, 300.0, 500.0, 1000.0, 2000.0)
PLACE, N = "ispy32", 2
TRIALS = 400
NOTE = """A report is worth the reward where it is right and loses as much where it is wrong. The
paper says that a very large success bonus makes the robot risk seeking, and a very large penalty
risk averse; here both grow together, so that neither is judged. That the robot explores longer is
ours to state. The same queries at every size. Under `theirs` percepts are drawn from tables of our
classifiers."""


def run(setting: Setting) -> Result:
    """Run MORC on the same queries under rewards of several sizes."""
    rewards, trials = setting.choose(REWARDS, (100.0, 500.0)), setting.trials_of(TRIALS, 6)
    runs: dict[str, dict[str, TrialOutcomes]] = {}
    for protocol in setting.protocols[:2]:
        table = plotted_ispy32(setting, N) if protocol == THEIRS else PLACE
        runs[protocol] = {
            f"{size:g}": run_agent(setting, protocol, table, N, AGAINST, trials, reward=size)
            for size in rewards
        }
    rows: list[tuple[Cell, ...]] = [
        (protocol, size, *(mean_effect(run[f"{size:g}"], m) for m in (*MEASURES, "abstained")))
        for protocol, run in runs.items() for size in rewards
    ]  # fmt: skip
    told = []
    for name, run in runs.items():
        low, high = (run[f"{rewards[end]:g}"].cost.mean() for end in (0, -1))
        told.append(f"{name}, from {low:.0f} s to {high:.0f} s")
    return Result(
        title=f"MORC on {PLACE.upper()}, {N} attributes, under rewards of several sizes",
        sentence=f"From a reward of {rewards[0]:g} to one of {rewards[-1]:g} MORC's exploration "
        f"changes, {'; '.join(told)}.",
        size=f"{trials} trials a row.",
        tables=(Table("rewards", ("percepts", "a report is worth", *MEASURES, "abstained"),
                      tuple(rows)),),
        evidence={protocol: judge(run) for protocol, run in runs.items()},
        notes=(NOTE,),
    )  # fmt: skip


def judge(runs: Runs) -> dict[str, Evidence | None]:
    """Judge that a larger reward makes the robot explore more."""
    small, large = (choose(runs, key=float) for choose in (min, max))
    extra = difference(runs[large], runs[small], measure="cost")
    return {f"with a reward of {large} it explores more than with {small}":
            above(extra, 0, of="extra cost, s")}  # fmt: skip
