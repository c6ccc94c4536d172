"""Table 4 and T1, T2: how a robot perceives SOFT by pressing, and what it does, early and late."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes import read_trials
from meal_bayes.evaluation import Interval
from paper_repro.frame import Cell, Result, Setting, Table, paper_values, until_decided
from paper_repro.items.t1t2 import PRESS
from paper_repro.online import BEST, STEPS, mean_of, run_curves
from paper_repro.statements import Evidence, above, joined, mean_interval, within

GRASP, ATTRIBUTE = "grasp", "soft"
DELTA = {"recorded": 5 * 33, "published": 5 * 40}  # recordings of training's objects (Eq. 10)
FIRST, EARLY, LATE = 1, 2, 10  # batches: before any training; where T1 lies; the last
NOTE = """Rows are those of the MOMDPs of training trials that ask for SOFT, means over repeats:
early in the second batch, where the paper's T1 lies, late in the last. IE counts the labelled
instances of training over 5 recordings of each training object (Eq. 10). Not every batch of every
repeat asks for SOFT; pairs are of repeats with both."""

Traits = Mapping[str, NDArray[np.float64]]  # (S,) by trait


def run(setting: Setting) -> Result:
    """Read tables, experience and choices off the training trials of Fig. 10's runs."""
    paper, steps = paper_values("table4"), setting.repeat_steps(STEPS)
    found: dict[str, Traits] = {}
    evidence: dict[str, Mapping[str, Evidence | None]] = {}
    for protocol in setting.protocols:
        if not steps:
            evidence[protocol] = dict.fromkeys(texts())
            continue

        def run_one(agent: str, repeats: int, where: str = protocol) -> Traits:
            training = run_curves(setting, "cy101", 1, agent, repeats, where).training
            return traits_of(training, DELTA[where])

        runs, evidence[protocol] = until_decided(
            (BEST,), steps, run_one, lambda runs: judge(runs[BEST])
        )
        found[protocol] = runs[BEST]
    rows: list[tuple[Cell, ...]] = []
    for when in ("early", "late"):
        for truth, name in enumerate((f"not {ATTRIBUTE}", ATTRIBUTE)):
            cells = [_mean(one[f"{when} {truth}"]) for one in found.values()]
            rows.append((f"{when}, {name}", paper[when][truth][1], *cells))
    words = {
        protocol: ", ".join(
            f"{_known(youden(one, w))[0].estimate:.2f} {w}" for w in ("early", "late")
        )
        for protocol, one in found.items()
    }
    columns = ("truth", "Pr(percept soft): paper", *found)
    return Result(
        title="Observation model of (press, SOFT) on CY101, early and late",
        paper="TPR - FPR .18 early, .63 late",
        published=words.get("published", ""),
        ours=words.get("recorded", ""),
        tables=(Table("press, SOFT", columns, tuple(rows)),) if found else (),
        statements=joined(evidence.get("recorded"), evidence["published"]),
        notes=(NOTE,),
    )


def texts() -> tuple[str, ...]:
    """Return the statements about Table 4 and the two trials."""
    paper = paper_values("table4")
    return (
        "pressing is more informative of SOFT late than early",
        *(
            f"{when}: TPR - FPR of press is {_youden(paper[when]):.2f}"
            for when in ("early", "late")
        ),
        f"late: TPR - FPR of grasp is {_youden(paper_values('t1t2')['grasp']):.2f}",
        f"late: IE of (SOFT, grasp) is {paper_values('t1t2')['experience']:.2f}",
        "it grasps early and presses late: more SOFT trials press late than early",
    )


def judge(traits: Traits) -> dict[str, Evidence]:
    """Judge the statements from the traits (S,) of repeats; nan where SOFT was not asked."""
    paper, trials = paper_values("table4"), paper_values("t1t2")
    margin = paper["margin"]
    change = youden(traits, "late") - youden(traits, "early")
    interval, number = _known(change)
    outcomes = [above(interval, 0, number, (BEST,), of="rise of TPR - FPR")]
    for values, printed, of in (
        (youden(traits, "early"), _youden(paper["early"]), "TPR - FPR"),
        (youden(traits, "late"), _youden(paper["late"]), "TPR - FPR"),
        (traits["grasp"], _youden(trials["grasp"]), "TPR - FPR"),
        (traits["experience"], trials["experience"], "IE"),
    ):
        interval, number = _known(values)
        outcomes.append(
            within(interval, printed - margin, printed + margin, number, (BEST,), of=of)
        )
    interval, number = _known(traits["late presses"] - traits["early presses"])
    outcomes.append(above(interval, 0, number, (BEST,), of="rise of the fraction that presses"))
    return dict(zip(texts(), outcomes, strict=True))


def youden(traits: Traits, when: str) -> NDArray[np.float64]:
    """Return TPR - FPR of (press, SOFT), (S,)."""
    return traits[f"{when} 1"] - traits[f"{when} 0"]


def traits_of(training: tuple[tuple[Path, ...], ...], delta: int) -> Traits:
    """Read the traits of each repeat off its training trials."""
    rows = []
    for logs in training:
        none = dict.fromkeys(("0", "1", "presses", "grasp", "count"), np.nan)
        first, early, late = (
            none | _read(logs[min(batch, len(logs)) - 1]) for batch in (FIRST, EARLY, LATE)
        )
        rows.append({
            **{f"early {k}": early[k] for k in ("0", "1", "presses")},
            **{f"late {k}": late[k] for k in ("0", "1", "presses")},
            "grasp": late["grasp"],
            "experience": (late["count"] - first["count"]) / delta,
        })  # fmt: skip
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _read(log: Path) -> dict[str, float]:
    """Read the first MOMDP that asks for SOFT, and how many such trials press."""
    found: dict[str, float] = {}
    presses = []
    for trial in read_trials(log):
        momdp = trial.momdp
        if ATTRIBUTE not in momdp.query.attributes:
            continue
        p = momdp.query.attributes.index(ATTRIBUTE)
        press, grasp = (momdp.behavior_names.index(name) for name in (PRESS, GRASP))
        presses.append(any(step.decision.action == press for step in trial.steps))
        if not found and trial.counts is not None:
            rows = momdp.rows[p]
            found = {
                "0": float(rows[press, 0, 1]),
                "1": float(rows[press, 1, 1]),
                "grasp": float(rows[grasp, 1, 1] - rows[grasp, 0, 1]),
                "count": float(trial.counts[p, grasp].sum()),
            }
    return found | ({"presses": float(np.mean(presses))} if presses else {})


def _known(values: NDArray[np.float64]) -> tuple[Interval, int]:
    """Estimate the mean over the repeats that have one; nothing is known where none has."""
    known = values[~np.isnan(values)]
    if not len(known):
        return Interval(np.nan, np.nan, np.nan, np.nan), 0
    return mean_interval(known, range(len(known))), len(known)


def _mean(values: NDArray[np.float64]) -> Cell:
    known = values[~np.isnan(values)]
    return mean_of(known) if len(known) else None


def _youden(rows: list[list[float]]) -> float:
    return rows[1][1] - rows[0][1]
