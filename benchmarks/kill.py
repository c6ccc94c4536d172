"""Kill runs at random and run them again: the same tables must come out, and nothing be left.

Each round starts the same command twice at once on one new folder of logs, each with two processes,
kills both at random moments (one by SIGKILL, one by SIGTERM), waits that all their children are
gone, and starts both again until they end. The tables that they print and all logs must equal
those of one run that nobody disturbed, byte for byte.

    python benchmarks/kill.py --rounds 50
    python benchmarks/kill.py --rounds 5 --kind online --root FOLDER_OF_RECORDINGS --json
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
from collections.abc import Iterator, Sequence
from pathlib import Path

PATIENCE = 5.0  # s until nothing of a killed command may run
LONGEST = 600.0  # s of one undisturbed command
MARK = "MEAL_BAYES_KILL_ROUND"  # in the environment of all that a round starts


def main() -> None:
    """Run the rounds and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--trials", type=int, default=300, help="of each agent")
    parser.add_argument("--kind", choices=["offline", "online"], default="offline")
    parser.add_argument("--root", help="recordings of an online run")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = measure(command(options), options.rounds, random.Random(options.seed))
    if options.json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name:>20}: {value}")


def command(options: argparse.Namespace) -> list[str]:
    """Make the command line, but its folder of logs."""
    words = [sys.executable, "-m", "meal_bayes", "run", options.kind, "--jobs", "2", "--json"]
    if options.kind == "offline":
        return [*words, "--trials", str(options.trials), "--agent", "random,predefined_plus"]
    words += ["--trials", "6", "--batches", "2", "--repeats", "2", "--agent"]
    words += ["iterative_random_legal"]
    return [*words, "--root", options.root] if options.root else words


def measure(words: Sequence[str], rounds: int, moments: random.Random) -> dict[str, object]:
    """Compare rounds with one undisturbed run."""
    with tempfile.TemporaryDirectory() as name:
        begin = time.perf_counter()
        expected = outcome(Path(name), run_to_end(words, Path(name)))
        whole = time.perf_counter() - begin
    different, left, killed = 0, 0, 0
    for number in range(rounds):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            killed += disturb(words, folder, whole, moments, str(number))
            left += remaining(str(number))
            pair = [start(words, folder, str(number)) for _ in range(2)]
            outcomes = [outcome(folder, finish(one)) for one in pair]
            different += any(found != expected for found in outcomes)
            different += any(folder.rglob("*.active"))  # a draft that nobody needs
        print(f"round {number + 1} of {rounds}: {killed} killed, {different} different, "
              f"{left} left", file=sys.stderr)  # fmt: skip
    return {
        "rounds": rounds,
        "killed": killed,
        "different": different,
        "processes_left": left,
        "undisturbed_s": round(whole, 1),
    }


def disturb(
    words: Sequence[str], folder: Path, whole: float, moments: random.Random, mark: str
) -> int:
    """Start two commands and kill them at random moments; returns how many still ran."""
    pair = [start(words, folder, mark) for _ in range(2)]
    ends = sorted(moments.uniform(0.0, 1.5 * whole) for _ in pair)
    begin, killed = time.monotonic(), 0
    for one, end, kind in zip(pair, ends, (signal.SIGKILL, signal.SIGTERM), strict=True):
        with contextlib.suppress(subprocess.TimeoutExpired):
            one.wait(max(0.0, begin + end - time.monotonic()))
        killed += one.poll() is None
        one.send_signal(kind)
        one.communicate()
    return killed


def start(words: Sequence[str], folder: Path, mark: str) -> "subprocess.Popen[str]":
    """Start a command on a folder of logs."""
    return subprocess.Popen(
        [*words, "--logs", str(folder)], text=True, env={**os.environ, MARK: mark},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def finish(process: "subprocess.Popen[str]") -> str:
    """Wait for a command and return its output."""
    said, told = process.communicate(timeout=LONGEST)
    if process.returncode:
        sys.exit(f"a run ended with {process.returncode}: {told[-2000:]}")
    return said


def run_to_end(words: Sequence[str], folder: Path) -> str:
    """Run a command that nobody disturbs."""
    return finish(start(words, folder, "undisturbed"))


def outcome(folder: Path, said: str) -> tuple[str, dict[str, str]]:
    """Return the table of a run, and the digests of its logs by name."""
    facts = json.loads(said)
    facts.pop("log")
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
