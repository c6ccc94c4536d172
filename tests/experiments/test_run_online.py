"""Online runs: their protocol, and that a run which was stopped goes on to the same end."""

import json
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import load_dataset
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.logged import worst_first
from meal_bayes.experiments import OnlineConfig, run_online
from meal_bayes.experiments.online import Environment, Protocol, Recordings
from meal_bayes.learner import Learner, LearnerSettings
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.seeds import stream
from meal_bayes.trial_log import Logs, read_header, read_outcomes, read_trials
from meal_bayes.trials import TrialOutcomes

AGENTS = ("iterative_random_legal", "bayes_memory")


def same(left, right):
    """Whether outcomes are equal in every column, bit by bit."""
    return left.behaviors == right.behaviors and all(
        np.array_equal(a, b, equal_nan=a.dtype == float)
        for a, b in (
            (getattr(left, name), getattr(right, name))
            for name in TrialOutcomes.__slots__
            if name != "behaviors"
        )
    )


@pytest.fixture(scope="module")
def config(own_data):
    return OnlineConfig(
        str(own_data), root=str(own_data.parent), batches=2, trials=5, repeats=2, seed=3,
        agents=AGENTS, log="full",
    )  # fmt: skip


@pytest.fixture(scope="module")
def progress():
    return []


@pytest.fixture(scope="module")
def finished(config, tmp_path_factory, progress):
    logs = tmp_path_factory.mktemp("logs")
    return run_online(config, logs=logs, on_progress=lambda done, total: progress.append(done))


@pytest.fixture(scope="module")
def whole(finished, contents):
    return contents(finished.folder)


def logs_of(finished, agent, repeat, part):
    return sorted((finished.folder / agent / f"repeat-{repeat:03d}").glob(f"*-{part}.mcap"))


class TestAFinishedRun:
    def test_every_batch_of_every_unit_is_there(self, whole):
        names = [f"{b:02d}-test" for b in range(3)] + [f"{b:02d}-train" for b in (1, 2)]
        expected = {
            f"{agent}/repeat-{repeat:03d}/{name}.mcap"
            for agent in AGENTS
            for repeat in range(2)
            for name in names
        }
        assert set(whole) == expected

    def test_progress_rises_from_nothing_to_all(self, progress):
        assert progress[0] == 0
        assert progress == pytest.approx(sorted(progress))
        assert progress[-1] == 12

    def test_training_is_the_protocol_s_and_the_same_for_all(self, finished, config):
        dataset = load_dataset(config.dataset, root=config.root)
        for repeat in range(2):
            protocol = Protocol.of(
                dataset, attributes=1, seed=3, repeat=repeat, shares=config.split
            )
            for agent in AGENTS:
                for k, path in enumerate(logs_of(finished, agent, repeat, "train"), start=1):
                    trials = list(read_trials(path))
                    assert [trial.task for trial in trials] == protocol.training(k, 5)
                    for trial in trials:
                        assert trial.task.object_index in protocol.split.train
                for path in logs_of(finished, agent, repeat, "test"):
                    assert [trial.task for trial in read_trials(path)] == protocol.tests()

    def test_results_are_those_of_the_logs(self, finished):
        results = list(finished.results())
        assert [(r.agent, r.repeat, r.batch) for r in results] == [
            (agent, repeat, batch) for agent in AGENTS for repeat in range(2) for batch in range(3)
        ]
        for result in results:
            tests = logs_of(finished, result.agent, result.repeat, "test")
            assert same(TrialOutcomes.of(read_trials(tests[result.batch])), result.outcomes)
            trained = logs_of(finished, result.agent, result.repeat, "train")[: result.batch]
            spent = sum(trial.cost for path in trained for trial in read_trials(path))
            assert result.hours == pytest.approx(spent / 3600)
        assert results[0].hours == 0

    def test_headers_tell_the_settings(self, finished, config):
        for path in finished.folder.rglob("*.mcap"):
            header = read_header(path)
            changes = {"agents": [header["agent"]], "reward": 100.0}  # the domain's
            assert header["config"] == json.loads(json.dumps(config.as_dict())) | changes
            assert path.name == f"{header['batch']:02d}-{header['part']}.mcap"
            assert path.parent.name == f"repeat-{header['repeat']:03d}"
            assert path.parent.parent.name == header["agent"]
            assert ("pretrained" in header) == (path.name == "00-test.mcap")


@pytest.mark.parametrize(
    "lost",
    [
        ["02-train.mcap"],
        *(
            pytest.param(names, marks=pytest.mark.long)
            for names in (
                ["02-test.*", "02-train.*"],
                ["00-test.*", "01-test.*"],
                ["01-train.mcap", "02-*"],
            )
        ),
    ],
    ids="+".join,
)
def test_what_is_lost_is_made_again(finished, whole, config, lost, contents):
    unit = finished.folder / "bayes_memory" / "repeat-001"
    times = {p: p.stat().st_mtime_ns for p in finished.folder.rglob("repeat-000/*.mcap")}
    for pattern in lost:
        for path in unit.glob(pattern):
            path.unlink()
    run_online(config, logs=finished.folder.parent)
    list(finished.results())
    assert contents(finished.folder) == whole
    assert {path: path.stat().st_mtime_ns for path in times} == times


