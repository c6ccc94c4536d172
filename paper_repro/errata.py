"""Effects of the published code's departures on MORC, one at a time, where they can be told."""

import numpy as np
from frame import Cell, Estimate, Result, Setting, Table, main, paper_values
from trials import AGAINST, Trials, run_agents

from meal_bayes import Trial
from meal_bayes.evaluation import paired_difference

CHANGES = {  # number in errata.toml: what is changed, the protocol, and settings beside it
    "1": ("percepts drawn from the learned tables", "published", {"domain": "roc36"}),
    "6": ("the paper's classifiers, not ours", "recorded", {"perception": "paper"}),
    "14": ("the published code's diagram", "recorded", {"domain": "roc36_published"}),
}
COLUMNS = ("departure", "changed", "accuracy", "cost, s", "reward", "reward less ours, paired")


def run(setting: Setting) -> Result:
    """Run MORC on ROC36's queries as we do, then with one departure at a time."""
    item = "errata"
    n, count = setting.of(item, "attributes"), setting.of(item, "trials")
    whole = run_agents(setting, "recorded", "roc36", n, [AGAINST], count)
    rows: list[tuple[Cell, ...]] = [("–", "nothing: ours", *_measures(whole), None)]  # noqa: RUF001
    effects, seconds = {}, whole.seconds
    for number, (text, protocol, options) in CHANGES.items():
        if setting.quick and "perception" in options:
            continue  # it takes minutes, once
        changed = run_agents(
            setting, protocol, "roc36", n, [AGAINST], count, **{"perception": "default", **options}
        )
        difference = paired(changed.trials, whole.trials)
        rows.append((number, text, *_measures(changed), difference))
        before, after = (t.mean(AGAINST, "success").mean for t in (whole, changed))
        effects[number] = (
            f"MORC on ROC36, {n} attributes, {text}: accuracy {after:.3f} against "
            f"{before:.3f}, reward {difference.mean:+.1f} ± {difference.se:.1f}"
        )
        seconds += changed.seconds
    effects["13"] = _press()
    return Result(
        item=item,
        title="What departures of the published code do to MORC on ROC36, one at a time",
        paper="–",  # noqa: RUF001
        ours=f"{len(effects)} of the departures measured",
        tables=(Table("MORC", COLUMNS, tuple(rows)),),
        claims=(),
        notes=("The departures are listed in ERRATA.md.",),
        seconds=seconds,
        effects=effects,
    )


def paired(changed: tuple[Trial, ...], ours: tuple[Trial, ...]) -> Estimate:
    """Estimate what a change brings in reward, on the same tasks; objects are clusters."""
    before = {trial.task.key: trial.reward for trial in ours}
    found = paired_difference(
        [trial.reward for trial in changed],
        [before[trial.task.key] for trial in changed],
        [trial.task.object_index for trial in changed],
    )
    return Estimate(found.estimate, found.se)


def _measures(trials: Trials) -> tuple[Estimate, ...]:
    return tuple(trials.mean(AGAINST, measure) for measure in ("success", "cost", "reward"))


def _press() -> str:
    """Update T2's belief by Table 4's late matrix, percept "not soft", as Eq. 8 does."""
    rows = np.array(paper_values("table4")["late"])
    trial = paper_values("t1t2")
    belief = np.array(trial["before"]) * rows[:, 0]
    belief /= belief.sum()
    printed = " ".join(f"{value:.2f}" for value in trial["after"])
    return f"by Table 4 [{belief[0]:.2f} {belief[1]:.2f}], printed [{printed}]"


if __name__ == "__main__":
    main(run)
