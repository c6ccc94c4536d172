"""The shipped tables, loaded once; logs and planners that several files need."""

import importlib
import os
import sys

import pytest

from meal_bayes.datasets import PerceptTable, load_percepts

PLANNER = """
from meal_bayes.momdp import best_report
from meal_bayes.planners import unvalued

LOOKS = {looks}


class Looker:
    def __init__(self, more=0):
        self.more = more

    def solve(self, momdp, rng):
        return LookerPolicy(momdp, LOOKS + self.more)


class LookerPolicy:
    def __init__(self, momdp, looks):
        self.momdp, self.looks = momdp, looks

    def decide(self, history, rng):
        momdp, x = self.momdp, history.belief.x
        if len(history.actions) < self.looks:
            return unvalued(momdp, int(momdp.legal[x].argmax()))
        return unvalued(momdp, best_report(momdp, history.belief))
"""


@pytest.fixture(scope="session")
def contents():
    """Return a function: the bytes of all logs below a folder, by their relative names."""

    def read(folder):
        return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*.mcap")}

    return read


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Return a function that writes a planner's module anew and imports it."""
    folder = tmp_path / "mine"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    name = f"looker_{abs(hash(str(tmp_path)))}"
    times = iter(range(1_000_000_000, 2_000_000_000, 10))

    def write(looks):
        path = folder / f"{name}.py"
        path.write_text(PLANNER.format(looks=looks), encoding="utf-8")
        os.utime(path, (time := next(times), time))  # or Python takes the bytecode of before
        sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module(name)

    yield write
    sys.modules.pop(name, None)


@pytest.fixture(scope="session")
def roc36() -> PerceptTable:
    return load_percepts("roc36")


@pytest.fixture(scope="session")
def ispy32() -> PerceptTable:
    return load_percepts("ispy32")


@pytest.fixture(scope="session")
def cy101() -> PerceptTable:
    return load_percepts("cy101")