@pytest.mark.long
@pytest.mark.parametrize("stop", [1, 8, 20])
def test_a_run_that_stops_goes_on_to_the_same_end(
    config, whole, tmp_path, monkeypatch, stop, contents
):
    ask = Environment.ask
    learned = []

    def failing(self, learner, task, *, learn):
        learned.extend([task] if learn else [])
        if learn and len(learned) == stop:
            raise RuntimeError("the power went")
        return ask(self, learner, task, learn=learn)

    monkeypatch.setattr(Environment, "ask", failing)
    with pytest.raises(RuntimeError, match="the power went"):
        run_online(config, logs=tmp_path)
    monkeypatch.setattr(Environment, "ask", ask)
    assert len(contents(tmp_path)) < len(whole)
    run = run_online(config, logs=tmp_path)
    assert contents(run.folder) == whole
    assert not list(run.folder.rglob("*.active"))


def test_agents_and_repeats_join_the_folder(finished, config, contents):
    more = replace(config, agents=("iterative_random_legal",), repeats=1)
    before = contents(finished.folder)
    steps = []
    run = run_online(
        more, logs=finished.folder.parent, on_progress=lambda *step: steps.append(step)
    )
    assert run.folder == finished.folder
    assert steps == [(3, 3)]
    assert contents(finished.folder) == before
    assert [(r.agent, r.repeat) for r in run.results()] == [(AGENTS[0], 0)] * 3


def test_compact_logs_hold_the_same_outcomes_and_go_on_to_the_same_end(
    config, finished, tmp_path, contents
):
    compact = replace(config, agents=AGENTS[1:], repeats=1, log="compact")
    run = run_online(compact, logs=tmp_path)
    before = contents(run.folder)
    expected = {(entry.repeat, entry.batch): entry for entry in finished.results() if
                entry.agent == AGENTS[1]}  # fmt: skip
    for result in run.results():
        full = expected[result.repeat, result.batch]
        assert result.hours == full.hours
        assert same(result.outcomes, full.outcomes)
    for path in run.folder.rglob("*-test.mcap"):
        assert path.stat().st_size < finished.folder.joinpath(
            path.relative_to(run.folder)).stat().st_size  # fmt: skip
    (run.folder / AGENTS[1] / "repeat-000" / "01-test.mcap").unlink()
    run_online(compact, logs=tmp_path)
    assert contents(run.folder) == before


@pytest.mark.long
def test_the_worst_test_of_a_batch_and_ten_drawn_ones_have_steps(config, finished, tmp_path):
    shown = {}
    run = run_online(replace(config, repeats=1, log="compact"), logs=tmp_path)
    for path in run.folder.rglob("*-test.mcap"):
        full = list(read_trials(finished.folder / path.relative_to(run.folder)))
        groups = list(Logs(path).groups())
        numbered = {n: trial for group in groups for n, trial in
                    zip(group.numbers, group.trials, strict=False)}  # fmt: skip
        assert sum(len(group.outcomes) for group in groups) == len(full) > len(numbered)
        for number, trial in numbered.items():
            assert trial.task == full[number].task
            assert [s.decision.action for s in trial.steps] == [
                s.decision.action for s in full[number].steps
            ]
        worst = int(worst_first(TrialOutcomes.of(full))[0])
        assert numbered[worst].reward == min(trial.reward for trial in full)
        shown.setdefault(path.name, []).append(set(numbered))
    for of_agents in shown.values():
        assert all(10 <= len(numbers) <= 11 for numbers in of_agents)
        assert len(set.intersection(*of_agents)) >= 10


@pytest.mark.long
def test_every_setting_reaches_the_run(config, tmp_path):
    base = replace(config, agents=AGENTS[1:], repeats=1)
    changes = (
        {"attributes": 2}, {"seed": 4}, {"split": (1, 1, 2)}, {"reward": 50.0}, {"horizon": 10},
        {"answers": "joint"}, {"normalizer": "all"}, {"trials": 4},
    )  # fmt: skip
    folders = set()
    for change in changes:
        run = run_online(replace(base, **change), logs=tmp_path)
        folders.add(run.folder)
        for path in run.folder.rglob("*.mcap"):
            settings = read_header(path)["config"]
            assert settings | json.loads(json.dumps(change)) == settings
        trials = [t for p in run.folder.rglob("*-test.mcap") for t in read_trials(p)]
        assert {len(trial.truth) for trial in trials} == {change.get("attributes", 1)}
        assert {trial.momdp.correct for trial in trials} == {change.get("reward", 100.0)}
    assert len(folders) == len(changes)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["bayes_memory", "morc_itrs"])
