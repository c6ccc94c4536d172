"""What the digest of an agent of one's own covers."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.agents import AGENTS, as_agent
from meal_bayes.experiments import sources
from meal_bayes.experiments.sources import agent_digest

ROOT = Path(sources.__file__).resolve().parents[2]
PLANNER = """import numpy
from rules import best

class Planner:
    name = "mine"

    def solve(self, *arguments, **options):
        raise NotImplementedError
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A planner in a module, what it imports from beside it, and a module that nobody imports."""
    (tmp_path / "kept").mkdir()
    (tmp_path / "planner_of_mine.py").write_text(PLANNER)
    (tmp_path / "rules.py").write_text("import json\nfrom kept import deep\nbest = 1\n")
    (tmp_path / "kept" / "__init__.py").write_text("")
    (tmp_path / "kept" / "deep.py").write_text("depth = 3\n")
    (tmp_path / "other.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("planner_of_mine", "rules", "kept", "kept.deep"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "matters"),
    [("planner_of_mine.py", True), ("rules.py", True), ("kept/deep.py", True), ("other.py", False)],
)
def test_what_a_planner_imports_from_beside_it_is_in_its_digest(folder, changed, matters):
    agent = as_agent(importlib.import_module("planner_of_mine").Planner())
    before = agent_digest(agent)
    with (folder / changed).open("a") as file:
        file.write("\nmore = 1\n")
    assert (agent_digest(agent) != before) == matters


def test_settings_matter_and_shipped_agents_have_no_sources(folder):
    planner = importlib.import_module("planner_of_mine").Planner

    def digest(**settings):
        value = planner()
        vars(value).update(settings)
        return agent_digest(as_agent(value))

    values = [{}, {"a": 1}, {"a": 2}, {"a": {"x", "y"}}, {"a": np.arange(5000)}]
    values.append({"a": np.append(np.arange(4999), 0)})  # another where its repr says nothing
    assert len({digest(**settings) for settings in values}) == len(values)
    assert digest(a={"x", "y"}) == digest(a={"y", "x"})
    assert {agent_digest(agent) for agent in AGENTS.values()} == {""}


def test_what_a_function_is_closed_over_matters(folder):
    planner = importlib.import_module("planner_of_mine").Planner

    def made(looks):
        return lambda domain, query, most=looks: (planner(), looks)

    digests = [agent_digest(as_agent(made(looks))) for looks in (1, 1, 2)]
    assert digests[0] == digests[1] != digests[2]


def test_the_digest_is_that_of_every_process(folder):
    """Strings have another hash in each, and so sets another order."""
    code = (
        "from planner_of_mine import Planner; from meal_bayes.agents import as_agent;"
        "from meal_bayes.experiments.sources import agent_digest;"
        "p = Planner(); p.words = frozenset('abcdefgh'); print(agent_digest(as_agent(p)))"
    )
    digests = set()
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": f"{folder}:{ROOT}"}
        digests.add(subprocess.check_output([sys.executable, "-c", code], env=environment))
    assert len(digests) == 1
