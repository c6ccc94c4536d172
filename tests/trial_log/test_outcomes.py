"""Outcomes of trials: measures as the trials have them, whatever form their log has."""

import random

import numpy as np
import pytest

from meal_bayes.errors import LogCorruptError, LogError, SettingsError
from meal_bayes.evaluation.report import write_report
from meal_bayes.trial_log import (
    Follower,
    Logs,
    OutcomeWriter,
    check_log,
    count_whole,
    log_info,
    read_outcomes,
    read_trials,
    recover_log,
    salvage,
    write_trials,
)
from meal_bayes.trial_log.compact import decode_outcomes, encode_outcomes
from meal_bayes.trial_log.schema import OutcomesMessage
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
            row, n = outcomes.rows([k]), len(trial.truth)
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
                own = [s for s in done if s.decision.action == e]
                column = row.behaviors.index(name)
                assert row.executed[0, column] == len(own)
                assert row.failed[0, column] == sum(s.observation is None for s in own)

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
        with OutcomeWriter(tmp_path / "compact.mcap", {}) as log:
            for trial in trials:
                log.write(trial, seconds=0.5)
        forms = [tmp_path / f"{form}.mcap" for form in ("full", "compact")]
        for path in forms:
            assert same(read_outcomes(path), outcomes)
            assert count_whole(path) == len(trials)
            assert check_log(path).whole
        full, compact = map(log_info, forms)
        assert (full.trials, full.steps, full.form) == (len(trials), outcomes.steps.sum(), "full")
        assert (compact.trials, compact.steps, compact.form) == (full.trials, full.steps, "compact")
        assert full.cost == pytest.approx(outcomes.cost.sum())
        assert compact.cost == pytest.approx(full.cost)

    def test_there_are_no_trials_to_show(self, compact):
        for read in (lambda: read_trials(compact), Logs(compact).trials):
            with pytest.raises(LogError, match=r"a compact log: .* meal-bayes report"):
                list(read())
        follower = Follower(compact)
        assert list(follower.poll()) == []
        assert follower.finished

    def test_both_forms_make_a_report_of_all_trials(self, trials, compact, tmp_path):
        write_trials(tmp_path / "b.mcap", trials, header={"seed": 4})
        info = write_report(Logs(tmp_path), tmp_path / "r.html")
        assert info.trials == 21 * len(trials)
        assert "holds no steps" in (tmp_path / "r.html").read_text()

    def test_a_file_that_is_named_twice_counts_once(self, compact, outcomes):
        copy = compact.with_name("b.mcap")
        copy.write_bytes(compact.read_bytes())
        groups = list(Logs(compact, copy).groups())
        assert sum(len(group.outcomes) for group in groups) == 20 * len(outcomes)
        assert {group.file for group in groups} == {compact}


class TestDamage:
    @pytest.mark.parametrize("damages", [100, pytest.param(300, marks=pytest.mark.long)])
    def test_damages_are_never_silently_wrong(self, compact, outcome_of, damages):
        data, whole = compact.read_bytes(), read_outcomes(compact)
        rng, saved = random.Random(7), 0
        for index in range(damages):
            changed = bytearray(data)
            for _ in range(rng.randint(1, 3)):
                changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            changed = bytes(changed if index % 2 else data[: rng.randrange(len(data))])
            compact.write_bytes(changed)
            if changed == data:
                continue
            fault = outcome_of(lambda: read_outcomes(compact))
            assert isinstance(fault, LogCorruptError), (index, fault)
            info = outcome_of(lambda: log_info(compact))
            assert isinstance(info, LogCorruptError) or (info.trials, info.steps, info.cost) == (
                len(whole), whole.steps.sum(), pytest.approx(whole.cost.sum())
            ), (index, info)  # fmt: skip
            rescued = outcome_of(lambda: list(salvage(compact)))
            assert isinstance(rescued, LogCorruptError | list), (index, rescued)
            saved += isinstance(rescued, list) and sum(map(len, rescued))
        assert saved > damages * len(whole) * 0.3

    def test_messages_that_contradict_themselves_are_refused(self, outcomes):
        data = encode_outcomes(outcomes, 0)
        for field in (*COLUMNS, "texts", "trials", "queried", "behaviors", "first"):
            for change in (_shorter, _wrong):
                message = OutcomesMessage.FromString(data)
                change(message, field)
                if field != "first" or change is _wrong:
                    with pytest.raises((LogCorruptError, SettingsError, ValueError)):
                        decode_outcomes(message.SerializeToString())

    def test_what_is_torn_is_recovered(self, compact, outcomes):
        data = compact.read_bytes()
        draft = compact.with_name("b.mcap.active")
        draft.write_bytes(data[: len(data) * 2 // 3])
        with pytest.raises(LogCorruptError, match="log recover"):
            read_outcomes(draft)
        saved = read_outcomes(recover_log(draft))
        assert 0 < len(saved) < 20 * len(outcomes)
        assert same(saved, read_first(compact, data, len(saved)))


def read_first(path, data, count):
    path.write_bytes(data)
    return read_outcomes(path).rows(slice(count))


def _shorter(message, field):
    value = getattr(message, field)
    if hasattr(value, "pop"):
        value.pop()
    else:
        setattr(message, field, value - 1)


def _wrong(message, field):
    value = getattr(message, field)
    if field in ("texts", "behaviors"):
        del value[:]
    elif hasattr(value, "pop"):
        value[0] = float("inf") if field in REALS else -9
    else:
        setattr(message, field, -1)
