"""Effects of the published code's departures on MORC, one at a time, in offline runs."""

from typing import Any

from meal_bayes.evaluation import difference, mean_effect
from paper_repro.agents import ASK
from paper_repro.frame import Cell, Result, Setting, Table
from paper_repro.offline import AGAINST, MEASURES, run_agent
from paper_repro.published import table_path
from paper_repro.statements import RECORDED, THEIRS

TRIALS = 400
CHANGES: dict[str, tuple[str, int, str, str, dict[str, Any]]] = {
    # number in errata.toml: data set, attributes, what is changed, protocol and settings beside it
    "1": ("roc36", 3, "percepts drawn from the learned tables", THEIRS, {}),
    "6": ("roc36", 3, "the paper's classifiers, not ours", RECORDED, {"perception": "paper"}),
    "14": ("roc36_published", 3, "the published code's diagram", RECORDED, {}),
    "15": ("roc36", 3, "rewards of 100", RECORDED, {"reward": 100.0}),
    "16": ("ispy32", 2, "ask costs 150 s", RECORDED, {"ask": 150.0}),
    "17": ("ispy32", 2, "ask costs 50 s", RECORDED, {"ask": 50.0}),
    "22": ("ispy32_published", 2, "look .95, hold and press 1.0", RECORDED, {}),
}
COLUMNS = ("departure", "data set", "changed", *MEASURES, "reward less ours, paired")


def run(setting: Setting) -> Result:
    """Run MORC on the queries of Table 3 and Fig. 8, then with one departure at a time."""
    count = setting.trials_of(TRIALS, 8)
    rows: list[tuple[Cell, ...]] = []
    effects = {}
    for number, (domain, n, text, protocol, options) in CHANGES.items():
        if setting.quick and "perception" in options:
            continue  # it takes minutes, once
        dataset, place, given = domain.removesuffix("_published"), domain, dict(options)
        ours = run_agent(setting, RECORDED, dataset, n, AGAINST, count)
        if ask := given.pop("ask", None):
            place = table_path(setting, dataset, name=f"{dataset}_{ask:g}", costs={ASK: ask})
        changed = run_agent(setting, protocol, place, n, AGAINST, count, **given)
        before = ("–", dataset, "nothing: ours", *(mean_effect(ours, m) for m in MEASURES), None)  # noqa: RUF001
        if before not in rows:
            rows.append(before)
        found = difference(changed, ours)
        rows.append((number, dataset, text, *(mean_effect(changed, m) for m in MEASURES), found))
        effects[number] = (
            f"MORC on {dataset.upper()}, {n} attributes, {text}: accuracy "
            f"{changed.success.mean():.3f} against {ours.success.mean():.3f}, cost "
            f"{changed.cost.mean():.1f} s against {ours.cost.mean():.1f} s"
            + ("" if "reward" in options else f", reward {found.estimate:+.1f} ± {found.se:.1f}")
        )
    return Result(
        title="What departures of the published code do to MORC, one at a time",
        sentence=f"{len(effects)} of the published code's departures are measured one at a time.",
        tables=(Table("MORC", COLUMNS, tuple(rows)),),
        evidence={},
        size=f"{count} trials a row.",
        notes=(
            "The departures are listed in ERRATA.md. Rewards are those of each run's own size.",
        ),
        effects=effects,
    )
