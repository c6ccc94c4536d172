"""The only pickle we read can make numbers, and nothing else happens."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.datasets.label_pickle import read_label_pickle
from meal_bayes.errors import DataError


class Touch:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (str(self.path),)


@pytest.mark.parametrize("protocol", range(3, pickle.HIGHEST_PROTOCOL + 1))
def test_numbers_come_as_they_are(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "labels.pickle"
    table = {0: list(np.int64([1, 0, 1])), 1: list(np.int64([0, 0, 1]))}
    path.write_bytes(pickle.dumps(table, protocol=protocol))
    np.testing.assert_array_equal(read_label_pickle(path, 2, 3), [[1, 0, 1], [0, 0, 1]])


@pytest.mark.parametrize("module", [b"numpy.core.multiarray", b"numpy._core.multiarray"])
def test_both_spellings_of_numpy(tmp_path: Path, module: bytes) -> None:
    path = tmp_path / "labels.pickle"
    data = (
        b"(dp0\nI0\n(lp1\nc" + module + b"\nscalar\n(cnumpy\ndtype\n(S'i8'\nI0\nI1\ntR"
        b"(I3\nS'<'\nNNNI-1\nI-1\nI0\ntbS'\\x01\\x00\\x00\\x00\\x00\\x00\\x00\\x00'\ntRas."
    )
    path.write_bytes(data)
    assert read_label_pickle(path, 1, 1).tolist() == [[1]]
    path.write_bytes(data.replace(b"'<'", b"'>'"))  # the highest byte first is another number
    with pytest.raises(DataError, match="number type"):
        read_label_pickle(path, 1, 1)


def test_hostile_pickle_is_refused_before_it_acts(tmp_path: Path) -> None:
    path, victim = tmp_path / "labels.pickle", tmp_path / "touched"
    hostile = pickle.dumps({0: [Touch(victim)]})
    pickle.loads(hostile)  # it does bite
    assert victim.exists()
    victim.unlink()
    path.write_bytes(hostile)
    with pytest.raises(DataError, match="do not trust the file"):
        read_label_pickle(path, 1, 1)
    assert not victim.exists()


@pytest.mark.parametrize(
    "data",
    [
        b"cposix\nsystem\n(S'true'\ntR.",
        b"cbuiltins\neval\n(S'1'\ntR.",
        b"c__builtin__\ngetattr\n.",
        b"cnumpy\nload\n.",
        b"cnumpy.core.multiarray\n_reconstruct\n.",
        b"Poutside\n.",
        b"cnumpy\ndtype\n(dS'a'\nI1\nsb.",  # states for our stand-ins
        b"cnumpy\ndtype\n(S'O'\ntR.",
        b"cnumpy.core.multiarray\nscalar\n(cnumpy\ndtype\n(S'i8'\ntRS'short'\ntR.",
        b"cnumpy.core.multiarray\nscalar\n(S'i8'\nS'12345678'\ntR.",
        b"",
        b"no pickle at all",
        b"\x80\x05\x95\xff\xff\xff\xff\xff\xff\xff\xff.",
    ],
)
def test_anything_else_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "labels.pickle"
    path.write_bytes(data)
    with pytest.raises(DataError, match="expected a pickle of NumPy integers") as caught:
        read_label_pickle(path, 1, 1)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "table",
    [[], {1: [0]}, {0: [0], 1: [1]}, {0: 0}, {0: [0, 1]}, {0: [2]}, {0: ["1"]}, {0: [[]]}],
)
def test_other_tables_are_refused(tmp_path: Path, table: object) -> None:
    path = tmp_path / "labels.pickle"
    path.write_bytes(pickle.dumps(table))
    with pytest.raises(DataError, match="found"):
        read_label_pickle(path, 1, 1)


def test_absent_pickle(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read"):
        read_label_pickle(tmp_path / "none", 1, 1)
