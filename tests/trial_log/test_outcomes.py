"""Outcomes of trials: measures as the trials have them, whatever form their log has."""

import json

import numpy as np
import pytest

from meal_bayes.errors import LogCorruptError, LogError, SettingsError
from meal_bayes.evaluation.report import write_report
from meal_bayes.trial_log import (
    Follower,
    Logs,
    check_log,
    log_info,
    read_outcomes,
    read_trials,
    write_trials,
)
from meal_bayes.trial_log.messages import OutcomesMessage, decode, encode
from meal_bayes.trials import TrialOutcomes
from meal_bayes.trials.outcomes import INTEGERS, REALS, TEXTS

COLUMNS = [*TEXTS, *INTEGERS, *REALS]


def same(left, right):
    """Whether outcomes are equal in every column, bit by bit."""
    return left.behaviors == right.behaviors and all(
        np.array_equal(a, b, equal_nan=a.dtype == float)
        for a, b in ((getattr(left, name), getattr(right, name)) for name in COLUMNS)
    )


@pytest.fixture(scope="module")
def trials(make):
    """Trials of one, two and three attributes; some abstain."""
    return [
        trial
        for n in (1, 2)
        for trial in make.trials(20, n, n=n, edges=None)
    ]  # fmt: skip


@pytest.fixture(scope="module")
def outcomes(trials):
    return TrialOutcomes.of(trials)


@pytest.fixture
def compact(outcomes, tmp_path):
    path = tmp_path / "a.mcap"
    write_trials(path, [outcomes] * 20, header={"seed": 3})
    return path


class TestColumns:
    def test_measures_are_the_trials_own(self, trials, outcomes):
        assert {trial.report is None for trial in trials} == {True, False}
        for k, trial in enumerate(trials):
            row = outcomes.rows([k])
            n = len(trial.truth)
            assert row.success[0] == trial.success
            assert row.judged[0] == trial.judged
            assert row.answered[0] == (trial.report is not None)
            assert (row.cost[0], row.reward[0]) == (trial.cost, trial.reward)
            assert (row.agent[0], row.object_name[0]) == (trial.agent, trial.task.object_name)
            assert row.object_index[0] == trial.task.object_index
            assert row.certainty[0] == pytest.approx(trial.last_belief.certainty)
            np.testing.assert_array_equal(row.positive[0, :n], trial.last_belief.positive)
            np.testing.assert_array_equal(row.truth[0, :n], trial.truth)
            assert tuple(row.attribute[0, :n]) == trial.task.query.attributes
            assert row.steps[0] == len(trial.steps)
            done = [s for s in trial.steps if s.decision.action < trial.momdp.n_behaviors]
            for e, name in enumerate(trial.momdp.behavior_names):
                steps = [s for s in done if s.decision.action == e]
                column = row.behaviors.index(name)
                assert row.executed[0, column] == len(steps)
                assert row.failed[0, column] == sum(s.observation is None for s in steps)

    def test_rows_joined_are_the_rows_of_all(self, trials, outcomes):
        parts = [TrialOutcomes.of(trials[at : at + 7]) for at in range(0, len(trials), 7)]
        assert same(TrialOutcomes.join(parts), outcomes)
        assert same(TrialOutcomes.join([outcomes]), outcomes)
        assert len(TrialOutcomes.join([])) == len(TrialOutcomes.of([])) == 0

    @pytest.mark.parametrize(
        ("column", "value"),
        [("cost", np.inf), ("reward", -np.inf), ("positive", 1.5), ("positive", np.nan),
         ("truth", 2), ("report", -2), ("failed", -1), ("failed", 99), ("steps", 0),
         ("object_index", -2)],
    )  # fmt: skip
    def test_values_that_no_trial_has_are_refused(self, outcomes, column, value):
        columns = {name: getattr(outcomes, name).copy() for name in COLUMNS}
        columns[column].flat[0] = value
        with pytest.raises(
            SettingsError, match=column if column != "failed" else "failed|executed"
        ):
            TrialOutcomes(outcomes.behaviors, **columns)
        columns[column] = columns[column][:-1]
        with pytest.raises(SettingsError, match="shape"):
            TrialOutcomes(outcomes.behaviors, **columns)


class TestCompactLogs:
    def test_both_forms_have_the_same_outcomes(self, trials, outcomes, tmp_path):
        write_trials(tmp_path / "full.mcap", trials, header={})
        parts = [TrialOutcomes.of([trial]) for trial in trials]
        write_trials(tmp_path / "compact.mcap", parts, header={})
        forms = [tmp_path / f"{form}.mcap" for form in ("full", "compact")]
        for path in forms:
            assert same(read_outcomes(path), outcomes)
            assert check_log(path).whole
        full, compact = map(log_info, forms)
        assert (full.trials, full.steps, full.form) == (len(trials), outcomes.steps.sum(), "full")
        assert (compact.trials, compact.steps, compact.form) == (full.trials, full.steps, "compact")
        assert full.cost == pytest.approx(outcomes.cost.sum())
        assert compact.cost == pytest.approx(full.cost)

    def test_there_are_no_trials_to_show(self, compact):
        with pytest.raises(LogError, match=r"a compact log: .* meal-bayes report"):
            list(read_trials(compact))
        follower = Follower(compact)
        assert list(follower.poll()) == []
        assert follower.finished

    @pytest.mark.long
    def test_both_forms_make_a_report_of_all_trials(self, trials, compact, tmp_path):
        write_trials(tmp_path / "b.mcap", trials, header={"seed": 4})
        joined = write_report(Logs(tmp_path), tmp_path / "r.html")
        assert len(joined) == 21 * len(trials)
        assert "without its steps" in (tmp_path / "r.html").read_text()


def test_messages_that_contradict_themselves_are_refused(outcomes):
    data = encode(OutcomesMessage.of(outcomes, 0))
    for name in (*COLUMNS, "behaviors", "first"):
        for change in (_shorter, _wrong):
            message = json.loads(data)
            change(message, name)
            if name != "first" or change is _wrong:
                with pytest.raises((LogCorruptError, SettingsError, ValueError)):
                    decode(json.dumps(message).encode(), OutcomesMessage).read()


def _shorter(message, name):
    if name == "first":
        return
    values = message[name]
    if isinstance(values, dict):
        values["shape"][0] -= 1
    else:
        values.pop()


def _wrong(message, name):
    values = message[name]
    if name == "first":
        message[name] = -1
    elif name == "behaviors":
        values.clear()
    elif isinstance(values, dict):
        values["values"][0] = "Infinity" if name in REALS else -9
    else:
        values[0] = "Infinity" if name in REALS else -9
