import numpy as np
import pytest

from meal_bayes.errors import SettingsError
from meal_bayes.experiments import (
    OfflineConfig,
    OnlineConfig,
    offline_tasks,
    run_offline,
    run_online,
)
from meal_bayes.learner import Learner
from meal_bayes.trial_log import read_header, read_trials

AGENTS = ("random", "predefined_plus")
CONFIG = OfflineConfig("roc36", 2, 130, AGENTS, seed=3)  # two units an agent


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return run_offline(CONFIG, logs=tmp_path_factory.mktemp("logs"))


class TestAFinishedRun:
    def test_rows_are_paired(self, finished, roc36):
        by_agent = {name: [] for name in AGENTS}
        for trial in finished.trials():
            by_agent[trial.agent].append(trial)
        tasks = offline_tasks(roc36, 2, 130, 3)
        for trials in by_agent.values():
            assert [trial.task for trial in trials] == tasks
        for task, *pair in zip(tasks, *by_agent.values(), strict=True):
            columns = [roc36.domain.attribute_index(name) for name in task.query.attributes]
            truth = roc36.labels[task.object_index, columns] == 1
            for trial in pair:
                np.testing.assert_array_equal(trial.truth, truth)

    def test_trials_are_those_of_a_learner(self, finished, roc36):
        learner = Learner("roc36", agent="predefined_plus", seed=3, logs=None).fit(roc36)
        (path,) = (p for p in finished.paths if p.match("predefined_plus/unit-0001.mcap"))
        for trial in read_trials(path):
            expected = learner.ask(trial.task)
            assert trial.cost == expected.cost
            np.testing.assert_array_equal(trial.report, expected.report)
            np.testing.assert_array_equal(trial.last_belief.log_odds, expected.last_belief.log_odds)

    def test_headers_tell_the_settings(self, finished):
        names = [path.relative_to(finished.folder).as_posix() for path in finished.paths]
        assert names == [f"{name}/unit-{k:04d}.mcap" for name in AGENTS for k in (0, 1)]
        assert [sum(1 for _ in read_trials(path)) for path in finished.paths] == [100, 30] * 2
        for path in finished.paths:
            header = read_header(path)
            assert header["seed"] == 3
            assert header["config"] == CONFIG.as_dict() | {"agents": [path.parent.name]}


class TestRunningAgain:
    def test_only_what_is_missing_or_unfinished_is_run(self, finished, contents):
        before = contents(finished.folder)
        lost = finished.paths[1]
        times = {path: path.stat().st_mtime_ns for path in finished.paths if path != lost}
        torn = lost.with_name(f"{lost.stem}.w1-abcdef.mcap.active")
        torn.write_bytes(lost.read_bytes()[:5000])
        lost.unlink()
        steps = []
        run_offline(CONFIG, logs=finished.folder.parent, on_progress=lambda *at: steps.append(at))
        assert (steps[0], steps[-1]) == ((230, 260), (260, 260))
        assert contents(finished.folder) == before
        assert not torn.exists()
        assert {path: path.stat().st_mtime_ns for path in times} == times

    @pytest.mark.long
    def test_fresh_runs_everything_again(self, finished, contents):
        before = contents(finished.folder)
        steps = []
        logs = finished.folder.parent
        run_offline(CONFIG, logs=logs, fresh=True, on_progress=lambda *at: steps.append(at))
        assert (steps[0], steps[-1]) == ((0, 260), (260, 260))
        assert contents(finished.folder) == before

    @pytest.mark.long
    def test_more_agents_join_the_folder(self, finished):
        more = OfflineConfig("roc36", 2, 130, ("predefined", *AGENTS), seed=3)
        steps = []
        run = run_offline(
            more, logs=finished.folder.parent, on_progress=lambda *step: steps.append(step)
        )
        assert run.folder == finished.folder
        assert steps[0] == (260, 390)
        assert run.paths[2:] == finished.paths

    def test_removed_times_are_unknown(self, finished):
        timing = finished.paths[0].with_name("unit-0000.timing.csv")
        text = timing.read_text(encoding="utf-8")
        timing.unlink()
        try:
            again = run_offline(CONFIG, logs=finished.folder.parent)
        finally:
            timing.write_text(text, encoding="utf-8")
        assert np.isnan(again.seconds["random"])
        assert again.seconds["predefined_plus"] > 0


@pytest.mark.long
def test_two_processes_write_the_same_files(finished, tmp_path, contents):
    run = run_offline(CONFIG, logs=tmp_path, jobs=2)
    assert run.folder.name == finished.folder.name
    assert contents(run.folder) == {
        name: data
        for name, data in contents(finished.folder).items()
        if name.partition("/")[0] in AGENTS
    }


