"""Files that are no log of ours, by every door that reads logs: one text, with no false advice."""

import json
import shutil
from pathlib import Path

import pytest
from mcap.writer import Writer

from meal_bayes.domain import load_domain
from meal_bayes.errors import LogCorruptError, LogVersionError
from meal_bayes.learner import Learner, recall
from meal_bayes.trial_log import (
    FORMAT_VERSION,
    Follower,
    Logs,
    check_log,
    log_info,
    read_outcomes,
    read_trials,
    salvage,
    write_trials,
)
from meal_bayes.trial_log.file import FULL, PROFILES

HEADER = {"config": {"dataset": "roc36", "agents": ["greedy"]}, "seed": 4}
SAYS = "is no log of meal_bayes: {}; give a .mcap file that it wrote"
PROFILE = "it is another program's MCAP file, of profile 'ros2'"
TOPIC = "it is another program's MCAP file, of topic '/imu'"
COMMANDS = {
    "info": ("log", "info"),
    "show": ("log", "show"),
    "recover": ("log", "recover"),
    "view": ("view", "--save", "a.rrd"),
    "report": ("report", "--out", "a.html"),
    "compare": ("compare",),
}
READERS = {
    "log_info": log_info,
    "read_trials": lambda path: list(read_trials(path)),
    "read_outcomes": read_outcomes,
    "salvage": lambda path: list(salvage(path)),
    "Logs": lambda path: list(Logs(path).trials()),
    "recall": lambda path: recall(Learner(load_domain("roc36"), logs=None), path),
}


def another_program(path, *, profile="ros2", chunked=True, topic="/imu"):
    """Write an MCAP file as other programs do."""
    with path.open("wb") as file:
        other = Writer(file, use_chunking=chunked, chunk_size=500)
        other.start(profile)
        number = other.register_schema("sensor_msgs/Imu", "jsonschema", b"{}")
        channel = other.register_channel(topic, "json", number)
        for i in range(200):
            other.add_message(channel, i, json.dumps({"a": i}).encode(), i)
        other.finish()
    return path


