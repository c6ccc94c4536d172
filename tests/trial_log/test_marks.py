"""Tables of marks: read back exactly as written, and refused where they are damaged."""

import errno
import os
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.errors import LogError, OutputError
from meal_bayes.trial_log import Marks

number = st.floats(allow_nan=False, allow_infinity=False)
share = st.floats(0, 1)


@st.composite
def some_marks(draw):
    n, trials = draw(st.integers(1, 3)), draw(st.integers(1, 5))

    def array(element, *shape):
        count = int(np.prod(shape))
        return np.array(draw(st.lists(element, min_size=count, max_size=count))).reshape(shape)

    return Marks(
        object_index=array(st.integers(0, 200), trials),
        success=array(st.booleans(), trials),
        cost=array(number, trials),
        reward=array(number, trials),
        claimed=array(share, trials),
        positive=array(share, trials, n),
        truth=array(st.booleans(), trials, n),
        column=array(st.integers(0, 80), trials, n),
    )


def one():
    return Marks([3], [True], [12.5], [287.5], [0.9], [[0.1, 1 / 3]], [[False, True]], [[4, 7]])


@given(marks=some_marks())
def test_what_is_loaded_equals_what_was_saved(tmp_path_factory, marks):
    path = tmp_path_factory.mktemp("marks") / "some.marks.csv"
    marks.save(path)
    loaded = Marks.load(path)
    for field in fields(Marks):
        expected, found = getattr(marks, field.name), getattr(loaded, field.name)
        assert found.dtype == expected.dtype, field.name
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))
    first = path.read_bytes()
    loaded.save(path)
    assert path.read_bytes() == first
    assert list(path.parent.iterdir()) == [path]


def lines(text):
    return lambda path: path.write_text(text)


DAMAGE = {
    "gone": lambda path: path.unlink(),
    "empty": lines(""),
    "no rows": lambda path: path.write_text(path.read_text().splitlines()[0] + "\n"),
    "half a row": lambda path: path.write_text(path.read_text()[:-20]),
    "not numbers": lambda path: path.write_text(path.read_text().replace("12.5", "much")),
    "bytes": lambda path: path.write_bytes(bytes(range(128, 256))),
    "half a number": lambda path: path.write_text(path.read_text()[:-1]),
    "another table": lines("trial,seconds\n0,1.5\n"),
    "a digit": lambda path: path.write_text(path.read_text().replace("12.5", "12.6")),
    "as wide": lines("a,b,c,d,e,f,g,h\n1,1,1,1,1,1,1,1\n"),
    "a column less": lambda path: path.write_text(
        "\n".join(line.rsplit(",", 1)[0] for line in path.read_text().splitlines()) + "\n"
    ),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_damaged_tables_are_refused(tmp_path, damage):
    path = tmp_path / "some.marks.csv"
    one().save(path)
    damage(path)
    with pytest.raises(LogError, match=r"some.marks.csv.* is not a table of marks .*run again"):
        Marks.load(path)


def test_a_table_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "some.marks.csv"
    one().save(path)
    before = path.read_bytes()

    def torn(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", torn)
    with pytest.raises(OutputError, match=r"some\.marks\.csv cannot be written: No space left"):
        one().save(path)
    assert path.read_bytes() == before


def test_marks_are_the_trials_own_measures(make):
    domain = ("red", "heavy")
    trials = make.trials(8)
    marks = Marks.of(trials, domain)
    assert {trial.report is None for trial in trials} == {True, False}
    for k, trial in enumerate(trials):
        assert marks.object_index[k] == trial.task.object_index
        assert marks.success[k] == trial.success
        assert (marks.cost[k], marks.reward[k]) == (trial.cost, trial.reward)
        best = np.maximum(trial.last_belief.positive, 1 - trial.last_belief.positive)
        assert marks.claimed[k] == pytest.approx(best.prod())
        np.testing.assert_array_equal(marks.positive[k], trial.last_belief.positive)
        np.testing.assert_array_equal(marks.truth[k], trial.truth)
        assert [domain[p] for p in marks.column[k]] == list(trial.task.query.attributes)
