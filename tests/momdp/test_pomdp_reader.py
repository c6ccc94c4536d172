"""Every form of the .pomdp format is read; what is damaged is refused with its line."""

import numpy as np
import pytest

from meal_bayes.errors import DataError, SettingsError
from meal_bayes.momdp import FlatPOMDP
from meal_bayes.momdp.pomdp_reader import read_pomdp

TIGER = """
# the tiger of Cassandra, Kaelbling and Littman
discount: 0.95
values: reward
states: tiger-left tiger-right
actions: listen open-left open-right
observations: tiger-left tiger-right
start: uniform

T:listen
identity
T:open-left
uniform
T:open-right
uniform

O:listen
0.85 0.15
0.15 0.85
O:open-left
uniform
O:open-right
uniform

R:listen : * : * : * -1
R:open-left : tiger-left : * : * -100
R:open-left : tiger-right : * : * 10
R:open-right : tiger-left : * : * 10
R:open-right : tiger-right : * : * -100
"""


def read(text, folder) -> FlatPOMDP:
    (folder / "own.pomdp").write_text(text)
    return read_pomdp(folder / "own.pomdp")


def test_tiger(tmp_path):
    tiger = read(TIGER, tmp_path)
    assert tiger.state_names == ("tiger-left", "tiger-right")
    assert tiger.discount == 0.95
    np.testing.assert_array_equal(tiger.transition[0], np.eye(2))
    np.testing.assert_array_equal(tiger.transition[1:], 0.5)
    np.testing.assert_array_equal(tiger.observation[0], [[[0.85, 0.15], [0.15, 0.85]]] * 2)
    np.testing.assert_array_equal(tiger.observation[1:], 0.5)
    np.testing.assert_array_equal(tiger.reward, [[-1, -100, 10], [-1, 10, -100]])
    np.testing.assert_array_equal(tiger.start, 0.5)


def test_every_form_of_the_format(tmp_path):
    text = """discount : 0.5 values:cost states: 3 actions: go stay observations: 2
    start exclude: 1
    T: * : * : 0 1.0   # all to 0 ...
    T: go : 1   0.25 0.25
        0.5
    T: 1 identity
    O: * uniform
    O: go : 2
    0.9 0.1
    O: stay : 0 : 1 1.0   O: stay : 0 : 0 0
    R: * : * : * : * 2
    R: go : 1 : 2 : 1 +10
    R: go : 1 : 1    4 6
    R: stay : 2  1 1  1 1  3 5
    """
    made = read(text, tmp_path)
    np.testing.assert_array_equal(made.transition[0], [[1, 0, 0], [0.25, 0.25, 0.5], [1, 0, 0]])
    np.testing.assert_array_equal(made.transition[1], np.eye(3))
    np.testing.assert_array_equal(made.observation[0, 0], [[0.5, 0.5], [0.5, 0.5], [0.9, 0.1]])
    np.testing.assert_array_equal(made.observation[1, 2], [[0, 1], [0.5, 0.5], [0.5, 0.5]])
    expected = 0.25 * 2 + 0.25 * 5 + 0.5 * (0.9 * 2 + 0.1 * 10)
    np.testing.assert_allclose(made.reward, [[-2, -2], [-expected, -2], [-2, -4]])
    np.testing.assert_array_equal(made.start, [0.5, 0, 0.5])
    for start, belief in (
        ("start: 1", [0, 1, 0]),
        ("start: 0.5 0.25 0.25", [0.5, 0.25, 0.25]),
        ("start include: 0 2", [0.5, 0, 0.5]),
        ("start: uniform", [1 / 3] * 3),
    ):
        again = read(text.replace("start exclude: 1", start), tmp_path)
        np.testing.assert_array_equal(again.start, belief)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (("discount: 0.95", ""), "no discount"),
        (("discount: 0.95", "discount: nan"), "statement of line 3: found 1 numbers; expected 1"),
        (("states: tiger-left tiger-right", ""), "names no states"),
        (("states: tiger-left", "states: tiger-right"), "line 5: states: expected 1 to"),
        (("states: tiger-left tiger-right", "states: 9999"), "more than 1e\\+07 entries"),
        (("states: tiger-left tiger-right", "states: 999999999999999"), "states; expected 1 to"),
        (("states: tiger-left tiger-right", "states: 0"), "0 states; expected 1 to"),
        (("start: uniform", "start: 0.5 0.4"), "start must be probabilities"),
        (("start: uniform", "start: tiger-left tiger-right"), "expected a state"),
        (("start: uniform", "start exclude: 0 1"), "no state is left"),
        (("values: reward", "values: gold"), "expected reward or cost"),
        (("identity", "0.5 0.5 1"), "found 3 numbers; expected 4"),
        (("identity", "0.5 0.4 0 1"), "rows of T must be probabilities"),
        (("identity", "1.5 -0.5 0 1"), "rows of T must be probabilities"),
        (("identity", ""), "found 0 numbers; expected 4"),
        (("0.85 0.15\n", "0.85 inf\n"), "expected 4 finite ones"),
        (("0.85 0.15\n", "0.85 much\n"), "expected 4 numbers"),
        (("T:listen", "T:sing"), "line 10: 'sing' is none of the 3 actions"),
        (("T:listen", "T:listen :"), "T lacks one of its states|'identity' is none of the"),
        (("O:listen", "T:listen"), "rows of O|found 4 numbers"),
        (("* -1", "* -1 2"), "found 2 numbers; expected 1"),
        (("R:listen", "states: 4\nR:listen"), "line 25: states stands behind"),
        (("# the", "the tiger\n#"), "found 'the tiger'; expected one of"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_told_with_its_line(tmp_path, change, found):
    assert change[0] in TIGER
    with pytest.raises(DataError, match=found):
        read(TIGER.replace(*change, 1), tmp_path)


def test_no_file_and_no_text_are_told(tmp_path):
    with pytest.raises(SettingsError, match="No file"):
        read_pomdp(tmp_path / "none.pomdp")
    (tmp_path / "own.pomdp").write_bytes(b"\xff\xfe\x00" * 100)
    with pytest.raises(DataError):
        read_pomdp(tmp_path / "own.pomdp")
    with pytest.raises(DataError, match="line 1 has more than"):
        read("states: " + "x " * 2**20, tmp_path)
    with (tmp_path / "own.pomdp").open("wb") as file:
        file.truncate(2**27)
    with pytest.raises(DataError, match="more than 64 MB"):
        read_pomdp(tmp_path / "own.pomdp")


def test_short_statements_cannot_keep_a_reader_busy(tmp_path, monkeypatch):
    monkeypatch.setattr("meal_bayes.momdp.pomdp_reader._ASSIGNED", 1000)
    with pytest.raises(DataError, match="set more than 1e\\+03 entries"):
        read(TIGER + "T: * : * : * 0.5\n" * 100, tmp_path)


def test_any_bytes_are_read_or_refused(tmp_path):
    rng, path, whole = np.random.default_rng(0), tmp_path / "own.pomdp", TIGER.encode()
    refused = 0
    for _ in range(300):
        damaged = bytearray(whole)
        for place in rng.integers(len(whole), size=rng.integers(1, 4)):
            damaged[place] = rng.choice(list(b" :#*0-.Tn\n\xffidentity"))
        path.write_bytes(bytes(damaged[: rng.integers(1, len(whole) + 1)]))
        try:
            assert np.isfinite(read_pomdp(path).reward).all()
        except DataError:
            refused += 1
    assert 100 < refused < 300
