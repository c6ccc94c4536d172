"""What the viewer gets of a trial: entities and rows."""

import dataclasses
import random
import threading
import warnings
from collections import Counter

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from rerun.chunk import RrdReader

from meal_bayes.cli import main
from meal_bayes.domain import Query
from meal_bayes.evaluation import summarize
from meal_bayes.robots.robot import Frame
from meal_bayes.trial_log import TrialWriter, read_trials, write_trials
from meal_bayes.trial_log.messages import StepMessage, TrialMessage, decode
from meal_bayes.trials import Task, TrialOutcomes
from meal_bayes.viewer import replay, write_recording

TIMELINES = {"trial", "step", "sim_time"}


@pytest.fixture(scope="module")
def messages(log):
    """The log's own numbers, by MCAP's reader: for each trial its start and its steps."""
    trials = []
    with log.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if channel.topic == "/trial":
                trials.append((decode(message.data, TrialMessage), []))
            elif channel.topic == "/step":
                trials[-1][1].append(decode(message.data, StepMessage))
    return trials


def series(recorded, entity, column):
    """Values of an entity by (trial, step)."""
    rows = recorded[entity]
    return dict(zip(zip(rows["trial"], rows["step"], strict=True), rows[column], strict=True))


def starts(messages):
    """First row of each trial: rows of the trials before it, and one free row behind each."""
    first = 0
    for start, steps in messages:
        yield first, start, steps
        first += len(steps) + 2


def test_beliefs_entropy_and_cost_are_the_logs(messages, recorded):
    compared = 0
    entropy = series(recorded, "/entropy", "Scalars:scalars")
    times = series(recorded, "/entropy", "sim_time")
    before = 0.0
    cost = series(recorded, "/cost", "Scalars:scalars")
    for first, start, steps in starts(messages):
        spent = 0.0
        for row, message in enumerate([start, *steps]):
            key = (start.trial, first + row)
            assert times[key].total_seconds() == pytest.approx(before)  # when a step began
            spent += message.cost if row else 0.0
            before += message.cost if row else 0.0
            for name, p in zip(start.attributes, message.belief.positive, strict=True):
                logged = series(recorded, f"/belief/{name}", "Scalars:scalars")[key]
                assert logged == pytest.approx([p], abs=1e-12)
                compared += 1
            bits = sum(
                -x * np.log2(x) for p in message.belief.positive for x in (p, 1 - p) if x > 0
            )
            assert entropy[key] == pytest.approx([bits], abs=1e-9)
            assert cost[key] == pytest.approx([spent])
        free = (start.trial, first + len(steps) + 1)  # where lines break
        assert np.isnan(entropy[free] + cost[free]).all()
    assert compared > 30
    assert len(entropy) == sum(len(steps) + 2 for _, steps in messages)


def test_what_going_on_is_worth_is_the_log_s(messages, recorded):
    values = series(recorded, "/expected_reward/worth", "Measurements:values")
    variances = series(recorded, "/expected_reward/worth", "Measurements:variances")
    compared = 0
    for first, start, steps in starts(messages):
        for row, step in enumerate(steps, start=1):
            key = (start.trial, first + row)
            *behaviors, answer = step.values
            if np.isnan(behaviors).all():
                assert np.isnan(values[key]).all()
                continue
            best = int(np.nanargmax(behaviors))
            assert values[key] == pytest.approx([behaviors[best] - answer])
            errors = np.nan_to_num([step.value_se[best], step.value_se[-1]])
            assert variances[key] == pytest.approx([np.square(errors).sum()])
            compared += 1
    assert compared > 10


def test_lanes_words_and_graphs_tell_the_step(messages, recorded, trials):
    action = series(recorded, "/lanes/action", "StateChange:state")
    where = series(recorded, "/lanes/state", "StateChange:state")
    narration = series(recorded, "/narration", "TextDocument:text")
    labels = series(recorded, "/diagram/nodes", "GraphNodes:labels")
    asked = {name for trial in trials for name, _ in trial.task.query.questions}
    lanes = {path.removeprefix("/lanes/") for path in recorded if path.startswith("/lanes/")}
    assert lanes == {"action", "state"} | asked
    for (first, start, steps), trial in zip(starts(messages), trials, strict=True):
        for row, step in enumerate(steps, start=1):
            key = (start.trial, first + row)
            report = step.action == trial.momdp.n_behaviors
            assert action[key] == ["answer" if report else step.action_name]
            states = [*trial.momdp.x_labels, "end"]
            assert where[key] == [states[step.next_x]]
            assert f"trial {start.trial}, step {row}:" in narration[key][0]
            assert set(labels[key]) >= set(trial.momdp.x_labels)
        verdict = "**right**" if trial.success else "**WRONG"
        assert trial.report is None or verdict in narration[start.trial, first + len(steps)][0]
        assert "now it would answer" in narration[start.trial, first][0]


