"""`meal-bayes find`: what it prints, logs and refuses."""

import contextlib
import html
import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from rerun.chunk import RrdReader

from meal_bayes.cli import main
from meal_bayes.datasets import load_percepts
from meal_bayes.errors import LogCorruptError
from meal_bayes.learner import Learner
from meal_bayes.robots.several import RobotPerObject
from meal_bayes.trial_log import Logs, read_search, read_trials
from meal_bayes.trials.search import explored_rows
from meal_bayes.viewer.labels import plain_text

BOXES = "heavy_blue_beans,light_blue_beans,medium_brown_rice"


def run(*args):
    return CliRunner().invoke(main, list(args))


def test_it_names_the_object_and_logs_what_it_explored(tmp_path):
    options = ("--objects", BOXES, "--agent", "olfc", "--logs", str(tmp_path))
    shown = run("find", "Which one is heavy and blue?", *options)
    assert shown.exit_code == 0, shown.output
    assert "heavy_blue_beans" in shown.stdout
    assert "right" in shown.stdout
    told = json.loads(run("find", "Which one is heavy and blue?", *options, "--json").stdout)
    assert told["search"]["claim"] == "heavy_blue_beans"
    assert told["search"]["success"] is True
    trials = list(read_trials(told["log"]))
    assert [t.task.object_name for t in trials if t.report is not None] == ["heavy_blue_beans"]
    assert len(list(tmp_path.iterdir())) == 2  # a folder a search
    assert content(read_search(told["log"])) == told["search"]
    page = run("log", "show", told["log"])
    assert page.stdout == shown.stdout  # as it was told when it ended
    assert run("log", "show", f"{told['log']}/turns.search.mcap").stdout == shown.stdout
    first = run("log", "show", told["log"], "--trial", "0")
    assert trials[0].task.object_name in first.stdout
    assert "before any behavior" in first.stdout
    assert run("log", "check", told["log"]).exit_code == 0
    log = Path(told["log"], "turns.search.mcap")
    log.write_bytes(log.read_bytes()[:-100])
    assert run("log", "check", told["log"]).exit_code == 1


def test_the_same_command_goes_on_with_a_search_that_was_killed(tmp_path):
    question = "Which one is heavy and blue?"
    names = BOXES.split(",")
    options = ("--objects", BOXES, "--agent", "greedy", "--json", "--logs")
    whole = json.loads(run("find", question, *options, str(tmp_path / "whole")).stdout)
    place = tmp_path / "killed" / Path(whole["log"]).name
    learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    session = learner.begin_find(question, names, log=place)
    robot = learner.replays(session)
    session.turned(robot.turn_to(session.turn))
    session.observe(robot.execute(session.behavior))
    held = run("find", question, *options, str(place.parent))  # while that process goes on
    assert "begins anew" in held.stderr
    assert Path(json.loads(held.stdout)["log"]).name == f"{place.name}-2"
    for recorder in (session._recorder, *(s._recorder for s in session.sessions.values())):
        if recorder is not None:
            recorder._file.close()
    went_on = run("find", question, *options, str(place.parent))
    assert f"going on with {place}" in went_on.stderr
    told = json.loads(went_on.stdout)
    assert (told["search"], told["trials"]) == (whole["search"], whole["trials"])
    assert told["log"] == str(place)
    assert not list(place.glob("*.active"))
    again = json.loads(run("find", question, *options, str(place.parent)).stdout)
    assert Path(again["log"]).name == f"{place.name}-3"


def content(search):
    """Return a search as `find --json` says it."""
    return {
        "question": search.question,
        "claim": search.claim,
        "turns": list(search.turns),
        "success": search.success,
        "cost_s": search.cost,
        "reward": search.reward,
        "ended": search.ended,
    }


def test_a_search_that_explores_nothing_is_logged_too(tmp_path):
    options = ("--objects", BOXES, "--agent", "olfc", "--logs", str(tmp_path))
    shown = run("find", "heavy", *options, "--turn-cost", "1e6")
    assert "none of them" in shown.stdout
    (log,) = tmp_path.rglob("*.mcap")
    assert log.name == "turns.search.mcap"
    assert run("log", "show", str(log.parent)).stdout == shown.stdout
    report = run("report", str(log.parent), "--out", str(tmp_path / "page.html"))
    assert "explored nothing" in report.stderr


