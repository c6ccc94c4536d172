"""No test reads a clock: a busy machine must not fail a newcomer. Speed is in benchmarks/."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
CLOCKS = {
    "time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns",
    "process_time", "process_time_ns", "thread_time", "getrusage", "now", "utcnow",
}  # fmt: skip
MODULES = {"time", "resource", "datetime", "date"}
FILES = sorted(path.relative_to(TESTS).as_posix() for path in TESTS.rglob("*.py"))


def clocks(source: str) -> list[str]:
    """Return the clocks that a program reads."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.attr in CLOCKS and node.value.id in MODULES:
                found.append(f"{node.value.id}.{node.attr}")
        elif isinstance(node, ast.ImportFrom) and node.module in MODULES:
            found += [alias.name for alias in node.names if alias.name in CLOCKS]
    return found


def test_clocks_are_found():
    assert clocks("import time\ntime.monotonic()") == ["time.monotonic"]
    assert clocks("from time import sleep, perf_counter") == ["perf_counter"]
    assert clocks("import time\ntime.sleep(1)") == []


@pytest.mark.parametrize("name", FILES)
def test_no_test_reads_a_clock(name):
    assert clocks((TESTS / name).read_text(encoding="utf-8")) == []
