"""SARSOP's .policy is read as it is meant; as hostile input it can do nothing."""

import numpy as np
import pytest

from meal_bayes.errors import DataError, SettingsError
from meal_bayes.planners.point_based.policy_file import read_policy

POLICY = """<?xml version="1.0" encoding="ISO-8859-1"?>
<Policy version="0.1" type="value" model="own.pomdpx"
 xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="policyx.xsd">
<AlphaVector vectorLength="3" numObsValue="2" numVectors="3">
<Vector action="4" obsValue="0">-1.5 2 3e+02 </Vector>
<Vector action="0" obsValue="1">0 0.125 -0 </Vector>
<SparseVector action="2" obsValue="1"><Entry>2 7.5</Entry><Entry>0 -1</Entry></SparseVector>
</AlphaVector> </Policy>
"""
BOMB = '<!DOCTYPE a [<!ENTITY b "bbbbbbbb"><!ENTITY c "&b;&b;&b;&b;">]>'


def read(text, folder):
    path = folder / "out.policy"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
    return read_policy(path)


def test_dense_and_sparse_vectors(tmp_path):
    alpha = read(POLICY, tmp_path)
    np.testing.assert_array_equal(
        alpha.vectors, [[-1.5, 2.0, 300.0], [0.0, 0.125, 0.0], [-1.0, 0.0, 7.5]]
    )
    np.testing.assert_array_equal(alpha.action, [4, 0, 2])
    np.testing.assert_array_equal(alpha.x, [0, 1, 1])


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (("<Policy ", f"{BOMB}<Policy "), "document type"),
        (("<Policy ", '<!DOCTYPE a SYSTEM "file:///etc/passwd"><Policy '), "document type"),
        (("-1.5", "&c;"), "entity"),
        (("<Policy ", "<Policies "), "<Policies> stands where it does not belong"),
        (('type="value"', 'type="graph"'), "expected a policy of the type 'value'"),
        (('vectorLength="3"', ""), "vectorLength is ''"),
        (('vectorLength="3"', 'vectorLength="-3"'), "vectorLength is '-3'"),
        (('vectorLength="3"', 'vectorLength="4"'), "vector 1 has 3 values; expected 4"),
        (('vectorLength="3"', 'vectorLength="2"'), "3 values; expected 2"),
        (('vectorLength="3"', 'vectorLength="99999999"'), "at most 33554432 numbers"),
        (('vectorLength="3"', 'vectorLength="0"'), "at most 33554432 numbers"),
        (('numVectors="3"', 'numVectors="999999999"'), "at most 33554432 numbers"),
        (('numVectors="3"', 'numVectors="4"'), "found 3 vectors; it promises 4"),
        (('numVectors="3"', 'numVectors="2"'), "more vectors, or observed values"),
        (('numObsValue="2"', 'numObsValue="1"'), "more vectors, or observed values"),
        (('action="4"', 'action="four"'), "action is 'four'"),
        (('action="4"', 'action="9999999999"'), "action is '9999999999'"),
        (("-1.5 2", "-1.5 nan"), "expected 3 finite ones"),
        (("-1.5 2", "-1.5 much"), "could not convert"),
                (("-1.5 2", "<Vector/>"), "<Vector> stands where"),
        (("<Entry>2 7.5", "<Entry>3 7.5"), "index 3"),
        (("<Entry>2 7.5", "<Entry>-1 7.5"), "place of a value is '-1'"),
        (("<Entry>2 7.5", "<Entry>2 inf"), "vector 3 .*finite"),
        (("<Entry>2 7.5", "<Entry>2"), "not enough values"),
        (("</AlphaVector>", ""), "mismatched tag"),
        (("</AlphaVector> ", '</AlphaVector><AlphaVector vectorLength="1" numObsValue="1" '
          'numVectors="1"/>'), "more than one"),
        ((POLICY[:40], ""), "syntax error|not well-formed"),
    ],
)  # fmt: skip
def test_a_damaged_policy_is_told(tmp_path, change, found):
    assert change[0] in POLICY
    with pytest.raises(DataError, match=found) as told:
        read(POLICY.replace(*change, 1), tmp_path)
    assert "is no policy of SARSOP" in str(told.value)


@pytest.mark.parametrize("text", ["", "lower bound 3", "\0" * 100, "<Policy/>", "<Policy"])
def test_no_policy_is_told(tmp_path, text):
    with pytest.raises(DataError, match="is no policy of SARSOP"):
        read(text, tmp_path)


def test_no_file_and_a_huge_one_are_told(tmp_path):
    with pytest.raises(SettingsError, match="No file"):
        read_policy(tmp_path / "none.policy")
    with (tmp_path / "own.policy").open("wb") as file:
        file.truncate(2**29)
    with pytest.raises(DataError, match="268,435,456"):
        read_policy(tmp_path / "own.policy")


def test_any_bytes_are_read_or_refused(tmp_path):
    rng, whole, refused = np.random.default_rng(0), POLICY.encode(), 0
    for _ in range(300):
        damaged = bytearray(whole)
        for place in rng.integers(len(whole), size=rng.integers(1, 4)):
            damaged[place] = rng.choice(list(b' <>/"=&;0-.V\n\xff'))
        try:
            assert np.isfinite(read(bytes(damaged), tmp_path).vectors).all()
        except DataError:
            refused += 1
    assert 100 < refused < 300