def test_a_search_that_ended_in_the_middle_is_shown_as_far_as_it_went(tmp_path):
    learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    session = learner.begin_find("heavy and blue", BOXES.split(","), log=tmp_path)
    session.turned("x0")
    page = run("log", "show", str(tmp_path)).stdout
    assert "none; the log ends here" in page
    assert session.object in page.split("turns")[1]
    session.cancel("the robot is needed elsewhere")
    assert "none; the robot is needed elsewhere" in run("log", "show", str(tmp_path)).stdout


def words_of(page):
    """Return what a report says, without its style."""
    body = page.read_text().partition("<body")[2]
    return re.sub(r"\s+", " ", html.unescape(re.sub("<[^>]*>", " ", body)))


@contextlib.contextmanager
def searching(folder):
    """Begin a search that waits for its first turn, and is shown before it ends."""
    learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    session = learner.begin_find("heavy and green", BOXES.split(","), log=folder)
    robots = {name: learner.replay(each.task) for name, each in session.sessions.items()}
    with session:
        yield session, RobotPerObject(robots)


def shown_texts(recording):
    """Return the texts of a recording, by entity."""
    texts = dict[str, list[str]]()
    for chunk in RrdReader(str(recording)).stream():
        rows = chunk.to_record_batch().to_pydict().get("TextDocument:text", ())
        texts.setdefault(chunk.entity_path, []).extend(row[0] for row in rows)
    return texts


@pytest.mark.parametrize("behaviors", [0, 1, 2])
def test_report_and_view_tell_how_far_a_search_went_that_was_killed(tmp_path, behaviors):
    folder = tmp_path / "search"
    with searching(folder) as (session, robot):
        session.turned(robot.turn_to(session.turn))
        for _ in range(behaviors):
            if session.turn is not None:
                session.turned(robot.turn_to(session.turn))
            session.observe(robot.execute(session.behavior))
        check_shown(session.search, folder, tmp_path)


def check_shown(search, folder, tmp_path):
    """Check what report, view and log tell of a search whose process died, and how it goes on."""
    rows = [" ".join(map(str, row)) for row in explored_rows(search)]
    goes_on = f"Learner.resume_find('{folder}')"
    page = tmp_path / "page.html"
    told = run("report", str(folder), "--out", str(page))
    assert told.exit_code == 0
    assert goes_on in told.stderr
    words = words_of(page)
    assert "Of no search that gave an answer is the truth known" in words
    for text in (*rows, goes_on, "none; the log ends here"):
        assert text in words
    to = tmp_path / "it.rrd"
    assert run("view", str(folder), "--save", str(to)).exit_code == 0
    texts = shown_texts(to)
    (facts,) = texts["/run/facts"]
    for name, _, _, sure in explored_rows(search):
        assert f"|search.believed.{name}|{plain_text(sure)}|" in facts
    assert set(re.findall(BOXES.replace(",", "|"), " ".join(texts["/narration"]))) == set(
        search.turns
    )
    shown = run("log", "show", str(folder))
    assert goes_on in shown.stderr
    assert run("log", "show", str(folder), "--trial", "0").exit_code == 0
    assert run("compare", str(folder)).exit_code != 0  # nothing is measured by it


def test_a_search_that_was_killed_at_once_can_be_checked_and_says_where_it_is_shown(tmp_path):
    with searching(tmp_path):
        for command in (("report",), ("view", "--trial", "0")):
            assert f"meal-bayes log show {tmp_path}" in run(*command, str(tmp_path)).stderr
        assert "turns.search" in run("log", "check", str(tmp_path)).stdout


def test_what_is_recalled_of_a_search_is_what_it_brought_to_its_end(tmp_path):
    with searching(tmp_path) as (session, _):
        session.turned("x0")
        with pytest.raises(LogCorruptError):
            list(Logs(tmp_path).groups())
        shown = [trial.ended for group in Logs(tmp_path).shown() for trial in group.trials]
        assert shown == ["the log ends here"]


