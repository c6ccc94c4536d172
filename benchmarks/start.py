"""How soon an answer comes: CPU seconds of small commands, and of reading the largest data set."""

import argparse
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

SAMPLE = Path(__file__).resolve().parents[1] / "logs" / "sample.mcap"
READ = "from meal_bayes.datasets import load_dataset; load_dataset('cy101')"
PARTS = {  # name: (bar in CPU seconds, words behind `python`)
    "--help": (0.5, ("-m", "meal_bayes", "--help")),
    "data list": (1.0, ("-m", "meal_bayes", "data", "list", "roc36")),
    "log info": (2.0, ("-m", "meal_bayes", "log", "info", str(SAMPLE))),
    "doctor": (5.0, ("-m", "meal_bayes", "doctor")),
    "read CY101": (10.0, ("-c", READ)),  # needs the recordings
}
REPEATS = 3


def cpu_seconds(words: tuple[str, ...]) -> float:
    """Run a program and return what it took; NaN where it fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *words], capture_output=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent if done.returncode == 0 else float("nan")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    found = {
        name: min(cpu_seconds(words) for _ in range(REPEATS)) for name, (_, words) in PARTS.items()
    }
    if options.json:
        print(json.dumps({name: None if s != s else round(s, 2) for name, s in found.items()}))  # noqa: PLR0124
        return
    for name, seconds in found.items():
        print(f"{name:<12} {seconds:5.2f} s CPU (bar: {PARTS[name][0]:g})")


if __name__ == "__main__":
    main()
