"""How kernels are built: small, few arguments, one signature each, and a cache that sees edits."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

import meal_bayes
from meal_bayes.cli.console import showing_compilation
from meal_bayes.planners import watch_compilation
from meal_bayes.planners.jit import by_reference, called_kernel, entry_kernel


def run(script, cwd=None, **environment):
    """Run a script in a process of its own; return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, **environment},
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.long
def test_planning_leaves_the_settings_of_numba_alone():
    script = """
import numba
def settings():
    return {name: repr(getattr(numba.config, name)) for name in dir(numba.config) if name.isupper()}
before = settings()
from meal_bayes.planners import OpenLoop, warm_up
warm_up(OpenLoop())
assert settings() == before and len(before) > 50
"""
    run(script)


@by_reference
class Inner(NamedTuple):
    numbers: np.ndarray
    scale: float
    doubled: bool


@by_reference
class Outer(NamedTuple):
    inner: Inner
    total: np.ndarray
    offset: float | None


@called_kernel
def add_up(outer):
    inner = outer.inner
    for i in range(inner.numbers.shape[0]):
        outer.total[0] += inner.numbers[i] * inner.scale * (2.0 if inner.doubled else 1.0)


@called_kernel
def add_offset(outer, offset):
    if offset is not None:
        outer.total[0] += offset


@entry_kernel
def add_up_all(outer):
    add_up(outer)
    add_offset(outer, outer.offset)


def test_kernels_read_and_write_what_a_named_tuple_refers_to():
    for scale, doubled, total in ((2.0, True, 24.0), (0.5, False, 3.0)):
        outer = Outer(Inner(np.array([1.0, 2.0, 3.0]), scale, doubled), np.zeros(1), None)
        add_up_all(outer)
        add_up_all(outer._replace(offset=1.0))
        assert outer.total[0] == 2 * total + 1.0


@numba.njit
def add_one(x):
    return x + 1


@numba.njit
def add_none(x):
    return x


@numba.njit
def add_two(x, offset):
    if offset is not None:
        return add_none(x)
    return add_one(add_one(x))


def test_a_line_says_that_the_planner_is_prepared(capsys):
    """Whatever a kernel leads to is counted, also what an argument that is None leaves out."""
    with showing_compilation():
        assert add_two(0, None) == 2
        assert add_two(1, None) == 3
    text = capsys.readouterr().err
    assert text == "preparing the planner, once after an install, about 10 s\n"


def test_compilation_is_watched_kernel_by_kernel():
    seen = []
    ended = []
    with watch_compilation(seen.append, lambda: ended.append(len(seen))):
        assert add_two(0.0, None) == 2.0
    assert seen == [("add_two", "add_two", 0, 3), ("add_two", "add_one", 0, 3)]
    assert ended == [2]


SIGNATURES = """
import importlib, pkgutil
from dataclasses import replace
# Compiled for leaves of plans, and for those of tables.
LEAVES = "grow_tree", "_value_children", "value_leaf", "value_behaviors"
from meal_bayes import planners
from meal_bayes.planners import POMCP, Factored, OpenLoop, warm_up
for solver in (Factored(500), OpenLoop(), POMCP(5)):
    warm_up(solver)
import numpy as np
from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp, initial_belief
from meal_bayes.planners import History
domain, rng = load_domain("toy"), np.random.default_rng(0)
rows = rng.dirichlet(np.ones(2), (2, 3, 2))
for precision, limit in ((np.inf, np.inf), (5.0, 3)):
    momdp = build_momdp(domain, Query(domain.attributes), rows, precision, limit=limit)
    for solver in (OpenLoop(), POMCP(5), POMCP(5, points=0)):
        solver.solve(momdp, rng).decide(History(initial_belief(momdp)), rng)
momdp = build_momdp(domain, Query(domain.attributes), rows, limit=np.inf)
momdp = replace(momdp, bonus=rng.random(momdp.bonus.shape))
Factored(500).solve(momdp, rng).decide(History(initial_belief(momdp)), rng)
for info in pkgutil.walk_packages(planners.__path__, "meal_bayes.planners."):
    for name, value in vars(importlib.import_module(info.name)).items():
        signatures = () if isinstance(value, type) else getattr(value, "signatures", ())
        if len(signatures) > 1 + (name in LEAVES):
            print(value.py_func.__module__, name, *value.signatures)
from meal_bayes.planners.plans.values import _planned_yes_or_no
print(*_planned_yes_or_no.signatures, end="")  # nobody asked whether all hold
"""


@pytest.mark.long
def test_kernels_have_one_signature(tmp_path):
    """A second one doubles the time of compilation; literal integers make such.

    From an empty cache, as kernels that are loaded do not show what they call.
    """
    assert run(SIGNATURES, NUMBA_CACHE_DIR=str(tmp_path)) == ""


WARM = """
from meal_bayes.planners import POMCP, warm_up, watch_compilation
import numpy as np
from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp, initial_belief
from meal_bayes.planners import History
domain, rng = load_domain("toy"), np.random.default_rng(0)
rows = rng.dirichlet(np.ones(2), (2, 3, 2))
for limit in (3, np.inf):
    warm_up(POMCP(milliseconds=1), limit)
for limit in (3, np.inf):
    momdp = build_momdp(domain, Query(domain.attributes), rows, limit=limit)
    with watch_compilation(print, print):
        POMCP(5).solve(momdp, rng).decide(History(initial_belief(momdp)), rng)
"""


@pytest.mark.long
def test_a_warm_up_leaves_nothing_to_compile_whatever_the_budget(tmp_path):
    assert run(WARM, NUMBA_CACHE_DIR=str(tmp_path)) == ""


def copy_of_the_package(folder):
    package = folder / "meal_bayes"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(meal_bayes.__file__).parent, package, ignore=ignored)
    return package


TABLE = """
import numpy as np
from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp
from meal_bayes.planners.momdp_arrays import arrays_of
from meal_bayes.planners.plans.bayes_error import make_scratch, tabulate_errors
rows = np.tile([[0.9, 0.1], [0.2, 0.8]], (1, 3, 1, 1))
momdp = build_momdp(load_domain("toy"), Query(("red",)), rows)
percepts = arrays_of(momdp).percepts
table = np.empty((1, 65, 2))
scratch = make_scratch(percepts, 0, 0)
tabulate_errors(percepts, np.array([[1, 0, 0]]), np.zeros(1, int), scratch, table)
print(table.sum())
"""


@pytest.mark.long
def test_after_an_edit_in_another_folder_kernels_are_compiled_anew(tmp_path):
    """The entry kernel lies in `plans/`, the edited one in `momdp/`."""
    package = copy_of_the_package(tmp_path)
    places = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    first = run(TABLE, tmp_path, **places)
    again = run(TABLE, tmp_path, **places)
    assert first == again
    path = package / "momdp" / "observation.py"
    text = path.read_text(encoding="utf-8")
    line = "    return mean + (count - total * mean) / (precision + total)\n"
    assert line in text
    path.write_text(text.replace(line, line.replace("return mean", "return 0.5 * mean")))
    assert run(TABLE, tmp_path, **places) != first


def test_a_function_of_no_module_compiles_as_well() -> None:
    """Programs that write functions, such as PyTensor, do not say where these belong."""
    space = dict[str, object]()
    exec("def double(x):\n    return 2 * x\n", space)
    space["double"].__module__ = None
    assert numba.njit(space["double"])(21) == 42
