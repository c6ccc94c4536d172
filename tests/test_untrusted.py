"""What others wrote is read within limits, whatever it claims."""

import os
import tracemalloc

import pytest

from meal_bayes.cli.console import printable
from meal_bayes.untrusted import DEPTH_LIMIT, JSON_LIMIT, read_bytes, read_json


@pytest.mark.parametrize("depth", [DEPTH_LIMIT + 1, 900, 50_000, 1_000_000])
@pytest.mark.parametrize(("left", "inside", "right"), [("[", "", "]"), ('{"a":', "1", "}")])
def test_deep_json_is_refused(depth, left, inside, right):
    with pytest.raises(ValueError, match=r"nested more than|more than 4,194,304"):
        read_json(left * depth + inside + right * depth)


def test_json_comes_back():
    read_json("[" * DEPTH_LIMIT + "]" * DEPTH_LIMIT)
    assert read_json('{"a": [1, 2.5, null, true, "x"]}') == {"a": [1, 2.5, None, True, "x"]}
    assert read_json(b'"\xc3\xa9"') == "\N{LATIN SMALL LETTER E WITH ACUTE}"


@pytest.mark.parametrize(
    "text",
    ["NaN", "-1e999", '{"\\udfff": 1}', "9" * 5000, "[1", "", b"\xff", " " * (JSON_LIMIT + 1)],
)
def test_json_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match=r"."):
        read_json(text)


def test_a_file_of_a_terabyte_asks_for_no_memory(tmp_path):
    path = tmp_path / "sparse"
    path.write_bytes(b"a = 1\n")
    os.truncate(path, 1 << 40)
    tracemalloc.start()
    with pytest.raises(ValueError, match="1,099,511,627,776 bytes, more than"):
        read_bytes(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1 << 20


def test_a_hole_in_a_text_is_told(tmp_path):
    path = tmp_path / "hole"
    path.write_bytes(b"a = 1\n")
    os.truncate(path, 1000)
    with pytest.raises(ValueError, match="a zero byte at 6"):
        read_bytes(path)


def test_what_may_never_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/zero")
    for name in ("pipe", "device"):
        with pytest.raises(ValueError, match="no regular file"):
            read_bytes(tmp_path / name)
    with pytest.raises(IsADirectoryError):
        read_bytes(tmp_path)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("mug", "mug"),
        (
            "m\N{LATIN SMALL LETTER U WITH DIAERESIS}g\nline",
            "m\N{LATIN SMALL LETTER U WITH DIAERESIS}g\nline",
        ),
        ("\x1b[2J", "\N{SYMBOL FOR ESCAPE}[2J"),
        (
            "\a\r\t\0",
            "\N{SYMBOL FOR BELL}\N{SYMBOL FOR CARRIAGE RETURN}"
            "\N{SYMBOL FOR HORIZONTAL TABULATION}\N{SYMBOL FOR NULL}",
        ),
        (
            "\x9b31m\x7f\N{RIGHT-TO-LEFT OVERRIDE}\udc80",
            "\N{REPLACEMENT CHARACTER}31m" + "\N{REPLACEMENT CHARACTER}" * 3,
        ),
    ],
)
def test_names_are_made_printable(text, shown):
    assert printable(text) == shown
