"""Effects of the published code's departures on MORC, one at a time, in offline runs."""

from meal_bayes.evaluation import difference, estimate_mean
from paper_repro.agents import ASK
from paper_repro.frame import Cell, Result, Setting, Table
from paper_repro.offline import AGAINST, MEASURES, run_agent
from paper_repro.published import SIMULATOR_REWARD, published_roc36, table_path
from paper_repro.statements import RECORDED, THEIRS

TRIALS = 400
ISPY32 = "ispy32"
ROC36 = "roc36, train5"
CODE = "roc36, train5, the simulator's diagram"
CHANGES: dict[str, tuple[str, str, str, float | None]] = {
    # number in errata.toml: problem, what is changed, the changed problem, rewards of its own
    "1": (ISPY32, "percepts drawn from the learned tables", "ispy32, drawn", None),
    "14": (ROC36, "the simulator's diagram", CODE, None),
    "15": (CODE, "rewards of 100", CODE, SIMULATOR_REWARD),
    "16": (ISPY32, "ask costs 150 s", "ispy32, ask 150 s", None),
    "17": (ISPY32, "ask costs 50 s", "ispy32, ask 50 s", None),
    "22": (ISPY32, "look .95, hold and press 1.0", "ispy32_published", None),
}  # two attributes; what nothing shows is not measured: on ROC36's recordings MORC is always right
COLUMNS = ("departure", "problem", "changed", *MEASURES, "reward less before, paired")


def run(setting: Setting) -> Result:
    """Run MORC on the queries of Table 3 and Fig. 8, then with one departure at a time."""
    count = setting.trials_of(TRIALS, 8)
    rows: list[tuple[Cell, ...]] = []
    effects = {}
    places = problems(setting)
    for number, (base, text, other, reward) in CHANGES.items():
        ours = run_agent(setting, *places[base], n=2, agent=AGAINST, trials=count)
        changed = run_agent(
            setting, *places[other], n=2, agent=AGAINST, trials=count, reward=reward
        )
        before = ("–", base, "nothing", *(estimate_mean(ours, m) for m in MEASURES), None)  # noqa: RUF001
        if before not in rows:
            rows.append(before)
        change = difference(changed, ours)
        rows.append((number, base, text, *(estimate_mean(changed, m) for m in MEASURES), change))
        problem = base.replace("roc", "ROC").replace("ispy", "ISPY")
        effects[number] = (
            f"MORC on {problem}, 2 attributes, {text}: "
            f"accuracy {changed.success.mean():.3f} against {ours.success.mean():.3f}, cost "
            f"{changed.cost.mean():.1f} s against {ours.cost.mean():.1f} s"
        )
        if reward is None:  # else rewards are of another size
            effects[number] += f", reward {change.estimate:+.1f} ± {change.se:.1f}"
    return Result(
        title="What departures of the published code do to MORC, one at a time",
        sentence=f"{len(effects)} of the published code's departures are measured one at a time.",
        tables=(Table("MORC", COLUMNS, tuple(rows)),),
        evidence={},
        size=f"{count} trials a row.",
        notes=(
            "The departures are listed in ERRATA.md. Rewards are those of each run's own size.",
            'MORC gives up by "I do not know", for 0 s.',
        ),
        effects=effects,
    )


def problems(setting: Setting) -> dict[str, tuple[str, str]]:
    """Return the column, and the data set or the path of its table, of each problem by its name."""
    asking = {
        f"ispy32, ask {s:g} s": table_path(setting, ISPY32, name=f"ispy32_{s:g}", costs={ASK: s})
        for s in (150.0, 50.0)
    }
    return {
        ISPY32: (RECORDED, ISPY32),
        "ispy32, drawn": (THEIRS, ISPY32),
        **{name: (RECORDED, table) for name, table in asking.items()},
        "ispy32_published": (RECORDED, "ispy32_published"),
        ROC36: (THEIRS, published_roc36(setting, "train5", 2, "roc36")),
        CODE: (THEIRS, published_roc36(setting, "train5", 2)),
    }
