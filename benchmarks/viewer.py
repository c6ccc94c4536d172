"""What it costs to look at 10,000 trials: the log's facts, a recording for rerun, a report.

Real trials of one agent are computed once and written over and over, until the log is as large as
asked for. Every part runs in a process of its own, so that its memory is its own.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from itertools import cycle, islice
from pathlib import Path

from meal_bayes.datasets import load_percepts
from meal_bayes.evaluation.report import write_report
from meal_bayes.experiments.tasks import offline_tasks
from meal_bayes.learner import Learner
from meal_bayes.trial_log import Logs, log_info, read_header, read_trials, write_trials
from meal_bayes.viewer import write_recording

DISTINCT = 200  # trials that are really computed
BARS = {  # name: (CPU seconds, megabytes) at 10,000 trials
    "log info": (1.0, 1000.0),
    "recording": (60.0, 1000.0),
    "report": (30.0, float("inf")),
}


def make_log(path: Path, trials: int, agent: str) -> dict[str, float]:
    """Write a log of so many trials; give its size and the speed of writing."""
    table = load_percepts("roc36")
    learner = Learner("roc36", agent=agent, logs=None).fit(table)
    tasks = offline_tasks(table, 2, min(DISTINCT, trials), 0)
    made = [learner.ask(task) for task in tasks]
    start = time.process_time()
    write_trials(path, islice(cycle(made), trials), header={"config": {"dataset": "roc36"}})
    seconds = time.process_time() - start
    steps = sum(len(trial.steps) for trial in islice(cycle(made), trials))
    size = path.stat().st_size
    return {
        "trials": trials, "steps": steps, "megabytes": size / 1e6,
        "steps_written_per_s": steps / seconds, "bytes_per_step": size / steps,
    }  # fmt: skip


def part(name: str, log: Path, folder: Path) -> None:
    """Run one part and print what it took."""
    start, wall = time.process_time(), time.perf_counter()
    size = 0
    if name == "log info":
        log_info(log)
    elif name == "recording":
        write_recording(read_trials(log), folder / "run.rrd", read_header(log))
        size = (folder / "run.rrd").stat().st_size
    else:
        size = write_report(Logs(log), folder / "report.html").size
    told = {
        "cpu_s": time.process_time() - start,
        "wall_s": time.perf_counter() - wall,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "written_mb": size / 1e6,
    }
    print(json.dumps(told))


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=10_000)
    parser.add_argument("--agent", default="bayes")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--part", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        name, log, folder = options.part
        part(name, Path(log), Path(folder))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = folder / "run.mcap"
        found: dict[str, dict[str, float]] = {"log": make_log(log, options.trials, options.agent)}
        for one in BARS:
            command = [sys.executable, __file__, "--part", one, str(log), str(folder)]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            found[one] = json.loads(done.stdout)
    if options.json:
        print(json.dumps(found))
        return
    print(", ".join(f"{name} {value:,.0f}" for name, value in found.pop("log").items()))
    for one, told in found.items():
        limits = " and ".join(f"{bar:g}" for bar in BARS[one])
        print(
            f"{one:<10} {told['cpu_s']:6.2f} s CPU, {told['peak_mb']:5.0f} MB, "
            f"{told['written_mb']:6.1f} MB written (bars: {limits})"
        )


if __name__ == "__main__":
    main()