def test_a_live_learner_in_the_protocol_s_order_makes_the_same_trials(config, tmp_path, name):
    """A robot that replays, feedback and refits by hand: `ask` and `tell` are all it takes."""
    settings = replace(config, agents=(name,), repeats=1)
    run = run_online(settings, logs=tmp_path)
    dataset = load_dataset(config.dataset, root=config.root)
    domain = dataset.domain
    seed = config.seed
    protocol = Protocol.of(dataset, attributes=1, seed=seed, repeat=0, shares=config.split)
    recordings = Recordings(dataset, stream(seed, "world", domain.data, 0))
    settings = LearnerSettings(  # delta of Eq. 10 is the protocol's
        seed=seed, reward=100.0, refit_every=None, learn_success=False, horizon=config.horizon,
        count_given=False, unit=float(dataset.recordings * len(protocol.split.train)),
    )  # fmt: skip
    learner = Learner(domain, agent=name, settings=settings, logs=None)
    learner.fit(protocol.pretraining())
    live = {}
    for batch in range(3):
        for part, tasks in (
            ("test", protocol.tests()),
            ("train", protocol.training(batch + 1, 5) if batch < 2 else []),
        ):
            for task in tasks:
                o = task.object_index
                (attribute,) = task.query.attributes
                order = stream(seed, "recordings", *task.key)
                robot = RecordedRobot(
                    domain, o, recordings.counts[o],
                    order if part == "test" else recordings.supply(o),
                    stream(seed, "robot", *task.key), dataset,
                )  # fmt: skip
                truth = bool(dataset.labels[o, domain.attribute_index(attribute)])
                trial = learner.ask(task, robot, truth={attribute: truth}, learn=part == "train")
                live.setdefault((batch + (part == "train"), part), []).append(trial)
                if part == "train":
                    recordings.use(trial)
                    if trial.report is not None:  # a verdict implies the one label
                        learner.tell(trial, {attribute: truth})
        learner.refit()
    for (batch, part), trials in live.items():
        path = run.folder / name / "repeat-000" / f"{batch:02d}-{part}.mcap"
        logged = list(read_trials(path))
        assert len(logged) == len(trials)
        for again, first in zip(trials, logged, strict=True):
            assert again.task == first.task
            assert [s.decision.action for s in again.steps] == [
                s.decision.action for s in first.steps
            ]
            np.testing.assert_array_equal(again.last_belief.log_prob, first.last_belief.log_prob)
            np.testing.assert_array_equal(again.momdp.bonus, first.momdp.bonus)
            np.testing.assert_array_equal(again.report, first.report)


@pytest.mark.long
def test_an_agent_that_another_trains_learns_from_its_trials(config, tmp_path):
    agents = ("iterative_morc", "iterative_morc_bayes", "bayes_no_bonus")
    run = run_online(replace(config, agents=agents, log="compact"), logs=tmp_path)
    morc, taught, untaught = (
        [read_outcomes(path) for path in sorted((run.folder / agent).rglob("*-train.mcap"))]
        for agent in agents
    )
    for teacher, pupil in zip(morc, taught, strict=True):
        np.testing.assert_array_equal(teacher.executed, pupil.executed)
        np.testing.assert_array_equal(teacher.cost, pupil.cost)
        assert set(pupil.agent) == {"iterative_morc_bayes"}
    first = [r.outcomes.positive for r in run.results() if (r.batch, r.repeat) == (0, 0)]
    np.testing.assert_array_equal(first[1], first[2])  # bayes' belief of what was known before
    assert (first[0] != first[1]).any()
    assert any((a.cost != b.cost).any() for a, b in zip(taught, untaught, strict=True))


def test_curious_agents_take_their_weights(config, tmp_path):
    base = replace(config, agents=("morc_itrs",), repeats=1, batches=1, trials=2)
    bonus = {}
    for alpha, beta in ((0.0, 0.0), (6.0, 0.0)):
        run = run_online(replace(base, alpha=alpha, beta=beta), logs=tmp_path)
        (path,) = run.folder.rglob("01-train.mcap")
        bonus[alpha] = next(read_trials(path)).momdp.bonus
    assert not bonus[0.0].any()
    assert (bonus[6.0][:, :2] > 0).all()


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"attributes": 3}, SettingsError, "attributes is 3; own has 2"),
        ({"root": None}, SettingsError, "give root="),
    ],
)
def test_what_cannot_be_run_leaves_no_log(config, tmp_path, wrong, error, message):
    with pytest.raises(error, match=message):
        run_online(replace(config, **wrong), logs=tmp_path)
    assert not list(tmp_path.iterdir())