def torn(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


FOREIGN = {  # how a file is written, and what it is
    "of a profile": (another_program, PROFILE),
    "of a profile, torn": (lambda path: torn(another_program(path)), PROFILE),
    "without": (lambda path: another_program(path, profile=""), TOPIC),
    "without, torn": (lambda path: torn(another_program(path, profile="")), TOPIC),
    "without chunks": (lambda path: another_program(path, profile="", chunked=False), TOPIC),
    "without chunks, torn": (
        lambda path: torn(another_program(path, profile="", chunked=False)), TOPIC,
    ),
    "of a topic like ours": (
        lambda path: another_program(path, profile="", chunked=False, topic="/step"),
        TOPIC.replace("imu", "step"),
    ),
    "a text": (lambda path: path.write_text("hello world"), "it is no MCAP file, as it begins with "
               "b'hello wo'"),
    "zeros": (lambda path: path.write_bytes(bytes(100_000)), "it is no MCAP file, as it begins "
              "with b'\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00'"),
    "empty": (lambda path: path.write_bytes(b""), "it is empty"),
}  # fmt: skip


def told(output):
    """Return an output without the breaks of its lines."""
    return " ".join(output.split())


@pytest.fixture
def file(run):
    return Path("a.mcap")


@pytest.mark.quick(20)
@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_says_whose_a_file_is(fails, file, command, kind):
    write, what = FOREIGN[kind]
    write(file)
    text = told(fails(*COMMANDS[command], file))
    assert f"a.mcap {SAYS.format(what)}" in text
    assert text.count("a.mcap") == 1
    assert "recover" not in text
    assert [path.name for path in Path().iterdir()] == ["a.mcap"]


@pytest.mark.quick(20)
@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.parametrize("reader", READERS)
def test_a_reader_says_whose_a_file_is(file, reader, kind):
    write, what = FOREIGN[kind]
    write(file)
    with pytest.raises(LogCorruptError) as caught:
        READERS[reader](file)
    assert f"a.mcap {SAYS.format(what)}" in str(caught.value)
    assert "recover" not in str(caught.value)


@pytest.mark.parametrize("kind", FOREIGN)
def test_a_check_says_whose_a_file_is(run, file, kind):
    write, what = FOREIGN[kind]
    write(file)
    done = run("log", "check", file)
    assert done.exit_code == 1
    assert "no log of meal_bayes" in done.stdout
    assert what in told(done.stdout)
    assert "recover" not in done.stdout
    facts = json.loads(run("log", "check", file, "--json").stdout)
    assert (facts["ours"], facts["problems"]) == (False, [what])


@pytest.mark.parametrize("kind", FOREIGN)
def test_a_run_with_another_file_in_its_folder_is_read(run, trials, kind):
    write, what = FOREIGN[kind]
    write_trials("run/b.mcap", trials, header=HEADER)
    write(Path("run/a.mcap"))
    logs = Logs("run")
    assert len(list(logs.trials())) == len(trials)
    assert logs.problems == [f"run/a.mcap {SAYS.format(what)}"]
    done = run("log", "show", "run", "--trial", "2")
    assert done.exit_code == 0


@pytest.mark.parametrize("kind", ["of a profile", "a text"])
def test_another_file_is_not_followed(file, kind):
    write, what = FOREIGN[kind]
    write(file)
    follower = Follower(file)
    assert list(follower.poll()) == []
    assert follower.problems == [f"a.mcap {SAYS.format(what)}"]
    assert follower.finished


@pytest.mark.parametrize("command", ["info", "recover"])
@pytest.mark.parametrize("profile", ["", "ros2"])
def test_nothing_is_advised_where_nothing_of_a_run_is_left(fails, file, command, profile):
    another_program(file, profile=profile)
    file.write_bytes(file.read_bytes()[:20])  # in the header
    text = told(fails(*COMMANDS[command], file))
    assert "the file ends before its closing records; expected a .mcap file that" in text
    assert "log recover" not in text


def test_a_draft_without_a_byte_is_a_log_to_come(file):
    draft = file.with_name("a.mcap.active")
    draft.touch()
    info = check_log(draft)
    assert info.ours
    assert info.problems[0] == "the file ends before its closing records"


def of_later_form(path, trials, monkeypatch):
    monkeypatch.setitem(PROFILES, FULL, "meal_bayes/pictures")
    write_trials(path, trials, header=HEADER)
    monkeypatch.undo()


def of_later_format(path, trials, monkeypatch):
    monkeypatch.setattr("meal_bayes.trial_log.file.FORMAT_VERSION", FORMAT_VERSION + 1)
    write_trials(path, trials, header=HEADER)
    monkeypatch.undo()


LATER = {
    of_later_form: "was written as 'meal_bayes/pictures', which this meal_bayes does not know",
    of_later_format: f"log format {FORMAT_VERSION + 1}, this meal_bayes reads format "
    f"{FORMAT_VERSION}",
}


@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize("write", LATER, ids=lambda write: write.__name__)
def test_a_log_of_a_later_version_is_named_by_every_door(fails, trials, tmp_path, cut, write):
    with pytest.MonkeyPatch.context() as monkeypatch:
        write(tmp_path / "a.mcap", trials, monkeypatch)
    file = Path("a.mcap")
    if cut:
        file.write_bytes(file.read_bytes()[: file.stat().st_size * 3 // 4])
    for command in (*COMMANDS.values(), ("log", "check")):
        text = told(fails(*command, file))
        assert LATER[write] in text
        assert "read it with the version that wrote it" in text
        assert "recover" not in text
    for read in READERS.values():
        with pytest.raises(LogVersionError):
            read(file)


def test_a_torn_log_of_ours_still_says_how_it_is_saved(run, fails, trials):
    write_trials("b.mcap", trials, header=HEADER)
    shutil.copy("b.mcap", "a.mcap")
    torn(Path("a.mcap"))
    assert "save its whole trials with: meal-bayes log recover a.mcap" in told(
        fails("log", "info", "a.mcap")
    )
