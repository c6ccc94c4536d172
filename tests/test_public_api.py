"""The public API: few names, loaded when first used; what the package imports, it declares."""

import ast
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from importlib import metadata
from itertools import chain
from pathlib import Path

import pytest

import meal_bayes
from meal_bayes import errors
from meal_bayes.agents import load_agent
from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.percepts import save_percepts
from meal_bayes.errors import MealBayesError, QueryError, SettingsError

SOURCE = Path(meal_bayes.__file__)
HEAVY = {"scipy", "numba", "sklearn", "pymc", "arviz", "mcap", "joblib", "pooch",
         "matplotlib", "pandas", "rerun", "click", "rich"}  # fmt: skip
QUESTION = {"dataset": "roc36", "object": "heavy_green_beans", "agent": "greedy", "logs": None}


def loaded_after(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter holds after some code."""
    show = "import sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{show}"], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


def test_the_import_loads_only_numpy_at_most():
    new = loaded_after("import meal_bayes") - loaded_after("pass") - set(sys.stdlib_module_names)
    assert new <= {"meal_bayes", "numpy"}


@pytest.mark.parametrize(
    "code",
    [
        "meal_bayes.load_domain('roc36')",
        "meal_bayes.Query(('heavy',))",
        "meal_bayes.load_percepts('roc36')",
        "import meal_bayes.datasets, meal_bayes.robots",
        "meal_bayes.build_momdp",
        "meal_bayes.MealBayesError",
        "dir(meal_bayes)",
    ],
)
def test_light_names_load_no_heavy_library(code):
    assert not loaded_after(f"import meal_bayes\n{code}") & HEAVY


@pytest.mark.long
def test_what_is_slow_to_load_waits_until_it_is_needed():
    assert "sklearn" not in loaded_after("import meal_bayes.perception")  # of the paper's method
    assert "pymc" not in loaded_after("import meal_bayes.posterior.draws")


def test_every_name_is_found_and_documented():
    for name in meal_bayes.__all__:
        value = getattr(meal_bayes, name)
        assert value.__doc__, name
        assert value.__name__ == name
        assert value.__module__.startswith("meal_bayes.")
        assert ">>> " in value.__doc__, name
    assert len(meal_bayes.__all__) <= 45
    page = (Path(__file__).resolve().parents[1] / "docs" / "public.md").read_text(encoding="utf-8")
    assert not [name for name in meal_bayes.__all__ if f"`{name}`" not in page]
    assert set(meal_bayes.__all__) <= set(dir(meal_bayes))
    assert "__version__" in dir(meal_bayes)
    assert re.fullmatch(r"\d+\.\d+\..+|unreleased", meal_bayes.__version__)


def test_type_checkers_see_the_same_names():
    tree = ast.parse(SOURCE.read_text(encoding="utf-8"))
    block, hidden = (node for node in tree.body if isinstance(node, ast.If))
    (found_late,) = hidden.body  # or every misspelled name would be anything
    assert ast.unparse(hidden.test) == "not TYPE_CHECKING"
    assert found_late.name == "__getattr__"
    seen = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(seen) == sorted(meal_bayes.__all__)
    for name, module in seen.items():
        assert f"meal_bayes.{meal_bayes._HOME[name]}" == module


def test_an_unknown_name_is_told():
    with pytest.raises(AttributeError, match="no attribute 'asc'; its names are: MOMDP,"):
        _ = meal_bayes.asc
    with pytest.raises(ImportError):
        exec("from meal_bayes import asc")


def test_errors_are_one_family():
    kinds = [value for value in vars(errors).values() if isinstance(value, type)]
    assert all(issubclass(kind, MealBayesError) for kind in kinds)
    assert meal_bayes.MealBayesError is MealBayesError


def test_ask_answers_the_same_again_and_tells_each_step():
    steps = []
    first = meal_bayes.ask("Is it heavy?", **QUESTION, on_step=steps.append)
    again = meal_bayes.ask(["heavy"], **QUESTION)
    assert isinstance(first, meal_bayes.Trial)
    assert tuple(steps) == first.steps
    assert [s.decision.action for s in again.steps] == [s.decision.action for s in steps]
    assert first.cost == again.cost
    assert first.task.query == meal_bayes.Query(("heavy",))


def test_ask_logs_its_trial_like_all_others(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    trial = meal_bayes.ask("heavy", **{**QUESTION, "logs": "logs"})
    asked = {name: value for name, value in QUESTION.items() if name != "logs"}
    meal_bayes.ask("heavy", **asked)
    logs = [*(tmp_path / "logs" / "roc36").glob("*.mcap")]
    kept = [entry for log in logs for entry in meal_bayes.read_trials(log)]
    assert [entry.cost for entry in kept] == [trial.cost] * 2
    assert [len(entry.steps) for entry in kept] == [len(trial.steps)] * 2
    meal_bayes.ask("heavy", **{**QUESTION, "log": tmp_path / "one.mcap"})
    assert (tmp_path / "one.mcap").is_file()
    assert len([*tmp_path.rglob("*.mcap")]) == 3


def test_ask_takes_a_name_a_path_or_a_table(tmp_path):
    table = load_percepts("roc36")
    save_percepts(table, tmp_path / "t.npz")
    costs = [
        meal_bayes.ask("heavy, beans", **{**QUESTION, "dataset": source}).cost
        for source in ("roc36", table, tmp_path / "t.npz", str(tmp_path / "t.npz"))
    ]
    assert len(set(costs)) == 1


def test_ask_takes_an_agent_a_reward_and_drawn_percepts():
    agent = replace(load_agent("greedy"), name="mine", base_rates=True)
    trial = meal_bayes.ask("heavy", **{**QUESTION, "agent": agent}, reward=80.0, percepts="model")
    assert trial.agent == "mine"
    assert trial.momdp.correct == -trial.momdp.incorrect == 80.0
    assert trial.momdp.prior[0] != 0.5


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"dataset": "rock36"}, SettingsError, "did you mean 'roc36'"),
        ({"object": "heavy_green_bean"}, SettingsError, "did you mean 'heavy_green_beans'"),
        ({"agent": "greedo"}, SettingsError, "did you mean 'greedy'"),
        ({"seed": -1}, SettingsError, "0 or more"),
        ({"percepts": "drawn"}, SettingsError, "Unknown percepts"),
        ({"question": "Is it heavvy?"}, QueryError, "did you mean 'heavy'"),
    ],
)
def test_ask_tells_what_is_wrong(change, kind, message):
    with pytest.raises(kind, match=message):
        meal_bayes.ask(**{"question": "heavy", **QUESTION, **change})


ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def names(requirements):
    """Return the plain names of requirements."""
    matches = (re.match(r"[A-Za-z0-9._-]+", text) for text in requirements)
    return {match.group().lower().replace("_", "-") for match in matches if match}


def imported():
    """Yield the libraries that a module of the package imports."""
    for path in (ROOT / "meal_bayes").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield node.module or ""


@pytest.mark.long
def test_what_is_imported_is_declared():
    extras = [PROJECT["optional-dependencies"][name] for name in ("bags", "cluster", "gym")]
    declared = names([*PROJECT["dependencies"], *chain(*extras)]) | {"distributed"}
    homes = metadata.packages_distributions()
    libraries = {name.partition(".")[0] for name in imported()} - {"meal_bayes"}
    missing = {
        name
        for name in libraries - set(sys.stdlib_module_names)
        if not names(homes.get(name, [name])) & declared
    }
    assert missing == set()
