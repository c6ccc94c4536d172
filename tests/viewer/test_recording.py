"""What stands in an .rrd file is what stands in the MCAP file it was made of."""

import dataclasses
import warnings
from collections import Counter

import numpy as np
import pytest
from mcap.reader import make_reader
from rerun.chunk import RrdReader

from meal_bayes.domain import Query
from meal_bayes.trial_log import read_trials
from meal_bayes.trial_log.schema import StepMessage, TrialMessage
from meal_bayes.trials import Task, TrialOutcomes
from meal_bayes.viewer import write_recording

TIMELINES = {"trial", "step", "sim_time"}


@pytest.fixture(scope="module")
def messages(log):
    """The log's own numbers, by MCAP's reader: for each trial its start and its steps."""
    trials = []
    with log.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if channel.topic == "/trial":
                trials.append((TrialMessage.FromString(message.data), []))
            elif channel.topic == "/step":
                trials[-1][1].append(StepMessage.FromString(message.data))
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
    times, before = series(recorded, "/entropy", "sim_time"), 0.0
    cost = series(recorded, "/cost", "Scalars:scalars")
    for first, start, steps in starts(messages):
        spent = 0.0
        for row, message in enumerate([start, *steps]):
            key = (start.trial, first + row)
            assert times[key].total_seconds() == pytest.approx(before)  # when a step began
            spent += message.cost if row else 0.0
            before += message.cost if row else 0.0
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
    assert len(entropy) == sum(len(steps) + 2 for _, steps in messages)


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
    assert len(set(rows["step"])) == sum(len(steps) + 1 for _, steps in messages)
    assert 30 < max(len(text) for (text,) in rows["TextLog:text"]) <= 38


def test_measures_of_the_run_count_every_trial(trials, recorded):
    agents = {trial.agent for trial in trials}
    (table,) = recorded["static /run/table"]["TextDocument:text"][-1]
    for agent in agents:
        own = [trial for trial in trials if trial.agent == agent]
        accuracy = recorded[f"/run/accuracy/{agent}"]["Measurements:values"]
        right = np.cumsum([trial.success for trial in own])
        assert np.ravel(accuracy) == pytest.approx(right / np.arange(1, len(own) + 1))
        cost = recorded[f"/run/cost/{agent}"]["Measurements:values"][-1]
        assert cost == pytest.approx([np.mean([trial.cost for trial in own])])
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
        behavior_names=tuple(f"do: {i}/*" for i in range(trial.momdp.n_behaviors)),
    )
    task = Task("t", query, 0, "object\n| # ", ("k",))
    odd = dataclasses.replace(trial, task=task, agent="agent / #1", momdp=momdp)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_recording([odd, odd], tmp_path / "odd.rrd", {"a/b": {"c": ["x", None]}})
    rows = read_back(tmp_path / "odd.rrd")
    assert len([entity for entity in rows if entity.startswith("/belief/")]) == 2
    text = rows["/narration"]["TextDocument:text"][0][0]
    assert "<b>" not in text
    assert "`" not in text
