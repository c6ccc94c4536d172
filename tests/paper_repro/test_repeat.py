"""Items that are run again are compared with what is committed, leaf by leaf."""

import runpy
from pathlib import Path

import pytest

from paper_repro import frame

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return runpy.run_path(str(BENCHMARKS / "repeat.py"))


def test_what_is_committed_comes_again(script, tmp_path):
    assert script["repeat"]("table5", tmp_path, 0.001) == []


@pytest.mark.parametrize(
    ("changed", "place"),
    [
        ({"a": [1.0, {"b": 2.02}], "c": "x"}, "/a/1/b"),  # a number farther away
        ({"a": [1.0], "c": "x"}, "/a"),  # a row less
        ({"a": [1.0, {"b": 2.0}], "c": "y"}, "/c"),  # another text
        ({"a": [1.0, {"b": None}], "c": "x"}, "/a/1/b"),  # nothing in place of a number
        ({"a": [1.0, {"b": 2.0}]}, "/c"),  # a key less
    ],
)
def test_every_difference_is_found(script, changed, place):
    was = {"a": [1.0, {"b": 2.0}], "c": "x"}
    assert [where for where, _ in script["differences"](was, changed, 0.001)] == [place]
    assert not [*script["differences"](was, was, 0.0)]
    near = {"a": [1.0, {"b": 2.001}], "c": "x"}
    assert not [*script["differences"](was, near, 0.001)]


def test_a_changed_result_fails(script, tmp_path, monkeypatch):
    committed = frame.read_result("table5")
    committed["verdict"] = "reproduced"
    monkeypatch.setattr(frame, "read_result", lambda item: committed)
    (found,) = script["repeat"]("table5", tmp_path, 0.001)
    assert found[0] == "/verdict"
