"""What a million logged trials cost: compact logs written, their facts, a report.

    python benchmarks/trials.py [--trials 1000000] [--json]

Outcomes are synthetic but valid: five agents of an online run, tests after each batch of each
repeat, a log a batch. Another log holds all of them in one file. Every part runs in a process of
its own, so that its memory is its own.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from meal_bayes.domain import load_domain
from meal_bayes.evaluation.report import write_report
from meal_bayes.seeds import stream
from meal_bayes.trial_log import Logs, log_info, write_trials
from meal_bayes.trials import TrialOutcomes, task_key

AGENTS = (
    "iterative_random_legal",
    "iterative_morc",
    "morc_itrs",
    "bayes",
    "bayes_memory",
    "random",
)
BATCHES, OBJECTS, ASKED = 10, 34, 2
SIZE = 1000  # trials of a batch
BARS = {  # name: (CPU seconds, megabytes of memory) at 1,000,000 trials
    "log info": (2.0, 2000.0),
    "report": (180.0, 2000.0),
}
LARGEST = 400.0  # bytes of a trial on disk


def synthetic(agent: str, repeat: int, batch: int, trials: int) -> TrialOutcomes:
    """Draw outcomes of tests: beliefs that are calibrated, reports that follow them."""
    domain = load_domain("cy101")
    rng = stream(0, "synthetic outcomes", agent, repeat, batch)
    behaviors = domain.behavior_names
    o = rng.integers(OBJECTS, size=trials)
    names = np.array(domain.attributes, object)
    positive = rng.beta(0.5, 0.5, (trials, ASKED))
    truth, report = rng.random(positive.shape) < positive, positive > 0.5
    executed = rng.poisson(0.7, (trials, len(behaviors)))
    cost = executed @ np.array([behavior.cost for behavior in domain.behaviors])
    right = (truth == report).all(axis=1)
    return TrialOutcomes(
        behaviors=behaviors,
        agent=np.full(trials, agent, object),
        key=[task_key(("test", repeat, row)) for row in range(trials)],
        object_index=o,
        object_name=[f"object {one}" for one in o],
        attribute=names[np.argsort(rng.random((trials, len(names))), axis=1)[:, :ASKED]],
        truth=truth,
        report=report,
        positive=positive,
        cost=cost,
        reward=np.where(right, 300.0, -300.0) - cost,
        ended=np.full(trials, "", object),
        steps=executed.sum(axis=1) + 1,
        executed=executed,
        failed=rng.binomial(executed, 0.1),
    )


def make_logs(folder: Path, trials: int) -> dict[str, float]:
    """Write logs of so many trials, and one that holds them all; return what that took."""
    units = [
        (agent, repeat, batch)
        for repeat in range(-(-trials // (SIZE * len(AGENTS) * BATCHES)))
        for batch in range(BATCHES)
        for agent in AGENTS
    ][: trials // SIZE]
    start = time.process_time()
    for agent, repeat, batch in units:
        path = folder / "run" / agent / f"repeat-{repeat:03d}" / f"{batch:02d}-test.mcap"
        header = {
            "config": {"dataset": "cy101", "log": "compact"}, "agent": agent, "repeat": repeat,
            "batch": batch, "part": "test",
        }  # fmt: skip
        write_trials(path, [synthetic(agent, repeat, batch, SIZE)], header=header)
    write_trials(folder / "all.mcap", (synthetic(*unit, SIZE) for unit in units), header={})
    files = list((folder / "run").rglob("*.mcap"))
    return {
        "trials": SIZE * len(units),
        "files": len(files),
        "cpu_s": time.process_time() - start,
        "bytes_a_trial_in_batches": sum(f.stat().st_size for f in files) / SIZE / len(units),
        "bytes_a_trial_in_one_file": (folder / "all.mcap").stat().st_size / SIZE / len(units),
    }


def part(name: str, folder: Path) -> None:
    """Run one part and print what it took."""
    start, wall = time.process_time(), time.perf_counter()
    if name == "log info":
        held = log_info(folder / "all.mcap").trials
    else:
        held = write_report(Logs(folder / "run"), folder / "report.html").trials
    facts = {
        "part": name,
        "trials": held,
        "cpu_s": time.process_time() - start,
        "wall_s": time.perf_counter() - wall,
        "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000,
    }
    print(json.dumps(facts))


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=1_000_000)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--part", choices=BARS, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        part(options.part, options.folder)
        return
    if options.trials < SIZE:
        sys.exit(f"--trials: give at least {SIZE}")
    with tempfile.TemporaryDirectory() as folder:
        made = make_logs(Path(folder), options.trials)
        parts = []
        for name in BARS:
            words = [sys.executable, __file__, "--part", name, "--folder", folder]
            done = subprocess.run(words, check=True, capture_output=True, text=True)
            parts.append(json.loads(done.stdout))
    if options.json:
        print(json.dumps({"logs": made, "parts": parts}))
        return
    for name, value in made.items():
        print(f"{name:28s} {value:12,.1f}")
    print(f"{'bar, bytes':28s} {LARGEST:12,.1f}")
    for facts in parts:
        cpu, memory = BARS[facts["part"]]
        print(
            f"{facts['part']:10s} {facts['cpu_s']:8.2f} s CPU (bar {cpu:g}), "
            f"{facts['megabytes']:8.0f} MB (bar {memory:g}), {facts['trials']:,} trials"
        )


if __name__ == "__main__":
    main()
