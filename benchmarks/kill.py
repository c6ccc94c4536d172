"""Kill runs at random and run them again: the same tables must come out, and nothing be left.

Each round starts the same command twice at once on one new folder of logs, each with two processes,
kills both at random moments (one by SIGKILL, one by SIGTERM), waits that all their children are
gone, and starts both again until they end. The tables that they print and all logs must equal
those of one run that nobody disturbed, byte for byte. `--kills 5 --at-once 1` kills one run five
times in a row.

    python benchmarks/kill.py --rounds 50
    python benchmarks/kill.py --rounds 10 --kind online --root FOLDER --kills 5 --at-once 1
"""

import argparse
import contextlib
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

PATIENCE = 5.0  # s until nothing of a killed command may run
LONGEST = 900.0  # s of one undisturbed command
MARK = "MEAL_BAYES_KILL_ROUND"  # in the environment of all that a round starts

Outcome = tuple[str, dict[str, str]]  # the table of a run, and the digests of its logs by name


def main() -> None:
    """Run the rounds and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--kills", type=int, default=1, help="of a command, in a row")
    parser.add_argument("--at-once", type=int, default=2, help="commands on one folder")
    parser.add_argument("--kind", choices=["offline", "online"], default="offline")
    parser.add_argument("--trials", type=int, help="of each agent, or of a batch of it")
    parser.add_argument("--root", help="recordings of an online run")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    words = [*command(options), "--jobs", "2"]
    with tempfile.TemporaryDirectory() as name:  # which compiles the kernels
        finish(start(words, Path(name), "first"))
    with tempfile.TemporaryDirectory() as name:
        begin = time.monotonic()
        printed = finish(start(words, Path(name), "undisturbed"))
        seconds, expected = time.monotonic() - begin, outcome(Path(name), printed)
    counts, moments = Counter[str](), random.Random(options.seed)
    for number in range(options.rounds):
        with tempfile.TemporaryDirectory() as name:
            folder, mark = Path(name), str(number)
            # so that most kills find something to kill
            longest = 3.0 * seconds / (options.kills + 1)
            for _ in range(options.kills):
                group = [start(words, folder, mark) for _ in range(options.at_once)]
                counts["killed"] += kill(group, sorted(moments.uniform(0, longest) for _ in group))
                counts["processes_left"] += remaining(mark)
            group = [start(words, folder, mark) for _ in range(options.at_once)]
            outcomes = [outcome(folder, finish(process)) for process in group]
            counts["processes_left"] += remaining(mark)
            counts["different"] += any(found != expected for found in outcomes)
            counts["different"] += any(folder.rglob("*.active"))  # a draft that nobody needs
        print(f"round {number + 1} of {options.rounds}: {dict(counts)}", file=sys.stderr)
    found = {
        "rounds": options.rounds,
        **{name: counts[name] for name in ("killed", "different", "processes_left")},
        "undisturbed_s": round(seconds, 1),
    }
    if options.json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name:>20}: {value}")


def command(options: argparse.Namespace) -> list[str]:
    """Return the command line, but its folder of logs and its workers."""
    words = [sys.executable, "-m", "meal_bayes", "run", options.kind, "--json"]
    if options.kind == "offline":
        trials = options.trials or 300
        return [*words, "--trials", str(trials), "--agent", "random,predefined_plus"]
    words += ["--dataset", "cy101", "--agent", "bayes,morc_itrs", "--repeats", "2"]
    words += ["--batches", "3", "--trials", str(options.trials or 4)]
    return [*words, "--root", options.root] if options.root else words


def kill(group: list["subprocess.Popen[str]"], ends: list[float]) -> int:
    """Kill commands so many seconds from now; return how many were still running."""
    begin, killed = time.monotonic(), 0
    for process, end, kind in zip(
        group, ends, cycle((signal.SIGKILL, signal.SIGTERM)), strict=False
    ):
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(max(0.0, begin + end - time.monotonic()))
        killed += process.poll() is None
        process.send_signal(kind)
        process.wait()
    return killed


def start(words: list[str], folder: Path, mark: str) -> "subprocess.Popen[str]":
    """Start a command on a folder of logs."""
    return subprocess.Popen(
        [*words, "--logs", str(folder)], text=True, env={**os.environ, MARK: mark},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def finish(process: "subprocess.Popen[str]") -> str:
    """Wait for a command and return its output."""
    printed, errors = process.communicate(timeout=LONGEST)
    if process.returncode:
        sys.exit(f"a run ended with {process.returncode}: {errors[-2000:]}")
    return printed


def outcome(folder: Path, printed: str) -> Outcome:
    """Return the table of a run, and the digests of its logs by name."""
    facts = json.loads(printed)
    facts.pop("log", None)  # the folder
    for row in facts["rows"]:  # seconds of the clock are no result
        for name in [name for name in row if "seconds" in name]:
            del row[name]
    rows = json.dumps(facts, sort_keys=True)
    logs = {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.name.endswith(".mcap")
    }
    return rows, logs


def remaining(mark: str) -> int:
    """Count the processes of a round that still run when they have had their time."""
    end = time.monotonic() + PATIENCE
    while (count := sum(1 for _ in marked(mark))) and time.monotonic() < end:
        time.sleep(0.1)
    return count


def marked(mark: str) -> Iterator[int]:
    """Find the processes that a round has started, and their children."""
    wanted = f"{MARK}={mark}".encode()
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            with contextlib.suppress(OSError):
                if wanted in (folder / "environ").read_bytes().split(b"\0"):
                    yield int(folder.name)


if __name__ == "__main__":
    main()
