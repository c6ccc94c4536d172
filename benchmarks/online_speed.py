"""CPU seconds of `run online` beside those of another checkout, and whether results are equal.

The runs of both alternate, each in a process of its own, after a small run that loads what is
compiled. Results are the outcomes of all test trials, value by value.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from statistics import median

from measuring import options_of, show

ROOT = Path(__file__).resolve().parents[1]
AGENTS = ("iterative_morc", "morc_itrs", "bayes", "bayes_memory")
COMPARED = ("report", "positive", "cost", "reward", "steps", "executed", "failed")


def run_once(agent: str, dataset: str, *sizes: int) -> dict[str, object]:
    """Run one repeat of an agent; return its CPU seconds, and a digest of its test outcomes."""
    from meal_bayes import OnlineConfig, run_online  # noqa: PLC0415  of either checkout
    from meal_bayes.trial_log import read_outcomes  # noqa: PLC0415

    warnings.simplefilter("ignore")
    attributes, batches, trials = sizes
    settings = {"dataset": dataset, "attributes": attributes, "agents": (agent,), "seed": 3}
    digest = hashlib.sha256()
    with tempfile.TemporaryDirectory() as folder:
        run_online(OnlineConfig(**settings, batches=1, trials=1), logs=Path(folder, "first"))
        before = time.process_time()
        run = run_online(
            OnlineConfig(**settings, batches=batches, trials=trials), logs=Path(folder, "run")
        )
        seconds = time.process_time() - before
        for path in sorted(run.folder.rglob("*-test.mcap")):
            outcomes = read_outcomes(path)
            for name in COMPARED:
                digest.update(getattr(outcomes, name).tobytes())
    return {"seconds": seconds, "digest": digest.hexdigest()[:16]}


def of_checkout(folder: Path, words: list[str]) -> dict[str, object]:
    """Run once in a process that imports the package of a checkout."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--one", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def main() -> None:
    """Compare both checkouts, agent by agent."""
    if sys.argv[1:2] == ["--one"]:
        agent, dataset, *sizes = sys.argv[2:]
        print(json.dumps(run_once(agent, dataset, *map(int, sizes))))
        return
    parser = options_of(__doc__ or "")
    parser.add_argument("--before", type=Path, help="folder of the other checkout")
    parser.add_argument("--dataset", default="cy101")
    parser.add_argument("--attributes", type=int, default=1, help="asked at a time")
    parser.add_argument("--batches", type=int, default=3)
    parser.add_argument("--trials", type=int, default=40, help="of training, a batch")
    parser.add_argument("--agents", default=",".join(AGENTS), help="by comma")
    parser.add_argument("--repetitions", type=int, default=3, help="of each checkout")
    options = parser.parse_args()
    checkouts = {"now": ROOT} | ({"before": options.before} if options.before else {})
    rows = []
    for agent in options.agents.split(","):
        sizes = (options.attributes, options.batches, options.trials)
        words = [agent, options.dataset, *map(str, sizes)]
        runs: dict[str, list[dict[str, object]]] = {name: [] for name in checkouts}
        for _ in range(options.repetitions):
            for name, folder in checkouts.items():
                runs[name].append(of_checkout(folder, words))
        seconds = {name: median(float(str(run["seconds"])) for run in runs[name]) for name in runs}
        row: dict[str, object] = {"agent": agent, **seconds}
        if "before" in runs:
            row["ratio"] = seconds["before"] / seconds["now"]
            row["equal results"] = (
                len({run["digest"] for each in runs.values() for run in each}) == 1
            )
        rows.append(row)
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
