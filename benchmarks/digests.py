"""Digests of what small offline and online runs decided, to compare before and after a change.

    python benchmarks/digests.py before.json          # then change the code
    python benchmarks/digests.py after.json before.json

Three data sets, all agents offline, four online. A digest covers each trial's task, steps,
percepts, values (eight digits), beliefs (ten digits), costs, rewards and report; no clocks,
versions or file formats.
"""

import argparse
import hashlib
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from meal_bayes.trial_log import read_trials
from meal_bayes.trials import Trial

DATASETS = ("roc36", "ispy32", "cy101")
_AGENTS = "iterative_random_legal,morc_itrs,bayes,bayes_memory"
SMALL = {  # options of a run that takes seconds
    "offline": "--trials 6 --attributes 2 --seed 3",
    "online": (
        f"--batches 2 --trials 5 --repeats 1 --attributes 2 --seed 3 --log full --agent {_AGENTS}"
    ),
}


def content(trial: Trial) -> str:
    """Write a trial down in text."""
    parts = [repr(trial.task), trial.agent, repr(trial.truth.tolist())]
    parts.append("none" if trial.report is None else repr(trial.report.tolist()))
    for step in trial.steps:
        percept = None if step.observation is None else step.observation.tolist()
        numbers = (
            round(step.cost, 9),
            round(step.reward, 9),
            step.belief.positive.round(10).tolist(),
            step.decision.values.round(8).tolist(),
        )
        parts.append(repr((step.x, step.decision.action, step.next_x, percept, *numbers)))
    return "|".join(parts)


def digests(dataset: str, kind: str) -> dict[str, str]:
    """Run one kind on one data set; return a digest of each log, by its place in the run."""
    with TemporaryDirectory() as logs:
        command = [sys.executable, "-m", "meal_bayes", "run", kind, "--dataset", dataset]
        subprocess.run(
            [*command, *SMALL[kind].split(), "--logs", logs], check=True, capture_output=True
        )
        return {
            "/".join((dataset, kind, *path.relative_to(logs).parts[1:])): hashlib.sha256(
                "\n".join(map(content, read_trials(path))).encode()
            ).hexdigest()[:16]
            for path in sorted(Path(logs).rglob("*.mcap"))
        }


def main() -> int:
    """Write the digests, and compare."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path, help="JSON to write")
    parser.add_argument("before", type=Path, nargs="?", help="to compare with")
    options = parser.parse_args()
    now = {
        log: digest
        for dataset in DATASETS
        for kind in SMALL
        for log, digest in digests(dataset, kind).items()
    }
    options.out.write_text(json.dumps(now, indent=1))
    before = json.loads(options.before.read_text()) if options.before else now
    changed = sorted(log for log in {**before, **now} if before.get(log) != now.get(log))
    print(*changed, f"{len(changed)} of {len(now)} logs differ", sep="\n")
    return bool(changed)


if __name__ == "__main__":
    sys.exit(main())
