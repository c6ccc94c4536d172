"""Domain tables: what they load, come back as, and refuse; those of others within limits."""

import json
import os
import re
import tomllib
from pathlib import Path

import pytest

from meal_bayes.domain import domain_from_table, domain_names, domain_table, load_domain, tables
from meal_bayes.errors import DomainError, SettingsError
from meal_bayes.untrusted import LARGEST

TABLE = """
name = "mine"
attributes = ["red", "heavy"]
synonyms = { crimson = "red" }
behaviors = [
    { name = "look", cost = 1.0, modalities = ["color"] },
    { name = "lift", cost = 5, modalities = ["haptics"] },
]
[diagram]
states = ["x0", "x1"]
start = "x0"
effects = [
    { from = "x0", do = "look", to = "x0" },
    { from = "x0", do = "lift", to = "x1", probability = 0.9 },
]
"""


def load(folder, content, name="mine.toml"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_domain(path)


def test_a_byte_order_mark_and_line_ends_of_windows_are_read(tmp_path):
    domain = load(tmp_path, TABLE)
    assert load(tmp_path, b"\xef\xbb\xbf" + TABLE.encode()) == domain
    assert load(tmp_path, TABLE.replace("\n", "\r\n")) == domain


@pytest.mark.parametrize("name", domain_names())
def test_shipped_tables_load_and_come_back_equal_through_json(name):
    domain = load_domain(name)
    assert domain.name == name
    assert domain.data == name.removesuffix("_published")
    assert domain_from_table(json.loads(json.dumps(domain_table(domain)))) == domain


def test_costs_of_the_illustrative_cy101_trials():
    domain = load_domain("cy101")
    cost = {behavior.name: behavior.cost for behavior in domain.behaviors}
    early = ("look", "grasp", "lift_slow", "hold", "hold")
    assert sum(cost[name] for name in early) == pytest.approx(55.5)
    assert cost["look"] + cost["crush"] == pytest.approx(22.5)


def test_one_table_extends_another(tmp_path):
    load(tmp_path, TABLE)
    child = load(tmp_path, 'extends = "mine.toml"\nname = "child"\nreport_reward = 7', "child.toml")
    assert (child.name, child.report_reward, child.attributes) == ("child", 7.0, ("red", "heavy"))
    child = load(tmp_path, 'extends = "toy"\nname = "t"')
    assert child.behavior_names == ("look", "lift", "reinit")


def test_a_dictionary_is_a_table(tmp_path):
    table = tomllib.loads(TABLE)
    assert load_domain(table) == load(tmp_path, TABLE)
    assert load_domain({**table, "attributes": ("red", "heavy")}) == load(tmp_path, TABLE)
    child = load_domain({"extends": str(tmp_path / "mine.toml"), "name": "child"})
    assert child.attributes == ("red", "heavy")
    with pytest.raises(DomainError, match="Unknown key 'wings'"):
        load_domain({**table, "wings": 2})


def test_a_circle_of_tables_is_refused(tmp_path):
    (tmp_path / "a.toml").write_text('extends = "b.toml"')
    with pytest.raises(DomainError, match="extends itself"):
        load(tmp_path, 'extends = "a.toml"', "b.toml")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("cost = 5, ", "", "behavior 'lift' has no 'cost'; add it"),
        ("cost = 5", "cost = -5", "costs -5.0; give its seconds, 0 to"),
        ("cost = 5", "cost = inf", "costs inf; give its seconds"),
        ("cost = 5", "cost = '5'", "cost = '5'; expected a number"),
        ('["red", "heavy"]', '["red", "red"]', "'red' is listed twice"),
        ('["red", "heavy"]', '"red"', "attributes = 'red'; expected a list of texts"),
        ('["red", "heavy"]', "[]", "needs at least one attribute"),
        ('do = "lift"', 'do = "fly"', "uses behavior 'fly', which has no entry"),
        ('name = "lift"', 'name = "look"', "behavior 'look' is listed twice"),
        ("cost = 5", "cost = 5, coast = 1", "Unknown key 'coast': did you mean 'cost'"),
        ("cost = 5", "cost = 5, answer_accuracy = 1.2", "answer_accuracy 1.2; expected"),
        ('"red" }', '"rad" }', "name 'rad', which is no attribute"),
        ("crimson =", "heavy =", "The word 'heavy' stands for"),
        ('crimson = "red"', "crimson = 1", "crimson = 1; expected a text"),
        ("[diagram]", "[diagrams]", "has no 'diagram'; add it"),
        ("effects = [", "effects = [ 1,", r"expected rows"),
        ('name = "mine"', 'name = "mine"\npredefined = ["poke"]', "'poke', which is no behavior"),
        ('name = "mine"', "name = ", "is not valid TOML"),
        ('name = "mine"', 'name = "mine"\nreport_reward = 1e100', r"at most 1e\+06"),
        ('name = "mine"', 'name = "mine"\nreport_reward = 0', "a number above 0"),
        ('name = "mine"', 'name = "mine"\nlegal_budget = []', "at least one"),
        ('name = "mine"', 'name = "mine"\nlegal_budget = [inf]', "at least one finite"),
        ('name = "mine"', 'name = "mine"\nasked_minimum = 1.7', "a whole number"),
        ("cost = 5", f"cost = {'9' * 5000}", "not valid TOML"),
        ("cost = 5", f"cost = {LARGEST * 2:.0f}", r"0 to 1e\+06"),
        ('["red", "heavy"]', f'["{"r" * 300}"]', "300 characters"),
        ('["red", "heavy"]', '["  "]', "blanks at its ends"),
        ("]\n[diagram]", '{ name = "poke", cost = 1 }]\n[diagram]', "'poke' is legal in no state"),
    ],
)
def test_bad_tables_teach_in_one_line(tmp_path, old, new, says):
    assert TABLE.count(old) >= 1
    with pytest.raises(DomainError, match=says) as caught:
        load(tmp_path, TABLE.replace(old, new, 1))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (None, "found NoneType"),
        ({}, "has no 'name'"),
        ({"diagram": []}, "expected a table"),
        ({"behaviors": [{"name": "look", "cost": 10**400}]}, "expected a number. int too large"),
        ({"behaviors": [{"name": "look", "cost": float("nan")}]}, "costs nan"),
    ],
)
def test_values_that_make_no_domain_are_told(table, says):
    whole = domain_table(load_domain("toy"))
    with pytest.raises(DomainError, match=says):
        domain_from_table({**whole, **table} if table else table)


