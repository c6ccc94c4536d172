"""What the benchmarks share: options, tables, processes of their own, CPU seconds and memory."""

import argparse
import json
import multiprocessing
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
# Benchmarks share functions with the paper's items, which lie beside them and are not installed.
ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT), str(ROOT / "examples")]
SPAWN = multiprocessing.get_context("spawn")  # processes that hold nothing but what they need


def options_of(doc: str) -> argparse.ArgumentParser:
    """Return a parser of the options, with the first line of a docstring, that has `--json`."""
    parser = argparse.ArgumentParser(description=doc.partition("\n")[0])
    parser.add_argument("--json", action="store_true", help="print JSON in place of a table")
    return parser


def show(rows: Sequence[Mapping[str, Any]], report: object = None) -> None:
    """Print rows as a table; with a report (`--json`) that, as JSON."""
    if report is not None:
        print(json.dumps(report, indent=1))
        return
    import pandas as pd  # noqa: PLC0415  processes that are measured do without

    table = pd.DataFrame(list(rows))
    print(table.to_string(index=False, float_format=_number, na_rep=""))


def _number(value: float) -> str:
    return f"{value:,.1f}" if abs(value) >= 100 else f"{value:.4g}"


def alone(function: Callable[..., T], *arguments: object) -> T:
    """Call a function in a process of its own, whose memory is its own."""
    with ProcessPoolExecutor(1, mp_context=SPAWN) as pool:
        return pool.submit(function, *arguments).result()


def cpu_seconds(words: Sequence[str], **variables: str) -> float:
    """Run Python with these words and return its CPU seconds; NaN where it fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, *words], capture_output=True, check=False, env={**os.environ, **variables}
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent if done.returncode == 0 else float("nan")


def peak_mb() -> float:
    """Return the most memory that this process has had, MB."""
    status = Path("/proc/self/status")
    if status.is_file():  # where it is, `getrusage` counts the parent in
        lines = dict(line.split(":", 1) for line in status.read_text("ascii").splitlines())
        return int(lines["VmHWM"].split()[0]) / 1024
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**20 if sys.platform == "darwin" else 2**10)
