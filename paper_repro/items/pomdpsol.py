"""SARSOP with 5 s a query, the paper's solver, on Table 3's and Fig. 9's problems."""

import hashlib
import os
import shutil
from itertools import product
from pathlib import Path

from meal_bayes.errors import DownloadError
from meal_bayes.evaluation import mean_effect
from meal_bayes.trials import TrialOutcomes
from paper_repro.frame import Cell, Result, Setting, Table, asked, paper_values
from paper_repro.items.fig9 import RELEVANT, judge
from paper_repro.offline import run_agent
from paper_repro.published import SIMULATOR_REWARD, plotted_ispy32, published_roc36
from paper_repro.statements import THEIRS, Evidence, within

AGENT = "sarsop"
TRIALS = {"table3": 20, "fig9": 20}  # each first trial of a query solves for 5 s
IRRELEVANT = (0, 1, 2, 3, 4, 5)
NOTE = """What SARSOP reaches in 5 s depends on the machine. The program is not part of this
project: build `pomdpsol` (AdaCompNUS/sarsop) and put it on the PATH, or name it in
MEAL_BAYES_POMDPSOL; without it these results stay as they are. Here: {version}. Table 3's problems
are those of the published simulator. On Fig. 9's problems each attribute of an answer is right with
.65; their percepts are drawn from tables of our classifiers, as the matrices that ISPY32's
simulator loads were not published."""


def run(setting: Setting) -> Result:
    """Run where `pomdpsol` is found; raises `DownloadError` elsewhere."""
    version = program_version()
    rows: list[tuple[Cell, ...]] = []
    evidence: dict[str, Evidence | None] = {}
    paper, told = paper_values("table3"), list[str]()
    for matrices, n in product(("train5", "train12"), (2, 3)):
        run = run_agent(
            setting, THEIRS, published_roc36(setting, matrices), n, AGENT,
            setting.trials_of(TRIALS["table3"], 2), reward=SIMULATOR_REWARD,
        )  # fmt: skip
        rows.append((f"Table 3, {matrices}", n, *_measured(run)))
        printed = paper[str(n)]["morc"]
        if matrices == "train5":
            told.append(f"{run.success.mean():.3f} at {run.cost.mean():.1f} s ({asked(n)}; printed "
                        f"{printed['accuracy']:.3f} at {printed['cost']:.1f} s)")  # fmt: skip
        for key, name in (("accuracy", "success"), ("cost", "cost")):
            value = printed[key]
            reach = paper["margin"][key] * (value if key == "cost" else 1.0)
            evidence[f"MORC ({matrices}), {asked(n)}: {key} {value:g}"] = within(
                mean_effect(run, name), value - reach, value + reach, of=key
            )
    points = {
        str(k): run_agent(setting, THEIRS, plotted_ispy32(setting, RELEVANT + k), RELEVANT + k,
                          AGENT, setting.trials_of(TRIALS["fig9"], 2))
        for k in setting.choose(IRRELEVANT, (0, 2))
    }  # fmt: skip
    rows += [("Fig. 9", RELEVANT + int(k), *_measured(run)) for k, run in points.items()]
    evidence |= judge(points)
    last = points[str(IRRELEVANT[-1])] if not setting.quick else points["2"]
    return Result(
        title="The paper's solver, SARSOP with 5 s a query",
        sentence=f"""With SARSOP and 5 s a query MORC has {'; '.join(told)} under Table 3's
        simulator (train5), and Fig. 9's reward goes from
        {points["0"].reward.mean():.0f} to {last.reward.mean():.0f}, and
        {(~last.answered).mean():.0%} of its last trials are given up.""",
        tables=(Table("trials", ("problem", "attributes", "accuracy", "cost, s", "reward",
                                 "abstained"), tuple(rows)),),
        evidence={THEIRS: evidence},
        size=f"{setting.trials_of(TRIALS['fig9'], 2)} trials a row.",
        notes=(NOTE.format(version=version),),
    )  # fmt: skip


def program_version() -> str:
    """Return the name and digest of `pomdpsol`."""
    program = shutil.which(os.environ.get("MEAL_BAYES_POMDPSOL") or "pomdpsol")
    if program is None:
        raise DownloadError("no pomdpsol on the PATH or in MEAL_BAYES_POMDPSOL")
    digest = hashlib.sha256(Path(program).read_bytes()).hexdigest()
    return f"pomdpsol of APPL 0.9 (AdaCompNUS/sarsop), SHA-256 {digest[:12]}"


def _measured(run: TrialOutcomes) -> tuple[Cell, ...]:
    names = ("success", "cost", "reward", "abstained")
    return tuple(mean_effect(run, name) for name in names)
