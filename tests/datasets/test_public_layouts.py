"""The published layouts, in small and as they are: joins and repairs."""

import logging

import numpy as np
import pytest

from meal_bayes.datasets import load_dataset
from meal_bayes.domain import domain_names, load_domain
from meal_bayes.errors import DataError


def test_cy101_joins_and_repairs(cy101, caplog):
    with caplog.at_level(logging.INFO, logger="meal_bayes.datasets"):
        dataset = load_dataset(cy101 / "own.toml", root=cy101)
    assert dataset.objects == ("ball_t", "can", "bear")  # no_object is left out
    np.testing.assert_array_equal(dataset.labels, [[1, 0, 0], [0, 1, 0], [1, 0, 1]])
    color = dataset.features["look", "color"]
    np.testing.assert_array_equal(color[:, :, 0], [[1, 2, 3, 129, 5], [11, 11, 13, 14, 15],
                                                   [21, 22, 23, 24, 25]])  # fmt: skip
    told = "added 2^31 to the count of ball_t_t4 in look_color.txt, line 12, feature 1"
    assert told in caplog.text


def test_ispy32_trial_number_is_no_feature(ispy32):
    dataset = load_dataset(ispy32 / "own.toml", root=ispy32)
    expected = [[[o + 0.5, k] for k in range(1, 6)] for o in (1, 2)]
    np.testing.assert_array_equal(dataset.features["look", "rgb"], expected)
    np.testing.assert_array_equal(dataset.labels, [[1, 1], [0, 0]])  # light, heavy
    np.testing.assert_array_equal(dataset.answers, [[-1, 1], [-1, 0]])  # of the second rater


def test_roc36_recordings_in_file_order(roc36):
    dataset = load_dataset(roc36 / "own.toml", root=roc36)
    expected = [[[o, k] for k in range(10)] for o in (0, 1)]
    np.testing.assert_array_equal(dataset.features["look", "patch"], expected)
    np.testing.assert_array_equal(dataset.labels, [[1, 0, 1, 1, 0], [0, 1, 0, 0, 1]])


def test_folder_without_recordings(roc36, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="expected shiqizhang6/perception_pomdp/"):
        load_dataset(roc36 / "own.toml", root=tmp_path / "empty")


def test_clone_of_the_repository_serves(roc36):
    clone = roc36 / "clone" / "data" / "icra2014"
    clone.mkdir(parents=True)
    for name in ("objects.txt", "sensorimotor_features"):
        (roc36 / name).rename(clone / name)
    assert load_dataset(roc36 / "own.toml", root=roc36 / "clone").recordings == 10


BROKEN = [
    ("cy101", "normalized_data_without_noobject/tap_flow.txt", "bear_t3", "bear3",
     r"tap_flow.txt, line 13: found object 'bear3'; expected"),
    ("cy101", "cy101_labels.csv", "bear,", "beer,", "found no row of object 'bear'"),
    ("ispy32", "corl_features/look_rgb.txt", "2,4,2.5,4", "3,4,2.5,4",
     r"look_rgb.txt, line 7: found object '3'; expected an object"),
    ("ispy32", "object_list.csv", "pineapple_cup", "pineaple_cup", "did you mean 'pineapple_cup'"),
    ("roc36", "sensorimotor_features/look-patch.txt", "heavy_blue_beans,1,9",
     "light_brown_rice,1,9", r"line 20: found recording '11' of light_brown_rice"),
    ("roc36", "own.toml", '"rice"', '"rise"', "did you mean 'rice'"),
    ("cy101", "cy101_labels.csv", "bear,", "ball_t,", "line 3: found object 'ball_t' again"),
    ("cy101", "cy101_labels.csv", '"soft, round"', "soft, round", "line 2: found 3 columns"),
    ("cy101", "own.toml", '"can"', '"cane"', "did you mean 'can'"),
    ("ispy32", "object_list.csv", "cup,2", "cup,3", "line 2: found .*cup,3'; expected name,2"),
    ("ispy32", "labels.csv", "heavy,1.0", "heavy,0.5", r"labels.csv, line 2: found 'heavy,0.5,"),
    ("ispy32", "labels.csv", "predicate,1,2", "predicate,1,3", "line 1: found other columns"),
    ("ispy32", "own.toml", '"light"', '"lights"', "did you mean 'light'"),
    ("roc36", "objects.txt", "heavy_blue_beans", "light_brown_rice", "line 2: found object 'light"),
    ("roc36", "objects.txt", "heavy_blue_beans", "beans", "expected weight_color_content"),
]  # fmt: skip


