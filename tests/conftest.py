"""What all tests share: recordings and reference models, where they are at hand."""

import fcntl
import os
import shutil
import subprocess
from collections.abc import Callable
from importlib import import_module, resources
from importlib.util import find_spec
from pathlib import Path
from time import sleep
from types import ModuleType
from typing import NoReturn, TypeVar

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from meal_bayes.datasets import make_synthetic, save_csv_folder
from meal_bayes.domain import load_domain
from meal_bayes.planners import POMCP, Factored, warm_up

Held = TypeVar("Held")
LOOKS = 12_000
PAUSE = 0.01  # s between looks: two minutes of patience on a quiet machine

# The same examples each time; no limit on their time, which a busy machine would exceed.
STEADY = settings(
    derandomize=True, database=None, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("quick", STEADY, max_examples=8)
settings.register_profile("thorough", STEADY, max_examples=20)
settings.register_profile("bars", STEADY, max_examples=2500)  # minutes to hours, of named files
settings.register_profile("lives", STEADY, max_examples=300)  # of tests/learner/test_lives.py
settings.load_profile("quick")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all but n cases of a test that is marked `quick(n)` as long; the n are spread evenly."""
    cases = dict[tuple[Path, str], list[pytest.Item]]()
    for item in items:
        if item.get_closest_marker("quick"):
            function = item.nodeid.partition("[")[0]
            cases.setdefault((item.path, function), []).append(item)
    for of_one_test in cases.values():
        marker = of_one_test[0].get_closest_marker("quick")
        number = min(marker.args[0], len(of_one_test)) if marker else 0
        kept = set(np.linspace(0, len(of_one_test) - 1, number).round().astype(int).tolist())
        for place, item in enumerate(of_one_test):
            if place not in kept:
                item.add_marker(pytest.mark.long)


def missing(reason: str, *, required: bool) -> NoReturn:
    """Skip and say why, or fail where what is missing is required. No test skips but here."""
    if required:
        pytest.fail(f"required but missing: {reason}")
    pytest.skip(reason)


def all_required() -> bool:
    """Return whether what every machine can have must be there: recordings, the extra `test`."""
    return os.environ.get("MEAL_BAYES_REQUIRE_ALL") == "1"


def view_required() -> bool:
    """Return whether pictures must be looked at: a Vulkan driver and a browser."""
    return os.environ.get("MEAL_BAYES_REQUIRE_VIEW") == "1"


@pytest.fixture(scope="session")
def eventually() -> Callable[..., object]:
    """Return what a condition is once it holds; no test asks a clock how long that took."""

    def wait_until(condition: Callable[[], Held], what: str = "it did not come about") -> Held:
        for _ in range(LOOKS):
            if holds := condition():
                return holds
            sleep(PAUSE)
        pytest.fail(what)

    return wait_until


@pytest.fixture(scope="session")
def running() -> Callable[[int], bool]:
    """Return whether a process runs; one that ended and that nobody waited for does not."""

    def is_running(pid: int) -> bool:
        try:
            state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2]
        except OSError:
            return False
        return state.split()[0] != "Z"

    return is_running


@pytest.fixture(scope="session", autouse=True)
def _compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Compile the planners' kernels, or load what the test process that came first compiled.

    Before any test, or two would compile the same at once; a process alone compiles what it needs.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    with (tmp_path_factory.getbasetemp().parent / "compiling").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for solver, limit in ((Factored(500), 3), (POMCP(5), 3), (POMCP(5), np.inf)):
            warm_up(solver, limit)


def folder_of(name: str, variable: str, *, required: bool) -> Path:
    """Return a folder that an environment variable names, or the one beside the repository.

    What a variable names has to be there.
    """
    beside = Path(__file__).resolve().parents[2] / "shared" / name
    folder = Path(os.environ.get(variable, beside))
    if not folder.is_dir():
        reason = f"no {name} in {folder}; set {variable} to a folder of them"
        missing(reason, required=required or variable in os.environ)
    return folder


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Return the folder mirror of the public recordings."""
    return folder_of("datasets", "MEAL_BAYES_DATA_URL", required=all_required())


@pytest.fixture(scope="session")
def reference() -> Path:
    """Return the folder of the files of others, .pomdp and .pomdpx, of the reference models."""
    return folder_of("reference", "MEAL_BAYES_REFERENCE", required=False)


@pytest.fixture(scope="session")
def pomdpsol() -> str:
    """Return the program of SARSOP, a peer of our planners."""
    program = os.environ.get("MEAL_BAYES_POMDPSOL") or shutil.which("pomdpsol")
    if program is None:
        missing("no pomdpsol; set MEAL_BAYES_POMDPSOL to it", required=False)
    return program


@pytest.fixture(scope="session")
def pomdp_py() -> ModuleType:
    """Return the benchmark's module of pomdp-py, a peer of our planners."""
    if find_spec("pomdp_py") is None:
        missing("no pomdp-py; pip install 'meal-bayes[bench]'", required=False)
    return import_module("pomdp_py_solver")


@pytest.fixture(scope="session")
def pomdpplanners() -> ModuleType:
    """Return the benchmark's module of POMDPPlanners, a peer of our planners."""
    if find_spec("POMDPPlanners") is None:
        missing("no POMDPPlanners; pip install POMDPPlanners", required=False)
    return import_module("pomdpplanners_solver")


@pytest.fixture(scope="session")
def package_of_frames() -> Callable[[str], ModuleType]:
    """Return a package of data frames by its name, which need not be installed."""

    def imported(name: str) -> ModuleType:
        if find_spec(name) is None:
            missing(f"no {name}; pip install {name}", required=False)
        return import_module(name)

    return imported


@pytest.fixture(scope="session")
def pymdp() -> None:
    """Ask for pymdp, a peer that learns."""
    if find_spec("pymdp") is None:
        missing("no pymdp; pip install inferactively-pymdp", required=False)


@pytest.fixture(scope="session")
def mcap_core() -> list[str]:
    """Return the words that start node, which finds @mcap/core, the reference reader of MCAP."""
    node = shutil.which("node")
    command = [str(node), "-e", "require('@mcap/core'); require('fzstd')"]
    if node is None or subprocess.run(command, capture_output=True, check=False).returncode:
        missing("no node with npm's @mcap/core and fzstd", required="NODE_PATH" in os.environ)
    return [str(node)]


@pytest.fixture(scope="session")
def vulkan() -> None:
    """Ask for a Vulkan driver, by which the viewer draws; one in software will do."""
    folders = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
    named = os.environ.get("VK_DRIVER_FILES")  # where the loader looks first
    if not named and not any(path for folder in folders for path in folder.glob("*.json")):
        missing(
            "no Vulkan driver: apt-get install --no-install-recommends mesa-vulkan-drivers",
            required=view_required(),
        )


@pytest.fixture(scope="session")
def browser() -> str:
    """Return the program of a browser."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        missing("no browser: apt-get install chromium", required=view_required())
    return program


@pytest.fixture(scope="session")
def dask() -> None:
    """Ask for the extra that runs clusters."""
    if find_spec("distributed") is None:
        missing("no Dask; pip install 'meal-bayes[cluster]'", required=all_required())


@pytest.fixture(scope="session")
def sim() -> ModuleType:
    """Return the example of a robot in physics."""
    if find_spec("mujoco") is None:
        missing("no MuJoCo; pip install 'meal-bayes[sim]'", required=all_required())
    return import_module("simulated_arm")


@pytest.fixture(scope="session")
def own_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write recordings and labels of one's own as CSV, and return the path of the domain's table.

    It is the toy domain with made-up recordings, which lie in the same folder.
    """
    folder = tmp_path_factory.mktemp("own")
    text = (resources.files("meal_bayes") / "domain/tables/toy.toml").read_text(encoding="utf-8")
    path = folder / "own.toml"
    path.write_text(text.replace('name = "toy"', 'name = "own"'), encoding="utf-8")
    rng = np.random.default_rng(5)
    domain = load_domain(path)
    save_csv_folder(make_synthetic(domain, objects=24, recordings=3, rng=rng), folder)
    return path
