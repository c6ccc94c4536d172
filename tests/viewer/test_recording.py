"""What stands in an .rrd file is what stands in the MCAP file it was made of."""

import dataclasses
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from mcap.reader import make_reader
from rerun.chunk import RrdReader

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp
from meal_bayes.trial_log import read_trials
from meal_bayes.trial_log.schema import OutcomeMessage, StepMessage, TrialMessage
from meal_bayes.trials import Task, Trial, TrialOutcomes
from meal_bayes.viewer import write_recording
from meal_bayes.viewer.pictures import truth_rows

TIMELINES = {"trial", "step", "sim_time"}
KINDS = {"/trial": TrialMessage, "/step": StepMessage, "/outcome": OutcomeMessage}


@pytest.fixture(scope="module")
def messages(log):
    """The log's own numbers, by MCAP's reader: for each trial its start, steps, and outcome."""
    found = []
    with log.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if channel.topic == "/trial":
                found.append((TrialMessage.FromString(message.data), [], []))
            elif channel.topic == "/step":
                found[-1][1].append(StepMessage.FromString(message.data))
            elif channel.topic == "/outcome":
                found[-1][2].append(OutcomeMessage.FromString(message.data))
    return found


def series(recorded, entity, column):
    """Values of an entity by (trial, step)."""
    rows = recorded[entity]
    return dict(zip(zip(rows["trial"], rows["step"], strict=True), rows[column], strict=True))


def starts(messages):
    """First row of each trial: rows of the trials before it, and one free row behind each."""
    first = 0
    for start, steps, _ in messages:
        yield first, start, steps
        first += len(steps) + 2


def test_beliefs_entropy_and_cost_are_the_logs(messages, recorded):
    compared = 0
    entropy = series(recorded, "/entropy", "Scalars:scalars")
    cost = series(recorded, "/cost", "Scalars:scalars")
    for first, start, steps in starts(messages):
        spent = 0.0
        for row, message in enumerate([start, *steps]):
            key = (start.trial, first + row)
            spent += message.cost if row else 0.0
            for name, p in zip(start.attributes, message.positive, strict=True):
                found = series(recorded, f"/belief/{name}", "Scalars:scalars")[key]
                assert found == pytest.approx([p], abs=1e-12)
                compared += 1
            bits = sum(-x * np.log2(x) for p in message.positive for x in (p, 1 - p) if x > 0)
            assert entropy[key] == pytest.approx([bits], abs=1e-9)
            assert cost[key] == pytest.approx([spent])
        free = (start.trial, first + len(steps) + 1)  # where lines break
        assert np.isnan(entropy[free] + cost[free]).all()
    assert compared > 30
    assert len(entropy) == sum(len(steps) + 2 for _, steps, _ in messages)


def test_expected_rewards_and_their_errors_are_the_logs(messages, recorded):
    values = series(recorded, "/expected_reward/set_0", "Measurements:values")
    variances = series(recorded, "/expected_reward/set_0", "Measurements:variances")
    for first, start, steps in starts(messages):
        for row, step in enumerate(steps, start=1):
            key = (start.trial, first + row)
            report, *behaviors = values[key]  # the report stands first
            np.testing.assert_array_equal([*behaviors, report], step.values)
            report, *behaviors = variances[key]
            np.testing.assert_allclose(
                [*behaviors, report], np.nan_to_num(step.value_se) ** 2, rtol=1e-12
            )


def test_sim_time_is_when_a_step_began(messages, recorded):
    times = series(recorded, "/entropy", "sim_time")
    before = 0.0
    for first, start, steps in starts(messages):
        assert times[start.trial, first].total_seconds() == pytest.approx(before)
        for row, step in enumerate(steps, start=1):
            found = times[start.trial, first + row].total_seconds()
            assert found == pytest.approx(before)
            before += step.cost


def test_lanes_words_and_graphs_tell_the_step(messages, recorded, trials):
    action = series(recorded, "/lanes/action", "StateChange:state")
    where = series(recorded, "/lanes/x", "StateChange:state")
    narration = series(recorded, "/narration", "TextDocument:text")
    labels = series(recorded, "/diagram/nodes", "GraphNodes:labels")
    for (first, start, steps), trial in zip(starts(messages), trials, strict=True):
        for row, step in enumerate(steps, start=1):
            key = (start.trial, first + row)
            report = step.action == trial.momdp.n_behaviors
            assert action[key] == ["report" if report else step.action_name]
            assert where[key] == [trial.momdp.x_names[step.next_x]]
            assert f"trial {start.trial}, step {row}:" in narration[key][0]
            assert set(labels[key]) >= set(trial.momdp.x_names[:-1])
        verdict = "**right**" if trial.success else "**WRONG"
        assert trial.report is None or verdict in narration[start.trial, first + len(steps)][0]
        assert "now it would answer" in narration[start.trial, first][0]


