"""One check of features, for every door: what is no array of finite numbers is a `DataError`."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays, scalar_dtypes

from meal_bayes.datasets import checked_features
from meal_bayes.errors import DataError

SCALARS = st.one_of(
    st.floats(), st.integers(), st.booleans(), st.none(), st.text(), st.binary(),
    st.complex_numbers(), st.decimals(), st.fractions(), st.datetimes(),
)  # fmt: skip
NESTED = st.recursive(SCALARS, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner))
ARRAYS = arrays(scalar_dtypes(), array_shapes(min_dims=0, max_dims=3, min_side=0))


class Raises:
    def __array__(self, *_, **__):
        raise RuntimeError("the camera is gone")


@given(NESTED | ARRAYS)
def test_anything_becomes_finite_features_or_a_data_error(values):
    try:
        features = checked_features(values)
    except DataError:
        return
    assert features.dtype == np.float32
    assert features.ndim == 1
    assert len(features) >= 1
    assert np.isfinite(features).all()
    np.testing.assert_array_equal(features, np.asarray(values, float).astype(np.float32))


@given(st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=1))
def test_features_are_a_copy(numbers):
    values = np.array(numbers, np.float32)
    features = checked_features(values)
    values[:] = 7
    np.testing.assert_array_equal(features, np.array(numbers, np.float32))


@given(st.lists(st.sampled_from(["there", "absent", "torn"]), max_size=5), st.integers(1, 3))
def test_only_whole_recordings_are_absent(kinds, size):
    rows = np.ones((len(kinds), size))
    rows[[kind == "absent" for kind in kinds]] = math.nan
    rows[[kind == "torn" for kind in kinds], 0] = math.inf
    axes = "recordings", "features"
    if "torn" in kinds:
        number = kinds.index("torn") + 1
        with pytest.raises(DataError, match=f"found NaN or infinity, recording {number};"):
            checked_features(rows, axes, absent=True)
    else:
        np.testing.assert_array_equal(checked_features(rows, axes, absent=True), rows)


def test_what_an_object_raises_is_told():
    with pytest.raises(DataError, match="the camera is gone") as told:
        checked_features(Raises())
    assert isinstance(told.value.__cause__, RuntimeError)