@pytest.mark.parametrize(("data", "name", "old", "new", "expected"), BROKEN)
def test_broken_files_are_told(
    request, change, data, name, old, new,
    expected,
):  # fmt: skip
    folder = request.getfixturevalue(data)
    change(folder / name, old, new)
    with pytest.raises(DataError, match=expected) as caught:
        load_dataset(folder / "own.toml", root=folder)
    assert "\n" not in str(caught.value)


def test_ispy32_without_heavy_and_light(ispy32, change):
    change(ispy32 / "own.toml", '"light", "heavy"', '"pineapple"')
    assert load_dataset(ispy32 / "own.toml", root=ispy32).labels.tolist() == [[0], [1]]


def test_file_of_one_column(roc36):
    (roc36 / "sensorimotor_features" / "look-patch.txt").write_text("light_brown_rice 1 2\n")
    with pytest.raises(DataError, match=r"line 1: .* 2 \(object and the features, separated"):
        load_dataset(roc36 / "own.toml", root=roc36)


def test_folder_in_a_file_s_place(roc36):
    (roc36 / "objects.txt").unlink()
    (roc36 / "objects.txt").mkdir()
    with pytest.raises(DataError, match=r"objects.txt: cannot be read"):
        load_dataset(roc36 / "own.toml", root=roc36)


@pytest.fixture(scope="module")
def loaded(recordings):
    return {name: load_dataset(name, root=recordings) for name in ("roc36", "ispy32", "cy101")}


@pytest.mark.long
@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "shape", "features"),
    [
        ("roc36", (36, 10, 10, 22), {("look", "color"): 76, ("lift_slow", "audio"): 50}),
        ("ispy32", (32, 81, 5, 27), {("look", "fc7"): 4096, ("grasp", "haptics"): 60}),
        ("cy101", (100, 10, 5, 48), {}),
    ],
)
def test_sizes_of_the_recordings(loaded, name, shape, features):
    data = loaded[name]
    assert (*data.labels.shape, data.recordings, len(data.features)) == shape
    for context, size in features.items():
        assert data.features[context].shape == (shape[0], shape[2], size)


@pytest.mark.long
@pytest.mark.real_data
def test_labels_and_repairs_of_the_recordings(loaded):
    roc36, ispy32, cy101 = loaded.values()
    assert roc36.labels.sum(axis=0).tolist() == [12] * 6 + [9] * 4
    for members in roc36.domain.groups.values():
        assert (roc36.labels[:, roc36.domain.columns(members)].sum(axis=1) == 1).all()
    first = roc36.instance(0, "look", 2).features["color"]
    np.testing.assert_allclose(first[:2], [0.16385252, -11.10606688])
    positive = ispy32.labels.sum(axis=0)
    least = ispy32.domain.asked_minimum
    assert ((positive > least) & (32 - positive > least)).sum() == 37
    assert np.isclose(ispy32.features["grasp", "haptics"][0, 0, 0], 0.163382)
    both = ispy32.labels[:, ispy32.domain.columns(("heavy", "light"))].all(axis=1)
    assert (np.flatnonzero(both) + 1).tolist() == [22, 24]
    cup = ispy32.objects.index("pineapple_cup")
    assert ispy32.labels[cup, ispy32.domain.attribute_index("pineapple")] == 1
    assert "no_object" not in cy101.objects
    assert cy101.labels.sum(axis=0).tolist() == [17, 25, 23, 36, 42, 35, 32, 16, 21, 20]
    color = cy101.features["look", "color"]
    assert color.min() == 0
    assert color[cy101.objects.index("smallstuffedanimal_moose"), 1, 82] == 129
    ball = cy101.objects.index("ball_base")
    assert np.isclose(cy101.features["push", "flow"][ball, 0, 0], 48.434673258635215)


@pytest.mark.long
@pytest.mark.real_data
def test_published_domains_read_the_same_recordings(recordings, loaded):
    published = load_dataset("roc36_published", root=recordings)
    assert published.domain == load_domain("roc36_published")
    for context, values in published.features.items():
        np.testing.assert_array_equal(values, loaded["roc36"].features[context])
    homes = {load_domain(name).data for name in domain_names() if name.endswith("_published")}
    assert homes == {"roc36", "ispy32", "cy101"}