def test_log_lines_fit_their_column(messages, recorded):
    rows = recorded["/log"]
    lines = [text for (text,) in rows["TextLog:text"]]
    assert len(set(rows["step"])) == sum(len(steps) + 1 for _, steps, _ in messages)
    assert len(lines) > len(set(rows["step"]))
    assert max(map(len, lines)) <= 38


def test_measures_of_the_run_count_every_trial(trials, recorded):
    agents = {trial.agent for trial in trials}
    for agent in agents:
        own = [trial for trial in trials if trial.agent == agent]
        found = recorded[f"/run/accuracy/{agent}"]["Measurements:values"]
        right = np.cumsum([trial.success for trial in own])
        assert np.ravel(found) == pytest.approx(right / np.arange(1, len(own) + 1))
        cost = recorded[f"/run/cost/{agent}"]["Measurements:values"][-1]
        assert cost == pytest.approx([np.mean([trial.cost for trial in own])])
    (table,) = recorded["static /run/table"]["TextDocument:text"][-1]
    for agent in agents:
        assert f"|{agent}|" in table
    facts = "".join(map(str, recorded["static /run/facts"]["TextDocument:text"]))
    assert "roc36" in facts
    assert "a b  c" in facts  # signs of Markdown are taken out


def test_every_row_stands_on_all_three_timelines(recorded):
    for entity, columns in recorded.items():
        if not entity.startswith("static "):
            assert set(columns) >= TIMELINES, entity


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
    for name in ("a", "b"):
        path = tmp_path / f"{name}.rrd"
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
        behavior_names=tuple(f"do: {i}/*" for i in range(trial.momdp.n_behaviors)),
    )
    task = Task("t", query, 0, "object\n| # ", ("k",))
    odd = Trial(
        task, "agent / #1", momdp, trial.first_belief, trial.steps, trial.truth, trial.report
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_recording([odd, odd], tmp_path / "odd.rrd", {"a/b": {"c": ["x", None]}})
    rows = read_back(tmp_path / "odd.rrd")
    assert len([entity for entity in rows if entity.startswith("/belief/")]) == 2
    text = rows["/narration"]["TextDocument:text"][0][0]
    assert "<b>" not in text
    assert "`" not in text


def test_no_trials_make_no_recording_to_stumble_over(tmp_path):
    assert write_recording([], tmp_path / "none.rrd", {}) == 0
    assert (tmp_path / "none.rrd").is_file()


def test_rerun_opens_the_mcap_file_itself_to_something_useful(messages, log, read_back, tmp_path):
    stream = rr.RecordingStream("other", make_default=False)
    stream.save(tmp_path / "direct.rrd")
    stream.log_file_from_path(log)
    stream.flush()
    stream.disconnect()
    rows = read_back(tmp_path / "direct.rrd")
    steps = sum(len(steps) for _, steps, _ in messages)
    lines = rows["/log"]["TextLog:text"]
    assert len(lines) == steps
    assert "belief heavy" in lines[0][0]
    columns = [c for n, c in rows["/step"].items() if "meal_bayes.Step" in n]
    assert [len(column) for column in columns] == [steps]


def test_rows_by_truth_are_those_of_drawn_objects():
    rng, domain = np.random.default_rng(4), load_domain("toy")
    e = len(domain.behaviors)
    confusion = rng.dirichlet(np.ones(4), (1, e, 3))
    precision = np.where(rng.random((1, e, 3)) < 0.3, np.inf, rng.gamma(2.0, 5.0, (1, e, 3)))
    classes = rng.dirichlet(np.ones(3), (1, 2))
    query = Query(domain.attributes[:1])
    momdp = build_momdp(domain, query, confusion, precision, latent_classes=classes)
    mean, sd = truth_rows(momdp, 1)
    for truth in (0, 1):
        rows = [
            confusion[0, 1, c]
            if np.isinf(precision[0, 1, c])
            else rng.dirichlet(precision[0, 1, c] * confusion[0, 1, c])
            for c in rng.choice(3, 20_000, p=classes[0, truth])
        ]
        assert np.allclose(np.mean(rows, axis=0), mean[0, truth], atol=0.015)
        assert np.allclose(np.std(rows, axis=0), sd[0, truth], atol=0.015)


def test_recordings_leave_no_threads(trials, tmp_path):
    def write():
        write_recording(trials[:1], tmp_path / "a.rrd", {})

    write()  # what rerun starts once
    before = len(list(Path("/proc/self/task").iterdir()))
    for _ in range(10):
        write()
    assert len(list(Path("/proc/self/task").iterdir())) <= before + 2


def test_a_recording_is_there_whole_or_not_at_all(trials, tmp_path):
    path = tmp_path / "a.rrd"
    path.write_bytes(b"earlier")

    def broken():
        yield trials[0]
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_recording(broken(), path, {})
    assert path.read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [path]
