"""Kill runs at random and run them again: the same tables must come out, and nothing be left.

Each round starts the same command twice at once on one new folder of logs, each with two processes,
kills both at random moments (one by SIGKILL, one by SIGTERM), waits that all their children are
gone, and starts both again until they end. The tables that they print and all logs must equal
those of one run that nobody disturbed, byte for byte. `--kills 5 --at-once 1` kills one run five
times in a row.

    python benchmarks/kill.py --rounds 50
    python benchmarks/kill.py --rounds 10 --kind online --root FOLDER --kills 5 --at-once 1
"""

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
from itertools import cycle
from pathlib import Path

from measuring import options_of, show

PATIENCE = 5.0  # s until nothing of a killed command may run
LONGEST = 900.0  # s of one undisturbed command
MARK = "MEAL_BAYES_KILL_ROUND"  # in the environment of all that a round starts
WORDS = {  # options of the runs that are killed
    "offline": "--trials 300 --agent random,predefined_plus",
    "online": "--dataset cy101 --agent bayes,morc_itrs --repeats 2 --batches 3 --trials 4",
}

Process = subprocess.Popen[str]
Outcome = tuple[str, dict[str, str]]  # the table of a run, and the digests of its logs by name


def main() -> None:
    """Run the rounds and print what was found."""
    parser = options_of(__doc__)
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--kills", type=int, default=1, help="of a command, in a row")
    parser.add_argument("--at-once", type=int, default=2, help="commands on one folder")
    parser.add_argument("--kind", choices=WORDS, default="offline")
    parser.add_argument("--root", help="recordings of an online run")
    options = parser.parse_args()
    words = [options.kind, *WORDS[options.kind].split()]
    words += ["--root", options.root] if options.root else []
    for number in (-1, 0):  # the first compiles the kernels
        with tempfile.TemporaryDirectory() as name:
            begin = time.monotonic()
            expected = outcome(Path(name), start(words, name, number))
            seconds = time.monotonic() - begin
    counts = Counter[str]()
    moments = random.Random(0)
    longest = 3.0 * seconds / (options.kills + 1)  # so that most kills find something to kill
    for number in range(1, options.rounds + 1):
        with tempfile.TemporaryDirectory() as name:
            for _ in range(options.kills):
                group = [start(words, name, number) for _ in range(options.at_once)]
                counts["killed"] += kill(group, sorted(moments.uniform(0, longest) for _ in group))
                counts["processes_left"] += remaining(number)
            group = [start(words, name, number) for _ in range(options.at_once)]
            outcomes = [outcome(Path(name), process) for process in group]
            counts["processes_left"] += remaining(number)
            counts["different"] += any(each != expected for each in outcomes)
            counts["different"] += any(Path(name).rglob("*.active"))  # a draft that nobody needs
        print(f"round {number} of {options.rounds}: {dict(counts)}", file=sys.stderr)
    facts = {name: counts[name] for name in ("killed", "different", "processes_left")}
    row = {"rounds": options.rounds, **facts, "undisturbed_s": round(seconds, 1)}
    show([row], row if options.json else None)


def start(words: list[str], folder: str, number: int) -> Process:
    """Start a run on a folder of logs, with a round's number in its environment."""
    return subprocess.Popen(
        [
            sys.executable,
            "-m",
            "meal_bayes",
            "run",
            *words,
            "--json",
            "--jobs",
            "2",
            "--logs",
            folder,
        ],
        env={**os.environ, MARK: str(number)},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def kill(group: list[Process], ends: list[float]) -> int:
    """Kill commands so many seconds from now; return how many were still running."""
    begin = time.monotonic()
    killed = 0
    kinds = cycle((signal.SIGKILL, signal.SIGTERM))
    for process, end, kind in zip(group, ends, kinds, strict=False):
        with process:  # its pipes are closed when it has ended
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, begin + end - time.monotonic()))
            killed += process.poll() is None
            process.send_signal(kind)
    return killed


def outcome(folder: Path, process: Process) -> Outcome:
    """Wait for a run; return its table without the clock's seconds, and digests of its logs."""
    printed, errors = process.communicate(timeout=LONGEST)
    if process.returncode:
        sys.exit(f"a run ended with {process.returncode}: {errors[-2000:]}")
    facts = json.loads(printed)
    facts.pop("log", None)  # the folder
    facts["rows"] = [
        {name: value for name, value in row.items() if "seconds" not in name}
        for row in facts["rows"]
    ]
    logs = {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*.mcap"))
    }
    return json.dumps(facts, sort_keys=True), logs


def remaining(number: int) -> int:
    """Count the processes of a round that still run when they have had their time."""
    end = time.monotonic() + PATIENCE
    mark = f"{MARK}={number}".encode()
    count = running(mark)
    while count and time.monotonic() < end:
        time.sleep(0.1)
        count = running(mark)
    return count


def running(mark: bytes) -> int:
    """Count the processes, and their children, that have a mark in their environment."""
    count = 0
    for path in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            count += mark in path.read_bytes().split(b"\0")
    return count


if __name__ == "__main__":
    main()
