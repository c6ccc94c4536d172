"""Every benchmark runs from its command line to its last line, on the smallest size it has.

What a benchmark reads or repeats is made small where no option does; what it says is not judged.
"""

import json
import sys
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from meal_bayes import build_percept_table
from meal_bayes.datasets import make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.experiments import offline_tasks
from meal_bayes.posterior.draws import Sampling
from meal_bayes.seeds import stream

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
COMMANDS = {
    path.stem
    for path in BENCHMARKS.glob("*.py")
    if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
}
# Their runs stand in `test_benchmarks.py`, which judges what they say.
ELSEWHERE = {"planner", "fuzz", "simulated_page"}


class Run(NamedTuple):
    """A command line, module constants that make it small, and the fixture that it needs."""

    benchmark: str
    words: str
    smaller: Mapping[str, Any] = {}
    needs: str = ""


@cache
def small_data():
    """Make recordings of fourteen objects, whose attributes look like those of toy."""
    names = ["red", "green", "full"]
    settings = {"extends": "toy", "name": "small", "attributes": names, "asked_minimum": 1}
    return make_synthetic(load_domain(settings), objects=14, recordings=2, rng=stream(0, "small"))


@cache
def small_table():
    return build_percept_table(small_data())


def small_group():
    """Make a table with a group, in place of ROC36's."""
    return import_module("questions").synthetic(2, 12)


def few_tasks(table):
    return offline_tasks(table, 2, 4, 0)


def few_draws(*numbers, **how):
    return Sampling(20, 20, 2, jobs=1, seed=how["seed"])


def few_recordings():
    return import_module("simulated_arm").training_recordings(6, 1)


DATA = {"load_dataset": lambda name, root=None: small_data()}
TABLE = {"load_percepts": lambda name: small_table()}
REFITS = {"TRIALS": 3, "TESTS": 1, "REFITS": (0.5,), "DATASETS": ("cy101",), **DATA}
DRAWS = {"SIMULATIONS": 4, "MORE": 1, "Sampling": few_draws, **TABLE}
PICTURES = {
    "LOG": Path("sample.mcap"),
    "PICTURES": Path(),
    "VIEWER": Path("viewer.png"),
    "NARROW": Path("narrow.png"),
}
ARM = {"TWINS": 3, "LAST": 2, "BATCHES": 1, "TRIALS": 2, "REPEATS": 1,
       "training_recordings": few_recordings}  # fmt: skip

RUNS = (
    Run("bayes_adaptive", "--drawn 1"),
    Run("bayes_adaptive", "--picture picture.svg"),
    Run("calibration", "--dataset small", {"SETS": 5, **TABLE}),
    Run("calibration", "--part answers --dataset roc36 --trials 2", {"ASKED": {"roc36": (1,)}}),
    Run("calibration", "--part simulated --dataset roc36 --trials 5", {"ASKED": {"roc36": (1,)}}),
    Run("compare", "--simulations 2 --measure success", {"FAMILY": 2}),
    Run("costs", "robots --sizes 11x6"),
    Run("costs", "decisions --sizes 2x5"),
    Run("costs", "learning --task table", {"AXES": {"objects": (10, 20)}}),
    Run("costs", "live --trials 2", DATA),
    Run("costs", "start", {"COMMANDS": {"help": ("-m", "meal_bayes", "--help")}, "DEMO": "pass"}),
    Run("digests", "now.json", {"DATASETS": ("roc36",), "SMALL": {"offline": "--trials 1"}}),
    Run("halves", "roc36 --splits 2", {}, "recordings"),
    Run("learner", "--refits 1", REFITS),
    Run("knowing_little", "rates roc36 --seeds 0-1"),
    Run("learning", "toy 0-2 --trials 3"),
    Run("learning", "detector 0-1 --trials 3 --agent bayes_same_objects"),
    Run("learning", "physics 0-1 --trials 1", needs="sim"),
    Run("losses", "--dataset roc36 --trials 2", {"BOUNDED": 1, "QUESTIONS": ((1, "values"),)},
        "recordings"),
    Run("peers_learning", "5-7 --tune 0-1 --trials 3", {"SCALES": (0.01,)}, "pymdp"),
    Run("perception", "--dataset small --permutations 1 --paper", DATA),
    Run("picture", "--log", PICTURES),
    Run("picture", "--log --viewer", PICTURES, "vulkan"),
    Run("questions", "groups", {"load_percepts": lambda name: small_group(), "SIZES": (3,)}),
    Run("questions", "events --models A1 --episodes 3"),
    Run("questions", "coupled --dataset ispy32", {"coupled_tasks": few_tasks}),
    Run("readme", "--check"),
    Run("sbc", "--only closed", DRAWS),  # the other parts fit by NUTS, which takes minutes
    Run("shared_training", "--simulations 2 --objects 6", {"NEW": 10}),
    *(Run("simulated", f"--part {part} --objects 2 --asked 1", ARM, "sim")
      for part in ("answers", "labels", "content")),
    Run("simulated", "--part live --trials 4", ARM, "sim"),
    Run("simulated", "--part population --crowd 6", ARM, "sim"),
)  # fmt: skip


def test_every_benchmark_is_run():
    assert {run.benchmark for run in RUNS} | ELSEWHERE == COMMANDS


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of means of next to nothing
@pytest.mark.parametrize("run", RUNS, ids=lambda run: f"{run.benchmark} {run.words}".strip())
def test_a_benchmark_runs(run, request, monkeypatch, tmp_path, capfd):
    if run.needs:
        request.getfixturevalue(run.needs)
    source = (BENCHMARKS / f"{run.benchmark}.py").read_text(encoding="utf-8")
    words = run.words.split()
    if "options_of(" in source and "--picture" not in words:
        words.append("--json")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "data"))  # what it keeps is not ours
    start(run, words, monkeypatch)
    printed = capfd.readouterr().out
    assert printed
    if "--json" in words:
        assert json.loads(printed)


def start(run, words, monkeypatch):
    """Run it in this process."""
    benchmark = import_module(run.benchmark)
    for constant, value in run.smaller.items():
        assert hasattr(benchmark, constant)
        monkeypatch.setattr(benchmark, constant, value)
    monkeypatch.setattr(sys, "argv", [f"{run.benchmark}.py", *words])
    with pytest.raises(SystemExit) as end:
        sys.exit(benchmark.main())
    assert not end.value.code
