"""The picture of the house holds: a room imports only rooms below it, a library has one room."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "meal_bayes"

GROUND = {
    "errors",
    "arrays",
    "seeds",
    "display",
    "files",
    "cache",
    "processes",
    "untrusted",
    "version",
}
BELOW_LOG = {
    "domain", "datasets", "robots", "perception", "posterior", "momdp", "planners"
}  # fmt: skip
EVERYTHING = {
    *BELOW_LOG, "agents", "trial_log", "learner", "experiments", "evaluation", "viewer", "gym",
    "cli",
}  # fmt: skip

# Room -> the rooms (or single modules of a room) that it may import, besides itself and the ground.
ROOMS: dict[str, set[str]] = {
    "errors": set(),
    "arrays": set(),
    "seeds": set(),
    "display": set(),
    "files": set(),
    "cache": set(),
    "processes": set(),
    "untrusted": set(),
    "version": set(),
    "domain": set(),
    "datasets": {"domain"},
    "robots": {"datasets", "domain"},
    "perception": {"datasets", "domain"},
    "posterior": {"perception.confusion", "domain"},
    "momdp": {"domain"},
    "planners": {"momdp", "domain"},
    "agents": BELOW_LOG,
    "trial_log": {*BELOW_LOG, "agents.trial"},
    "learner": {*BELOW_LOG, "agents", "trial_log"},
    # perception and domain: a run under the paper's classifiers computes its own percept table
    "experiments": {
        "learner",
        "trial_log",
        "agents",
        "perception",
        "robots.simulated_arm",
        "datasets",
        "domain",
    },
    "evaluation": {*BELOW_LOG, "agents", "trial_log"},
    "viewer": {*BELOW_LOG, "agents", "trial_log"},
    "gym": {*BELOW_LOG, "agents", "experiments"},
    "cli": {*EVERYTHING, "__init__"},  # for the version
    "__init__": EVERYTHING,
    "__main__": EVERYTHING,
}

# Library -> the rooms or single modules that may import it; NumPy and SciPy serve every room.
LIBRARIES: dict[str, set[str]] = {
    "sklearn": {"perception"},
    "threadpoolctl": {"perception"},
    "pymc": {"posterior.hierarchical"},
    "pytensor": {"posterior.hierarchical"},  # what PyMC models are written in
    "arviz": {"posterior.idata"},
    "numba": {"planners.kernels", "cache"},  # all kernels are made by one function
    "mcap": {"trial_log"},
    "google": {"trial_log"},
    "zstandard": {"trial_log"},
    "rerun": {"viewer"},
    "rerun_bindings": {"viewer.replay"},
    "matplotlib": {"evaluation.canvas"},
    "jinja2": {"evaluation.page"},
    "joblib": {"experiments.parallel"},
    "dask": {"experiments.parallel"},
    "platformdirs": {"cache", "cli.doctor"},
    "pooch": {"datasets.download"},
    "mujoco": {
        f"robots.simulated_arm.{module}" for module in ("camera", "frame", "model", "physics")
    },
    "gymnasium": {"gym"},
    "pandas": {"agents.trial_display", "datasets.csv_folder", "evaluation.summary"},  # when called
    "click": {"cli"},
    "rich": {"cli"},
}

# The public labels of ISPY32 are a pickle; this module's loader can make numbers and nothing else.
PICKLE_READER = "datasets.label_pickle"
UNSAFE_MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal"}
UNSAFE_CALLS = {"eval", "exec", "__import__", "pickle.load", "pickle.loads", "joblib.load"}


def test_rooms_import_only_rooms_below() -> None:
    assert list(_violations_of_the_tree()) == []


def test_the_wings_of_the_table_are_apart() -> None:
    knows, does = {"perception", "posterior"}, {"momdp", "planners"}
    for room in does:
        assert not _reachable(room) & (knows | {"datasets", "robots", "agents"})
    for room in knows:
        assert not _reachable(room) & (does | {"robots", "agents"})
    for room in ROOMS.keys() - {"__init__", "__main__", "cli"}:
        assert room not in _reachable(room), f"{room} imports itself through others"


@pytest.mark.parametrize(
    ("place", "source"),
    [
        ("planners/greedy.py", "from meal_bayes.perception import Perceiver"),
        ("posterior/dirichlet.py", "from meal_bayes.perception.ensemble import Perception"),
        ("trial_log/reader.py", "import meal_bayes.agents.named"),
        ("evaluation/summary.py", "from meal_bayes.experiments import run_offline"),
        ("evaluation/summary.py", "from meal_bayes import ask"),
        ("evaluation/summary.py", "import meal_bayes"),
        ("momdp/model.py", "def f():\n    from meal_bayes import planners"),
        ("seeds.py", "from scipy import stats"),
        ("momdp/model.py", "import sklearn.svm"),
        ("planners/pomcp/policy.py", "from numba import njit"),
        ("agents/offline.py", "import torch"),
        ("agents/offline.py", "from .trial import Trial"),
        ("attic/model.py", "import numpy as np"),
        ("datasets/load.py", "import pickle"),
        ("datasets/label_pickle.py", "import pickle\npickle.load(file)"),
        ("domain/tables.py", "eval(text)"),
        ("datasets/percepts.py", "numpy.load(path, allow_pickle=True)"),
        ("agents/offline.py", "importlib.import_module('meal_bayes.viewer')"),
    ],
)
def test_a_violation_is_seen(place: str, source: str) -> None:
    assert list(_violations(PurePosixPath(place), ast.parse(source)))


def _files() -> list[Path]:
    files = sorted(PACKAGE.rglob("*.py"))
    assert len(files) > len(ROOMS)
    return files


def _violations_of_the_tree() -> Iterator[str]:
    for path in _files():
        place = PurePosixPath(path.relative_to(PACKAGE).as_posix())
        yield from _violations(place, ast.parse(path.read_text(encoding="utf-8"), str(path)))


def _violations(place: PurePosixPath, tree: ast.Module) -> Iterator[str]:
    """Say what a module does that its place in the house does not allow."""
    module = ".".join(place.with_suffix("").parts)
    room = place.with_suffix("").parts[0]
    if room not in ROOMS:
        yield f"{place}: the house has no room {room!r}"
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            yield f"{place}:{node.lineno} imports relatively"
        elif isinstance(node, ast.Import | ast.ImportFrom):
            for name in _imported(node):
                if not _allowed(name, room, module):
                    yield f"{place}:{node.lineno} imports {name}"
        elif isinstance(node, ast.Call) and _unsafe(node, room):
            yield f"{place}:{node.lineno} calls {ast.unparse(node)[:60]}"


def _imported(node: ast.Import | ast.ImportFrom) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if node.module == "meal_bayes":  # from meal_bayes import momdp
        return [f"meal_bayes.{alias.name}" for alias in node.names]
    return [node.module or ""]


def _allowed(name: str, room: str, module: str) -> bool:
    top, _, rest = name.partition(".")
    if top == "meal_bayes":
        place = rest or "__init__"
        return place.split(".")[0] in {room, *GROUND} or _within(place, ROOMS[room])
    if top in UNSAFE_MODULES:
        return module == PICKLE_READER
    if top in sys.stdlib_module_names or top == "numpy":
        return True
    if top == "scipy":
        return room not in GROUND
    return _within(module, LIBRARIES.get(top, set()))


def _within(module: str, places: set[str]) -> bool:
    """Whether a module is one of the places, or lies in one that is a whole room."""
    return module in places or module.partition(".")[0] in places


def _unsafe(node: ast.Call, room: str) -> bool:
    name = ast.unparse(node.func)
    if name.endswith("import_module") and room not in ("__init__", "cli"):
        return True
    return name in UNSAFE_CALLS or any(
        keyword.arg == "allow_pickle" and getattr(keyword.value, "value", None) is not False
        for keyword in node.keywords
    )


def _reachable(room: str) -> set[str]:
    """Rooms that a room sees through any chain of imports that the table allows."""
    seen, frontier = set[str](), [room]
    while frontier:
        for place in ROOMS[frontier.pop()]:
            below = place.split(".")[0]
            if below not in seen:
                seen.add(below)
                frontier.append(below)
    return seen