def large(states, behaviors):
    """Make a table of so many."""
    names = [f"b{i}" for i in range(behaviors)]
    rows = "\n".join(f'[[behaviors]]\nname = "{name}"\ncost = 1' for name in names)
    effects = "\n".join(
        f'[[diagram.effects]]\nfrom = "*"\ndo = "{name}"\nto = "*"' for name in names
    )
    diagram = f'[diagram]\nstates = {[f"s{i}" for i in range(states)]}\nstart = "s0"'
    return f'name = "own"\nattributes = ["red"]\n{rows}\n{diagram}\n{effects}'


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (f"x = {'[' * 4000}{']' * 4000}", "nested too deeply"),
        ("x = " + "{a=" * 2000 + "1" + "}" * 2000, "nested too deeply"),
        (f"x = {'[' * 40}{']' * 40}", "nested too deeply"),  # no parser minds
        (f"{'.'.join('a' * 6000)} = 1", "a line of 12,003 characters"),
        ("a = 1\n" * 60_000, "bytes, more than 262,144"),
        (b"name = 1\n" + bytes(100), "a zero byte at 9"),
        (b"name = '\xff'", "not valid TOML"),
        (large(1001, 1), "1001 states; expected at most 1000"),
        (large(300, 300), "more than 1,000,000 entries"),
    ],
    ids=range(9),
)
def test_what_no_table_needs_is_refused(tmp_path, content, says):
    with pytest.raises(DomainError, match=says):
        load(tmp_path, content)


def test_files_that_never_end_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(SettingsError, match="no regular file"):
        load_domain(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(SettingsError, match="cannot be read"):
        load_domain(tmp_path / "folder.toml")


def test_unknown_names_suggest_the_nearest(tmp_path):
    with pytest.raises(SettingsError, match="did you mean 'roc36'"):
        load_domain("rock36")
    with pytest.raises(SettingsError, match=r"cannot be read .*; give the path of a domain table"):
        load_domain(tmp_path / "none.toml")
    with pytest.raises(DomainError, match="did you mean 'grasp'"):
        load_domain("roc36").behavior_index("grsp")


@pytest.mark.parametrize("place", ["the site", "the module"])
def test_every_key_is_documented(place):
    page = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "own-data.md"
    text = page.read_text(encoding="utf-8") if place == "the site" else tables.__doc__
    kinds = (
        tables._DOMAIN_KEYS, tables._DIAGRAM_KEYS, tables._BEHAVIOR_KEYS, tables._EFFECT_KEYS,
    )  # fmt: skip
    keys = {key for group in kinds for key in group}
    sign = "`" if place == "the site" else ""
    absent = {key for key in keys if not re.search(rf"{sign}\[?{key}\b\]?{sign}", text)}
    assert absent == set()


def test_states_have_words_for_people():
    for name in domain_names():
        diagram = load_domain(name).diagram
        words = diagram.labels or diagram.states[:-1]
        assert not [word for word in words if re.fullmatch(r"x\d+", word)], name
    table = domain_table(load_domain("toy"))
    for labels, message in (
        (["in hand"], r"expected one for each of \['x0', 'x1'\]"),
        (["in hand", "in hand"], "Two states have the label 'in hand'"),
        (["in hand", "a\nb"], "rename it"),
    ):
        wrong = {**table, "diagram": {**table["diagram"], "labels": labels}}
        with pytest.raises(DomainError, match=message):
            domain_from_table(wrong)