def test_an_object_that_a_search_left_is_shown_as_left(logs, tmp_path):
    folder = min(folder for folder in logs.iterdir() if "find" in folder.name)
    search = read_search(folder)
    left = [name for name in dict.fromkeys(search.turns) if name != search.claim]
    assert left
    number = list(dict.fromkeys(search.turns)).index(left[0])
    shown = run("log", "show", str(folder), "--trial", str(number)).stdout
    to = tmp_path / "it.rrd"
    run("view", str(folder), "--save", str(to))
    page = tmp_path / "page.html"
    run("report", str(folder), "--out", str(page))
    texts = shown_texts(to)
    told = " ".join(text for name, rows in texts.items() if "run" not in name for text in rows)
    for text in (shown, told, words_of(page)):
        assert "abstain" not in text
        assert "leave" in text
    for text in (shown, told):
        assert "the search left it" in text
        assert re.search(r"claiming\s+this\s+is\s+worth", text)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """The logs of two searches."""
    folder = tmp_path_factory.mktemp("logs")
    for question in ("Which one is heavy and blue?", "green"):
        run("find", question, "--objects", BOXES, "--agent", "greedy", "--logs", str(folder))
    return folder


def test_a_report_tells_searches_and_measures_no_agent_by_objects_that_were_left(logs, tmp_path):
    found = [read_search(folder) for folder in sorted(logs.iterdir())]
    page = tmp_path / "page.html"
    assert run("report", str(logs), "--out", str(page)).exit_code == 0
    text = re.sub(r"\s+", " ", html.unescape(re.sub("<[^>]*>", " ", page.read_text())))
    assert "2 of 2 searches whose truth is known were right" in text
    assert "earns" not in text.partition(" Searches ")[0]
    for search in found:
        row = [search.question, search.claim or "none of them", "right", ", ".join(search.turns)]
        assert " ".join([*row, f"{search.cost:.1f}"]) in re.sub(
            "; not to [^.]* (?=[0-9])", " ", text
        )
    assert not re.search(r" (Agents|Attributes|The worst trials) ", text)
    # Beside the trials of a lab, these alone measure the agent.
    lab = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    trial = lab.ask("heavy", "heavy_blue_beans", log=logs / "lab" / "a.mcap")
    assert run("report", str(logs), "--out", str(page)).exit_code == 0
    text = html.unescape(re.sub("<[^>]*>", " ", page.read_text()))
    assert f"greedy earns {trial.reward:.1f} a trial, and is right in 100.0% of 1 trials" in text


def test_the_viewer_shows_a_search_in_the_order_of_its_turns(logs, tmp_path):
    folder = min(folder for folder in logs.iterdir() if "find" in folder.name)
    search = read_search(folder)
    for options, shown in (((), set(search.turns)), (("--trial", "1"), {search.turns[1]})):
        to = tmp_path / "it.rrd"
        assert run("view", str(folder), *options, "--save", str(to)).exit_code == 0
        texts = shown_texts(to)
        (facts,) = texts["/run/facts"]
        assert f"|search.turns|{', '.join(search.turns)}|" in facts
        assert f"|search.answer|{search.claim or 'none of them'}|" in facts
        told = " ".join(text for entity in texts if "run" not in entity for text in texts[entity])
        named = re.findall("|".join(search.trials), told)
        assert set(named) == shown
        assert [name for name in dict.fromkeys(search.turns) if name in shown] == list(
            dict.fromkeys(named)
        )


@pytest.mark.parametrize(
    ("args", "match"),
    [
        (("--objects", "heavy_blue_beans,heavy_blue_beans"), "listed twice"),
        (("--objects", "cup"), "cup"),
        (("--objects", BOXES, "--none", "900"), "nothing would be searched"),
        (("--objects", BOXES, "--agent", "random"), "compares no values"),
        ((), "--objects"),
    ],
)
def test_wrong_input_is_one_line(tmp_path, args, match):
    done = run("find", "heavy", *args, "--logs", str(tmp_path))
    assert done.exit_code == 2
    assert match in done.stderr
    assert "Traceback" not in done.output
    assert not list(tmp_path.rglob("*.mcap"))
