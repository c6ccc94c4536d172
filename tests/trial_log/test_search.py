"""The log of a search: what is read is what was written; what does not fit is refused."""

import re
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log import (
    Follower,
    check_log,
    log_files,
    log_info,
    read_search,
    read_trials,
    write_trials,
)
from meal_bayes.trial_log.live import SearchLog
from meal_bayes.trial_log.names import TURNS, explored_name
from meal_bayes.trials import Search

NAMES = ("mug", "mug.search", "Mug", "a/b.feedback", "x.recovered")


class Told:
    """A session that is over, of which the log of a search needs its trial alone."""

    def __init__(self, trial):
        self.trial = trial


def write_search(folder, search):
    """Write a search that is over, as a session does."""

    def explore(name, session, path):
        write_trials(path, [session.trial], header={"config": {"object": name}})

    log = SearchLog(folder, {"config": {}, "begun": {}}, explore)
    log.begin_search(search)
    for number, turn in enumerate(zip(search.turns, search.states, strict=True)):
        log.turn(number, *turn)
    for name in dict.fromkeys((*search.turns, *filter(None, [search.claim]))):
        log.explore(name, Told(search.trials[name]))
    log.end_search(search)
    return folder / TURNS


@st.composite
def searches(draw, make):
    """Draw a search among random trials, turned to again and again, or never."""
    names = draw(st.permutations(NAMES))[: draw(st.integers(1, len(NAMES)))]
    trials = make.trials(len(names), draw(st.integers(0, 99)), steps=2, edges=1)
    turns = draw(st.lists(st.sampled_from(names), max_size=6))
    claim = draw(st.none() | st.sampled_from(names))
    states = trials[0].momdp.x_names[:-1]
    explored = {*turns, claim}
    return Search(
        question=draw(st.text(max_size=9).filter(lambda text: text.isprintable())),
        trials={
            name: trial if name in explored else replace(trial, steps=(), report=None)
            for name, trial in zip(names, trials, strict=True)
        },
        turns=tuple(turns),
        claim=claim,
        none=draw(st.floats(-9, 9)),
        turn_cost=draw(st.floats(0, 9)),
        ended=draw(st.sampled_from(("", "cancelled"))),
        states=tuple(draw(st.sampled_from(states)) for _ in turns),
    )


@settings(max_examples=max(settings().max_examples // 5, 5), deadline=None)
@given(data=st.data())
def test_what_is_read_is_what_was_written(data, make, tmp_path_factory):
    folder = tmp_path_factory.mktemp("search")
    search = data.draw(searches(make))
    log = write_search(folder, search)
    assert make.equal(read_search(folder), search)
    assert make.equal(read_search(log), search)
    assert check_log(log).whole
    explored = list(dict.fromkeys((*search.turns, *filter(None, [search.claim]))))
    files = [folder / explored_name(n, name) for n, name in enumerate(explored, start=1)]
    if files:
        assert log_files(folder) == files  # in the order of the turns, and no search among them
        trials = list(read_trials(folder))
        assert [trial.task for trial in trials] == [search.trials[n].task for n in explored]
        assert len(list(Follower(folder).poll())) == len(files)


@settings(max_examples=max(settings().max_examples // 2, 10), deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.none() | st.integers(0, 7))
def test_a_damaged_log_is_refused_or_says_the_same(place, bit, make, tmp_path_factory):
    folder = tmp_path_factory.mktemp("search")
    search = example(make)
    log = write_search(folder, search)
    content = bytearray(log.read_bytes())
    at = int(place * len(content))
    if bit is None:
        del content[at:]
    else:
        content[at] ^= 1 << bit
    log.write_bytes(content)
    if check_log(log).problems:
        with pytest.raises(LogError, match=re.escape(str(log))):
            read_search(folder)
    else:
        assert make.equal(read_search(folder), search)


def example(make, **changes):
    trials = dict(zip(NAMES, make.trials(3, 5, steps=2, edges=1), strict=False))
    trials["Mug"] = replace(trials["Mug"], steps=(), report=None)
    turns = {"turns": ("mug", "mug.search", "mug"), "states": ("x0", "x0", "x0")}
    return Search(**{"question": "red", "trials": trials, **turns, "claim": "mug", **changes})


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"states": ("x0", "x0", "nowhere")}, "turn 2 is not in order, or in no state"),
        ({"turns": ("mug", "mug.search", "")}, "none of its objects"),
        ({"claim": "cup"}, "'cup', which is none of its objects"),
        ({"question": ""}, None),
    ],
)
def test_a_record_that_does_not_fit_is_refused(make, tmp_path, changes, match):
    search = example(make, **changes)
    search.trials["cup"] = search.trials["Mug"]  # is there for the writer alone
    whole = replace(search, trials={name: search.trials[name] for name in NAMES[:3]})
    log = SearchLog(tmp_path, {}, lambda *_: None)
    log.begin_search(whole)
    for number, turn in enumerate(zip(search.turns, search.states, strict=True)):
        log.turn(number, *turn)
    log.end_search(replace(whole, claim=search.claim))
    if match is None:
        assert check_log(log.path).whole
    else:
        with pytest.raises(LogCorruptError, match=match):
            read_search(tmp_path)


def test_trials_of_another_search_are_refused(make, tmp_path):
    write_search(tmp_path, example(make))
    file = tmp_path / explored_name(2, "mug.search")
    (trial,) = read_trials(file)
    write_trials(file, [replace(trial, steps=trial.steps[:1], report=None)], header={})
    with pytest.raises(LogCorruptError, match="the trials beside it cost"):
        read_search(tmp_path)
    other = replace(trial, task=replace(trial.task, key=("other",)))
    write_trials(file, [other], header={})
    with pytest.raises(LogCorruptError, match=r"'mug\.search' beside it is of another search"):
        read_search(tmp_path)
    file.unlink()
    with pytest.raises(LogError, match="There is no log"):
        read_search(tmp_path)
    with pytest.raises(LogError, match="holds no search"):
        read_search(tmp_path / "elsewhere")


def test_what_knows_logs_of_trials_knows_that_a_search_is_none(make, tmp_path):
    log = write_search(tmp_path / "search", example(make))
    assert log_info(log).form == "search"
    assert log_info(log).trials == 0
