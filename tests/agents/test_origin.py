"""What the digest of an agent of one's own covers, and what a worker must find."""

import importlib
import sys

import pytest

from meal_bayes.agents import as_agent, origin_of

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
    before = origin_of(agent)
    assert set(before.modules) == {"planner_of_mine", "rules", "kept"}
    assert before.folders == (str(folder),)
    with (folder / changed).open("a") as file:
        file.write("\nmore = 1\n")
    assert (origin_of(agent).digest != before.digest) == matters
