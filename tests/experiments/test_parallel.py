"""Processes of our own: as many as there is work, and none left behind."""

import os
import threading
from pathlib import Path

import pytest

from meal_bayes.experiments.parallel import in_parallel


def children() -> set[int]:
    """Processes that this one has started."""
    text = Path(f"/proc/self/task/{threading.get_native_id()}/children").read_text()
    return {int(word) for word in text.split()}


def process_id(piece):
    return os.getpid()


def fail(piece):
    raise ZeroDivisionError(piece)


def test_no_more_processes_than_pieces_of_work():
    before, seen = children(), set()
    for _ in in_parallel(process_id, range(2), jobs=10_000):
        seen |= children() - before
    assert 2 <= len(seen) <= 4  # and loky's trackers of resources


def test_one_piece_is_done_here():
    assert list(in_parallel(process_id, range(1), jobs=2)) == [os.getpid()]
    assert list(in_parallel(process_id, [], jobs=2)) == []


def test_the_processes_end_with_the_work():
    used = set(in_parallel(process_id, range(8), jobs=2))
    assert os.getpid() not in used
    assert not used & children()


def test_faults_end_the_processes_and_are_told():
    before = children()
    with pytest.raises(ZeroDivisionError):
        list(in_parallel(fail, range(4), jobs=2))
    assert len(children() - before) <= 2  # trackers


def test_libraries_share_the_processors(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert set(in_parallel(threads, range(4), jobs=2)) == {"3"}
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert set(in_parallel(threads, range(4), jobs=2)) == {"1"}


def threads(piece):
    return os.environ["OMP_NUM_THREADS"]