def test_changed_settings_use_another_folder(tmp_path):
    changes = (
        {},
        {"attributes": 1},
        {"trials": 3},
        {"seed": 1},
        {"percepts": "model"},
        {"reward": 50.0},
        {"dataset": "roc36_published"},
    )
    base = {"dataset": "roc36", "attributes": 2, "trials": 2, "agents": ("random",)}
    folders = [
        run_offline(OfflineConfig(**(base | change)), logs=tmp_path).folder for change in changes
    ]
    assert len(set(folders)) == len(changes)
    for folder, change in zip(folders, changes, strict=True):
        config = OfflineConfig(**(base | change))
        (path,) = folder.rglob("*.mcap")
        assert len(list(read_trials(path))) == config.trials


def test_faults_leave_the_unit_unfinished(tmp_path, monkeypatch):
    config = OfflineConfig("roc36", 2, 20, ("random",))
    run = Learner.ask
    calls = []

    def failing(self, task, **options):
        calls.append(task)
        if len(calls) == 8:
            raise RuntimeError("the power went")
        return run(self, task, **options)

    monkeypatch.setattr(Learner, "ask", failing)
    with pytest.raises(RuntimeError, match="the power went"):
        run_offline(config, logs=tmp_path)
    assert not list(tmp_path.rglob("*.mcap"))
    assert len(list(tmp_path.rglob("*.mcap.active"))) == 1
    monkeypatch.setattr(Learner, "ask", run)
    assert len(list(run_offline(config, logs=tmp_path).trials())) == 20


def test_model_percepts_and_rewards_reach_the_trials(tmp_path):
    config = OfflineConfig("roc36", 1, 5, ("predefined",), percepts="model", reward=42.0)
    for trial in run_offline(config, logs=tmp_path).trials():
        assert trial.reward == pytest.approx((42.0 if trial.success else -42.0) - trial.cost)
        assert np.isinf(trial.momdp.limit).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"agents": ("bayes", "bayess")}, "did you mean 'bayes'"),
        ({"agents": ("bayes", "bayes")}, "listed twice"),
        ({"agents": ()}, "no agents"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 1.5}, "seed is 1.5; give a whole number"),
        ({"reward": float("nan")}, "reward is nan"),
        ({"reward": 1e100}, "reward is 1e"),
    ],
)
def test_configs_are_checked(wrong, message):
    for config in (OfflineConfig, OnlineConfig):
        with pytest.raises(SettingsError, match=message):
            config("roc36", **wrong)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"learning": (("by_objects", False),)}, "did you mean 'by_object'"),
        ({"percepts": "modell"}, "did you mean 'model'"),
        ({"attributes": 0}, "attributes is 0"),
        ({"trials": -1}, "trials is -1"),
        ({"split": (33, 0, 34)}, "give three shares"),
        ({"split": (0.3, 0.3, 0.4)}, "give three shares as whole numbers"),
        ({"split": 3}, "give three shares"),
        ({"log": "some"}, "log 'some'"),
        ({"answers": "verdikt"}, "did you mean 'verdict'"),
        ({"normalizer": "papre"}, "did you mean 'paper'"),
        ({"alpha": -1.0}, "alpha"),
        ({"beta": float("nan")}, "beta"),
        ({"horizon": 0}, "horizon"),
    ],
)
def test_configs_of_online_runs_are_checked(wrong, message):
    with pytest.raises(SettingsError, match=message):
        OnlineConfig("toy", **wrong)


@pytest.mark.parametrize("weights", [{"alpha": 3.0}, {"beta": 0.0}])
def test_weights_that_no_agent_takes_are_refused(weights, tmp_path):
    with pytest.raises(SettingsError, match="none of the agents bayes, prior takes"):
        run_online(OnlineConfig("toy", agents=("bayes", "prior"), **weights), logs=tmp_path)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"dataset": "rok36"}, "'roc36'"),
        ({"trials": 0}, "trials is 0"),
        ({"percepts": "modell"}, "did you mean 'model'"),
    ],
)
def test_what_cannot_be_run_leaves_no_log(tmp_path, wrong, message):
    settings = {"dataset": "roc36", "trials": 2, "agents": ("random",)} | wrong
    with pytest.raises(SettingsError, match=message):
        run_offline(OfflineConfig(**settings), logs=tmp_path)
    assert not list(tmp_path.rglob("*.mcap*"))
