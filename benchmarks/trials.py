"""What it costs to write and to look at many trials: the log's facts, a recording, a report.

    python benchmarks/trials.py [--trials 10000] [--agent bayes] [--json]
    python benchmarks/trials.py --compact [--trials 1000000] [--json]

Real trials of one agent are computed once and written over and over, until the log is as large as
asked for. Compact logs hold synthetic but valid outcomes: six agents of an online run, tests after
each batch of each repeat, a log a batch; another log holds all of them in one file. Every part runs
in a process of its own, so that its memory is its own.
"""

import tempfile
import time
from itertools import cycle, islice
from pathlib import Path

import numpy as np
from measuring import alone, options_of, peak_mb, show

from meal_bayes.datasets import load_percepts
from meal_bayes.domain import load_domain
from meal_bayes.evaluation.report import write_report
from meal_bayes.experiments import offline_tasks
from meal_bayes.learner import Learner
from meal_bayes.seeds import stream
from meal_bayes.trial_log import Logs, log_info, read_header, read_trials, write_trials
from meal_bayes.trials import TrialOutcomes, task_key
from meal_bayes.viewer import write_recording

DISTINCT = 200  # whole trials that are really computed
AGENTS = (
    "iterative_random_legal",
    "iterative_morc",
    "morc_itrs",
    "bayes",
    "bayes_memory",
    "random",
)
BATCHES = 10
OBJECTS = 34
ASKED = 2
SIZE = 1000  # trials of a batch
BARS = {  # of each form, by part: CPU seconds, megabytes, at so many trials
    "full": {"log info": (1.0, 1000.0), "recording": (60.0, 1000.0), "report": (30.0, np.inf)},
    "compact": {"log info": (2.0, 2000.0), "report": (180.0, 2000.0)},
}
TRIALS = {"full": 10_000, "compact": 1_000_000}


def synthetic(agent: str, repeat: int, batch: int, trials: int) -> TrialOutcomes:
    """Draw outcomes of tests: beliefs that are calibrated, reports that follow them."""
    domain = load_domain("cy101")
    rng = stream(0, "synthetic outcomes", agent, repeat, batch)
    behaviors = domain.behavior_names
    o = rng.integers(OBJECTS, size=trials)
    names = np.array(domain.attributes, object)
    positive = rng.beta(0.5, 0.5, (trials, ASKED))
    truth = rng.random(positive.shape) < positive
    report = positive > 0.5
    executed = rng.poisson(0.7, (trials, len(behaviors)))
    cost = executed @ np.array([behavior.cost for behavior in domain.behaviors])
    right = (truth == report).all(axis=1)
    return TrialOutcomes(
        behaviors=behaviors,
        agent=np.full(trials, agent, object),
        key=[task_key(("test", repeat, row)) for row in range(trials)],
        object_index=o,
        object_name=[f"object {number}" for number in o],
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


def write_full(folder: Path, trials: int, agent: str) -> int:
    """Write one log of so many whole trials; return their steps."""
    table = load_percepts("roc36")
    learner = Learner("roc36", agent=agent, logs=None).fit(table)
    made = [learner.ask(task) for task in offline_tasks(table, 2, min(DISTINCT, trials), 0)]
    header = {"config": {"dataset": "roc36"}}
    write_trials(folder / "all.mcap", islice(cycle(made), trials), header=header)
    return sum(len(trial.steps) for trial in islice(cycle(made), trials))


def write_compact(folder: Path, trials: int) -> int:
    """Write compact logs of so many trials, and one that holds them all; return how many files."""
    units = [
        (agent, repeat, batch)
        for repeat in range(-(-trials // (SIZE * len(AGENTS) * BATCHES)))
        for batch in range(BATCHES)
        for agent in AGENTS
    ][: trials // SIZE]
    for agent, repeat, batch in units:
        path = folder / "run" / agent / f"repeat-{repeat:03d}" / f"{batch:02d}-test.mcap"
        header = {
            "config": {"dataset": "cy101", "log": "compact"},
            "agent": agent,
            "repeat": repeat,
            "batch": batch,
            "part": "test",
        }
        write_trials(path, [synthetic(agent, repeat, batch, SIZE)], header=header)
    write_trials(folder / "all.mcap", (synthetic(*unit, SIZE) for unit in units), header={})
    return len(units)


def part(name: str, folder: Path) -> dict[str, float]:
    """Run one part and return what it took."""
    start = time.process_time()
    wall = time.perf_counter()
    log = folder / "all.mcap"
    written = 0
    if name == "log info":
        log_info(log)
    elif name == "recording":
        write_recording(read_trials(log), folder / "run.rrd", read_header(log))
        written = (folder / "run.rrd").stat().st_size
    else:
        run = folder / "run" if (folder / "run").is_dir() else log
        write_report(Logs(run), folder / "report.html")
        written = (folder / "report.html").stat().st_size
    return {
        "cpu_s": time.process_time() - start,
        "wall_s": time.perf_counter() - wall,
        "peak_mb": peak_mb(),
        "written_mb": written / 1e6,
    }


def main() -> None:
    """Read the command line."""
    parser = options_of(__doc__)
    parser.add_argument("--compact", action="store_true", help="outcomes alone, a million")
    parser.add_argument("--trials", type=int)
    parser.add_argument("--agent", default="bayes", help="of whole trials")
    options = parser.parse_args()
    form = "compact" if options.compact else "full"
    trials = max(options.trials or TRIALS[form], SIZE if options.compact else 1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        start = time.process_time()
        if options.compact:
            counted = {"files": write_compact(folder, trials)}
        else:
            counted = {"steps": write_full(folder, trials, options.agent)}
        size = (folder / "all.mcap").stat().st_size
        log = {
            "trials": trials,
            **counted,
            "cpu_s": time.process_time() - start,
            "bytes_a_trial": size / trials,
        }
        parts = {name: alone(part, name, folder) for name in BARS[form]}
    rows = [
        {"part": name, **facts, "bar_s": BARS[form][name][0], "bar_mb": BARS[form][name][1]}
        for name, facts in parts.items()
    ]
    show([{"part": "log", **log}, *rows], {"log": log, **parts} if options.json else None)


if __name__ == "__main__":
    main()