def test_measures_of_the_run_count_every_trial(trials, recorded):
    agents = {trial.agent for trial in trials}
    (table,) = recorded["static /run/table"]["TextDocument:text"][-1]
    for agent in agents:
        of_agent = [trial for trial in trials if trial.agent == agent]
        accuracy = recorded[f"/run/accuracy/{agent}"]["Measurements:values"]
        right = np.cumsum([trial.success for trial in of_agent])
        assert np.ravel(accuracy) == pytest.approx(right / np.arange(1, len(of_agent) + 1))
        variance = recorded[f"/run/accuracy/{agent}"]["Measurements:variances"][-1]
        (row,) = summarize(of_agent)  # one error bar on all pages
        expected = 0.0 if np.isnan(row.accuracy_se) else row.accuracy_se**2
        assert variance == pytest.approx([expected], abs=1e-9)
        cost = recorded[f"/run/cost/{agent}"]["Measurements:values"][-1]
        assert cost == pytest.approx([np.mean([trial.cost for trial in of_agent])])
        assert f"|{agent}|" in table
    for entity, columns in recorded.items():
        assert entity.startswith("static ") or set(columns) >= TIMELINES, entity
    facts = "".join(map(str, recorded["static /run/facts"]["TextDocument:text"]))
    assert "roc36" in facts
    assert "a b  c" in facts  # signs of Markdown are taken out


def test_one_trial_alone_and_the_measures_of_all(trials, log, read_back, tmp_path):
    path = tmp_path / "one.rrd"
    assert write_recording(read_trials(log), path, {}, only=2) == len(trials)
    rows = read_back(path)
    steps = len(trials[2].steps)
    assert rows["/entropy"]["step"] == list(range(steps + 2))
    assert set(rows["/entropy"]["trial"]) == {2}
    measured = sum(len(rows[f"/run/cost/{a}"]["step"]) for a in {t.agent for t in trials})
    assert measured == len(trials)


def test_equal_logs_give_equal_rows(log, tmp_path):
    """However rerun divides the rows into chunks, which is up to its threads and their timing."""
    values = []
    for path in (tmp_path / "a.rrd", tmp_path / "b.rrd"):
        write_recording(read_trials(log), path, {})
        cells = Counter()
        for chunk in RrdReader(str(path)).stream():
            if chunk.entity_path == "/__properties":  # when it was made
                continue
            for row in chunk.to_record_batch().to_pylist():
                times = repr([row.get(timeline) for timeline in sorted(TIMELINES)])
                cells.update(
                    (chunk.entity_path, times, column, repr(value))
                    for column, value in row.items()
                    if value is not None and column not in {*TIMELINES, "rerun.controls.RowId"}
                )
        values.append(cells)
    assert values[0]
    assert values[0] == values[1]


def test_compact_logs_show_their_run(trials, recorded, read_back, tmp_path):
    """The measures are those of the whole trials; there are no steps."""
    path = tmp_path / "compact.rrd"
    assert write_recording([TrialOutcomes.of(trials)], path, {}) == len(trials)
    rows = read_back(path)
    for agent in {trial.agent for trial in trials}:
        for entity in (f"/run/accuracy/{agent}", f"/run/cost/{agent}"):
            for column in ("Measurements:values", "Measurements:variances", "trial"):
                assert rows[entity][column] == recorded[entity][column]
    table = "static /run/table"
    assert rows[table]["TextDocument:text"][-1] == recorded[table]["TextDocument:text"][-1]
    assert not any(entity.startswith("/belief") for entity in rows)


def test_strange_names_break_nothing(trials, read_back, tmp_path):
    trial = trials[0]
    strange = ("a/b|c`*#\n", "<b>&$x$")
    query = Query(strange)
    momdp = dataclasses.replace(
        trial.momdp,
        query=query,
        x_names=tuple(f"x/{i}|" for i in range(len(trial.momdp.x_names))),
        x_labels=tuple(f"x{i}|" for i in range(trial.momdp.terminal)),
        behavior_names=tuple(f"do: {i}/*" for i in range(trial.momdp.n_behaviors)),
    )
    task = Task("t", query, 0, "object| # <i>", ("k",))
    odd = dataclasses.replace(trial, task=task, agent="agent / #1", momdp=momdp)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_recording([odd, odd], tmp_path / "odd.rrd", {"a/b": {"c": ["x", None]}})
    rows = read_back(tmp_path / "odd.rrd")
    assert len([entity for entity in rows if entity.startswith("/belief/")]) == 2
    text = rows["/narration"]["TextDocument:text"][0][0]
    assert "<b>" not in text
    assert "`" not in text


