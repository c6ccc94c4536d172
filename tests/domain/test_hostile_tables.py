"""Domain tables that ask for memory, time or trust; and those that editors begin with a mark."""

import os

import pytest

from meal_bayes.domain import load_domain
from meal_bayes.errors import DomainError, SettingsError
from meal_bayes.untrusted import LARGEST

TABLE = """
name = "own"
attributes = ["red"]
behaviors = [{ name = "look", cost = 1, modalities = ["color"] }]
[diagram]
states = ["here"]
start = "here"
effects = [{ from = "*", do = "look", to = "*" }]
"""


@pytest.fixture
def load(tmp_path):
    """Return a function that loads a table from its text or bytes."""

    def write(content):
        data = content.encode() if isinstance(content, str) else content
        (tmp_path / "own.toml").write_bytes(data)
        return load_domain(tmp_path / "own.toml")

    return write


def test_a_byte_order_mark_and_line_ends_of_windows_are_read(load):
    domain = load(TABLE)
    assert load(b"\xef\xbb\xbf" + TABLE.encode()) == domain
    assert load(TABLE.replace("\n", "\r\n")) == domain


def large(states, behaviors):
    """Make a table of so many."""
    rows = "\n".join(f'[[behaviors]]\nname = "b{i}"\ncost = 1' for i in range(behaviors))
    effects = "\n".join(
        f'[[diagram.effects]]\nfrom = "*"\ndo = "b{i}"\nto = "*"' for i in range(behaviors)
    )
    names = ", ".join(f'"s{i}"' for i in range(states))
    head = 'name = "own"\nattributes = ["red"]'
    return f'{head}\n{rows}\n[diagram]\nstates = [{names}]\nstart = "s0"\n{effects}'


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (f"x = {'[' * 4000}{']' * 4000}", "nested too deeply"),
        ("x = " + "{a=" * 2000 + "1" + "}" * 2000, "nested too deeply"),
        (f"{'.'.join('a' * 6000)} = 1", "a line of 12,003 characters"),
        ("a = 1\n" * 60_000, "bytes, more than 262,144"),
        (b"name = 1\n" + bytes(100), "a zero byte at 9"),
        (b"name = '\xff'", "not valid TOML"),
        (TABLE.replace("cost = 1", f"cost = {'9' * 5000}"), "not valid TOML"),
        (TABLE.replace("cost = 1", f"cost = {LARGEST * 2:.0f}"), "0 to 1e\\+06"),
        (TABLE.replace('"red"', f'"{"r" * 300}"'), "300 characters"),
        (TABLE.replace('"red"', '"  "'), "all blank"),
        ("report_reward = 1e100\n" + TABLE, "from 0 to 1e\\+06"),
        ("legal_budget = []\n" + TABLE, "at least one"),
        ("legal_budget = [inf]\n" + TABLE, "at least one finite"),
        ("asked_minimum = 1.7\n" + TABLE, "a whole number"),
        (large(1001, 1), "1001 states; expected at most 1000"),
        (large(300, 300), "more than 1,000,000 entries"),
    ],
    ids=range(16),
)
def test_what_no_table_needs_is_refused(load, content, found):
    with pytest.raises(DomainError, match=found):
        load(content)


def test_files_that_never_end_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(DomainError, match="no regular file"):
        load_domain(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(SettingsError, match="cannot be read"):
        load_domain(tmp_path / "folder.toml")
