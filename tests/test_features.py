"""Features of signals: the obvious value at the edges, or one line."""

import io
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as drawn
from PIL import Image

from meal_bayes.domain import domain_from_table, domain_table, load_domain
from meal_bayes.errors import DataError, DomainError, SettingsError
from meal_bayes.features import (
    Recorder,
    color_histogram,
    extract,
    read_message,
    spectrogram_bins,
    temporal_bins,
)


def lab(feature="temporal_bins", **more):
    source = {"topic": "/wrist", "feature": feature, **more}
    return load_domain({"extends": "toy", "sources": {"haptics": source}})


def message(kind, **fields):
    return type(kind, (SimpleNamespace,), {})(**fields)


def test_bins_are_means_by_time():
    values = np.arange(40.0).reshape(20, 2)
    expected = values.reshape(5, 4, 2).mean(axis=1).T.ravel()
    assert temporal_bins(values, 5).tolist() == expected.tolist()
    assert temporal_bins([7.0], 3).tolist() == [7, 7, 7]
    # A gap: three samples in the first second, one in the last; between them a line.
    assert temporal_bins([0, 0, 0, 4], 3, times=[0, 0.1, 0.2, 3]).tolist() == [0, 2, 4]


def test_a_tone_is_where_it_sounds():
    moments = np.arange(8000) / 8000
    power = spectrogram_bins(np.sin(2 * np.pi * 2500 * moments), 8000, 4, 5).reshape(4, 5)
    assert (power.argmax(axis=0) == 2).all()
    assert spectrogram_bins(np.zeros(100), 8000).tolist() == [-10.0] * 100
    assert np.isfinite(spectrogram_bins([0.5], 8000)).all()


def test_gray_is_three_equal_colors():
    gray = np.array([[0, 255]], np.uint8)
    histogram = color_histogram(gray, 2)
    assert histogram[[0, 7]].tolist() == [0.5, 0.5]
    assert color_histogram(gray / 255, 2).tolist() == histogram.tolist()
    assert color_histogram([np.dstack([gray] * 3)] * 2, 2).tolist() == histogram.tolist()


@given(
    drawn.arrays(float, drawn.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5)),
    st.sampled_from([temporal_bins, lambda x: spectrogram_bins(x, 100), color_histogram]),
)
def test_any_array_gives_numbers_or_one_line(array, function):
    with np.errstate(all="ignore"):
        try:
            made = function(array)
        except DataError:
            return
        assert np.isfinite(made).all() or np.abs(array).max() > 1e100


def test_joints_are_in_the_order_of_their_names():
    source = {"fields": ["effort"]}
    first = message("JointState", name=["b", "a"], effort=[2.0, 1.0])
    names, values = read_message(source, first)
    assert (names, values.tolist()) == (("effort[a]", "effort[b]"), [[1, 2]])
    assert read_message({"fields": ["effort[b]"]}, first)[1].tolist() == [[2]]
    for fault in ("effort[c]", "force", "effort[5]"):
        with pytest.raises(DataError, match=fault.partition("[")[0]):
            read_message({"fields": [fault]}, first)


def test_messages_of_common_types():
    vector = SimpleNamespace(x=1.0, y=2.0, z=3.0)
    wrench = message("WrenchStamped", wrench=SimpleNamespace(force=vector, torque=vector))
    assert read_message({}, wrench)[1].tolist() == [[1, 2, 3, 1, 2, 3]]
    imu = message("Imu", linear_acceleration=vector, angular_velocity=vector)
    assert len(read_message({}, imu)[0]) == 6
    assert read_message({}, message("Float64MultiArray", data=[4.0, 5.0]))[1].tolist() == [[4, 5]]
    sound = message("AudioData", data=np.array([0, 64], np.uint8))
    assert read_message({}, sound)[1].tolist() == [0.5]
    data = np.array([1, 2, 3, 0], np.uint8)  # a row of one pixel, padded to four bytes
    image = message("Image", height=1, width=1, step=4, encoding="bgr8", is_bigendian=0, data=data)
    assert read_message({}, image)[1].tolist() == [[[[3, 2, 1]]]]
    with pytest.raises(DataError, match="PointCloud2"):
        read_message({}, message("PointCloud2"))


def test_of_a_large_image_few_pixels_are_kept():
    """Every n-th row and column, as a minute of images is gigabytes; 0 keeps all."""
    data = np.repeat(np.arange(200, dtype=np.uint8), 200)
    fields = {"encoding": "mono8", "is_bigendian": 0, "data": data}
    image = message("Image", height=200, width=200, step=200, **fields)
    assert read_message({}, image)[1][0, :, 0, 0].tolist() == list(range(0, 200, 2))
    assert read_message({"pixels": 400}, image)[1].shape == (1, 20, 20, 3)
    assert read_message({"pixels": 0}, image)[1].shape == (1, 200, 200, 3)


def test_a_compressed_image_is_read_or_one_line():
    file = io.BytesIO()
    Image.new("RGB", (2, 1), (9, 8, 7)).save(file, "PNG")
    packed = message("CompressedImage", data=np.frombuffer(file.getvalue(), np.uint8))
    assert read_message({}, packed)[1].tolist() == [[[[9, 8, 7]] * 2]]
    for size in (0, 20, 45):
        packed.data = np.frombuffer(file.getvalue()[:size], np.uint8)
        with pytest.raises(DataError, match="compressed image"):
            read_message({}, packed)


def test_sources_are_a_part_of_the_domain():
    domain = lab(settings={"bins": 2})
    assert domain_from_table(domain_table(domain)) == domain
    assert "sources" not in domain_table(load_domain("toy"))
    with pytest.raises(DomainError, match="smell"):
        load_domain({"extends": "toy", "sources": {"smell": {"topic": "/a", "feature": "f"}}})
    with pytest.raises(DomainError, match="feature"):
        load_domain({"extends": "toy", "sources": {"haptics": {"topic": "/a"}}})
    with pytest.raises(DomainError, match="bin"):
        Recorder(lab(settings={"bin": 2}), "lift")
    with pytest.raises(SettingsError, match="temporal_bins"):
        Recorder(lab("temporal_bin"), "lift")
    with pytest.raises(DomainError, match="color"):
        Recorder(lab(), "look")


def test_a_function_of_ones_own_is_given_times():
    def slope(values, times):
        return (values[-1] - values[0]) / (times[-1] - times[0])

    recorder = Recorder(lab("slope", fields=["data"]), "lift", {"slope": slope})
    for second in range(3):
        recorder.add("/wrist", second * 10**9, SimpleNamespace(data=[2.0 * second]))
        recorder.add("/other", second, SimpleNamespace())
    assert recorder.features()["haptics"].tolist() == [2.0]


def test_a_fault_is_raised_or_noted():
    recorder = Recorder(lab(fields=["data"]), "lift")
    recorder.add("/wrist", 0, SimpleNamespace(data=[np.nan]))
    with pytest.raises(DataError, match="/wrist: nan"):
        recorder.features()
    faults = []
    assert extract(lab(), "lift", {}, on_fault=lambda *fault: faults.append(fault)) == {}
    assert faults[0][0] == "haptics"