def test_trials_are_sent_as_they_land(trials, read_back, tmp_path, monkeypatch, eventually):
    path = tmp_path / "run.mcap"
    saved = tmp_path / "seen.rrd"
    monkeypatch.setattr(replay, "_POLL", 0.01)
    seen = []
    landed = threading.Event()

    def write():
        with TrialWriter(path, {"seed": 1}) as log:
            for number, trial in enumerate(trials):
                log.write(trial)
                eventually(lambda number=number: seen[-1:] == [number + 1])
        landed.set()

    writer = threading.Thread(target=write)
    writer.start()
    follower = replay.follow(path, saved, watching=lambda: True, on_trials=seen.append)
    writer.join()
    assert seen == [1, 2, 3, 4]  # each was seen before the next was written
    assert follower.finished
    assert follower.problems == []
    assert landed.is_set()
    rows = read_back(saved)
    assert len(rows["/entropy"]["step"]) == sum(len(trial.steps) + 2 for trial in trials)


def test_it_ends_when_nobody_watches(tmp_path, monkeypatch):
    monkeypatch.setattr(replay, "_POLL", 0.01)
    answers = iter([True, True, False])
    path = tmp_path / "to come.mcap"
    follower = replay.follow(path, tmp_path / "none.rrd", watching=lambda: next(answers))
    assert not follower.finished


def damaged(data, number):
    rng = random.Random(f"damage {number}")
    if number % 2:
        return data[: rng.randrange(len(data))]
    changed = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


@pytest.mark.long
def test_view_and_report_open_what_can_be_opened(trials, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "a.mcap"
    codes = []
    view = ["view", "a.mcap", "--save", "a.rrd"]
    write_trials(path, trials, header={"seed": 1})
    data = path.read_bytes()
    assert "warning" not in CliRunner().invoke(main, view).stderr
    for number in range(16):
        path.write_bytes(damaged(data, number))
        for words in (view, ["report", "a.mcap"])[: 1 + (number % 8 < 2)]:  # which takes longer
            result = CliRunner().invoke(main, words)
            codes.append(result.exit_code)
            if result.exit_code == 0:
                assert "warning: a.mcap: " in result.stderr, (number, result.stderr)
            else:
                assert result.exit_code == 2, (number, words, result.output, result.exception)
                assert result.stderr.count("\n") == 1
                assert result.stderr.startswith("error: ")
    assert codes.count(0) > 8
    assert 2 in codes


def frame(seconds):
    rng = np.random.default_rng(int(seconds * 10))
    shapes = np.array([Frame.SOLID, *[Frame.SHELL] * 2, *[Frame.BALL] * 3], np.int8)
    half = np.full((6, 3), 0.5, np.float32)
    contacts = 2 * int(seconds > 0)
    return Frame(
        seconds, rng.normal(size=(6, 3)).astype(np.float32), half / 5,
        np.tile(np.array([0, 0, 0, 1], np.float32), (6, 1)), half, shapes,
        np.zeros((2, 3), np.float32)[:contacts],
        np.array([[0.0, 0.0, 3.0], [0.0, 4.0, 0.0]], np.float32)[:contacts],
        np.full((4, 6, 3), 0.5, np.float32),
    )  # fmt: skip


@pytest.fixture(scope="module")
def watched(trials, read_back, tmp_path_factory):
    trial = trials[0]
    frames = [frame(seconds) for seconds in np.arange(0.0, trial.cost + 1e-9, 0.5)]
    path = tmp_path_factory.mktemp("robot") / "robot.rrd"
    assert write_recording([trial], path, {}, frames=frames) == 1
    return trial, frames, read_back(path)


def test_every_frame_is_in_the_row_of_its_step(watched):
    trial, frames, rows = watched
    load = rows["/robot/forces"]
    ends = np.cumsum([step.cost for step in trial.steps])
    assert len(load["step"]) == len(frames)
    for frame, step in zip(frames, load["step"], strict=True):
        expected = 0 if frame.seconds == 0 else 1 + int((ends < frame.seconds - 1e-6).sum())
        assert step == min(expected, len(trial.steps))


def test_bodies_and_forces_are_the_frames(watched):
    _, frames, rows = watched
    shells = rows["/robot/object"]["Boxes3D:centers"]
    balls = rows["/robot/content"]["Points3D:positions"]
    for frame, boxes, points in zip(frames, shells, balls, strict=True):
        np.testing.assert_allclose(boxes, frame.centers[frame.shapes == Frame.SHELL])
        np.testing.assert_allclose(points, frame.centers[frame.shapes == Frame.BALL])
    assert len(rows["/robot/forces"]["Arrows3D:vectors"][1]) == 2


def test_a_trial_without_frames_shows_no_robot(trials, read_back, tmp_path):
    write_recording([trials[0]], tmp_path / "plain.rrd", {})
    assert not any(entity.startswith("/robot") for entity in read_back(tmp_path / "plain.rrd"))
