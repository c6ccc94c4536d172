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
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

PATIENCE = 5.0  # s until nothing of a killed command may run
LONGEST = 900.0  # s of one undisturbed command
MARK = "MEAL_BAYES_KILL_ROUND"  # in the environment of all that a round starts

Outcome = tuple[str, dict[str, str]]  # the table of a run, and the digests of its logs by name
Found = tuple[int, int, list[Outcome]]  # of a round: kills, processes left after them, outcomes


@dataclass(frozen=True, slots=True)
class Plan:
    """What is run, and how it is disturbed.

    Attributes
    ----------
    words : the command without its folder of logs.
    expected : what a run printed and wrote that nobody disturbed.
    seconds : that it took.
    moments : random numbers.
    kills : times in a row that a command is killed.
    at_once : commands on one folder.
    """

    words: list[str]
    expected: Outcome
    seconds: float
    moments: random.Random
    kills: int = 1
    at_once: int = 2


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
    words = command(options)
    expected, seconds = undisturbed([*words, "--jobs", "2"])
    plan = Plan(
        words, expected, seconds, random.Random(options.seed), options.kills, options.at_once
    )
    found = measure(plan, options.rounds)
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


def undisturbed(words: list[str]) -> tuple[Outcome, float]:
    """Run a command that nobody disturbs; return its outcome and its seconds, kernels compiled."""
    with tempfile.TemporaryDirectory() as name:
        finish(start(words, Path(name), "first"))
    with tempfile.TemporaryDirectory() as name:
        begin = time.monotonic()
        found = finish(start(words, Path(name), "undisturbed"))
        return outcome(Path(name), found), time.monotonic() - begin


def measure(plan: Plan, rounds: int) -> dict[str, object]:
    """Compare rounds with the undisturbed run."""
    different, left, killed = 0, 0, 0
    for number in range(rounds):
        with tempfile.TemporaryDirectory() as name:
            mark, folder = str(number), Path(name)
            hit, orphans, outcomes = round_here(plan, folder, mark)
            killed += hit
            left += orphans + remaining(mark)
            different += any(found != plan.expected for found in outcomes)
            different += any(folder.rglob("*.active"))  # a draft that nobody needs
        print(f"round {number + 1} of {rounds}: {killed} killed, {different} different, "
              f"{left} left", file=sys.stderr)  # fmt: skip
    return {
        "rounds": rounds,
        "killed": killed,
        "different": different,
        "processes_left": left,
        "undisturbed_s": round(plan.seconds, 1),
    }


def round_here(plan: Plan, folder: Path, mark: str) -> Found:
    """Kill the commands as often as planned, then run them to their end."""
    words, signals = [*plan.words, "--jobs", "2"], cycle((signal.SIGKILL, signal.SIGTERM))
    longest = 3.0 * plan.seconds / (plan.kills + 1)  # so that most kills find something to kill
    killed, left = 0, 0
    for _ in range(plan.kills):
        group = [start(words, folder, mark) for _ in range(plan.at_once)]
        ends = sorted(plan.moments.uniform(0.0, longest) for _ in group)
        begin = time.monotonic()
        for one, end, kind in zip(group, ends, signals, strict=False):
            with contextlib.suppress(subprocess.TimeoutExpired):
                one.wait(max(0.0, begin + end - time.monotonic()))
            killed += one.poll() is None
            one.send_signal(kind)
            one.wait()
        left += remaining(mark)
    group = [start(words, folder, mark) for _ in range(plan.at_once)]
    return killed, left, [outcome(folder, finish(one)) for one in group]


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
