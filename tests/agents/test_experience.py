"""What a robot at work has gathered: checked against the instances it was really shown."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.agents import Environment, Experience, Feedback, Streams, Task, run_trial
from meal_bayes.datasets import make_synthetic
from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import build_momdp
from meal_bayes.perception import sampled_percepts
from meal_bayes.planners import RandomLegal
from meal_bayes.robots import CheckedRobot, RecordedRobot
from meal_bayes.seeds import stream

TOY = load_domain("toy")
OBJECTS, RECORDINGS, BUDGET = 4, 3, 25.0  # s: more executions than there are recordings
DATASET = make_synthetic(
    TOY, objects=OBJECTS, recordings=RECORDINGS, dimensions=2, rng=np.random.default_rng(0)
)
QUERIES = (("red",), ("heavy",), ("red", "heavy"), ("heavy", "red"))
FAIR = np.full((2, 3, 2, 2), 0.5)


@dataclass
class RecordingPerceiver:
    """A perceiver that notes which instances it was shown."""

    shown: list = field(default_factory=list)

    def observe(self, instance, query, rng):
        self.shown.append((instance.object_index, instance.behavior, instance.recording))
        return sampled_percepts(TOY, DATASET.labels, FAIR).observe(instance, query, rng)


def work(experience, o, attributes, seed, budget=BUDGET):
    """Run a trial on what comes next of an object; give it with the instances shown."""
    query, witness = Query(attributes), RecordingPerceiver()
    columns = [TOY.attribute_index(name) for name in attributes]
    momdp = build_momdp(TOY, query, FAIR[columns], limit=RECORDINGS)
    task = Task("a task", query, o, DATASET.objects[o], (seed, o, *attributes))
    rng = stream(seed, "robot", *task.key)
    robot = RecordedRobot(TOY, o, RECORDINGS, experience.supply(o), rng)
    trial = run_trial(
        task, momdp, RandomLegal(budget).solve(momdp, None),
        Environment(
            CheckedRobot(robot, TOY, object_index=o), witness, Streams.of(seed, task, ""),
            truth=DATASET.labels[o, columns] == 1,
        ),
    )  # fmt: skip
    return SimpleNamespace(trial=trial, shown=witness.shown, columns=columns)


def empty(*, memory=False):
    return Experience.none(DATASET, np.random.default_rng(3), memory=memory)


trials = st.lists(
    st.tuples(
        st.integers(0, OBJECTS - 1), st.sampled_from(QUERIES), st.integers(0, 99), st.booleans()
    ),
    max_size=12,
)


@given(trials=trials, memory=st.booleans())
def test_d_holds_what_was_shown_with_its_labels(trials, memory):
    experience, ledger, told = empty(memory=memory), {}, {}
    for o, attributes, seed, right in trials:
        done = work(experience, o, attributes, seed)
        values = DATASET.labels[o, done.columns] if right else np.full(len(attributes), -1)
        experience = experience.absorb(TOY, done.trial, values.astype(np.int8))
        for key in done.shown:
            ledger.setdefault(key, {})
            if right:
                ledger[key].update(zip(done.columns, values.tolist(), strict=True))
        if right:
            told.setdefault(o, {}).update(zip(done.columns, values.tolist(), strict=True))
        if memory:
            ledger.update({key: dict(told.get(o, {})) for key in ledger if key[0] == o})
    expected = np.full((OBJECTS, 3, RECORDINGS, 2), -1)
    for (o, behavior, r), labels in ledger.items():
        for p, value in labels.items():
            expected[o, TOY.behavior_index(behavior), r, p] = value
    np.testing.assert_array_equal(experience.labels, expected)
    np.testing.assert_array_equal(
        experience.evidence(), [(expected[..., p] >= 0).sum(axis=(0, 2)) for p in range(2)]
    )
    d = experience.training_set()
    assert len(d) == (expected >= 0).any(axis=-1).sum()
    np.testing.assert_array_equal(d.labels, expected[d.object, d.behavior, d.recording])
    words = [[told.get(o, {}).get(p, -1) for p in range(2)] for o in range(OBJECTS)]
    np.testing.assert_array_equal(experience.object_labels, words)


@given(
    seeds=st.lists(st.integers(0, 99), min_size=1, max_size=3), memory=st.booleans(), data=st.data()
)
def test_the_order_of_objects_does_not_matter(seeds, memory, data):
    own = {o: [] for o in range(OBJECTS)}  # an object's trials depend on its own past only
    for o, trials_of in own.items():
        past = empty(memory=memory)
        for seed in seeds:
            done = work(past, o, QUERIES[seed % len(QUERIES)], seed)
            labels = DATASET.labels[o, done.columns].astype(np.int8)
            past = past.absorb(TOY, done.trial, labels)
            trials_of.append((done.trial, labels))
    results = []
    for order in (sorted(list(own) * len(seeds)), data.draw(st.permutations([*own] * len(seeds)))):
        left, experience = {o: list(trials) for o, trials in own.items()}, empty(memory=memory)
        for o in order:
            experience = experience.absorb(TOY, *left[o].pop(0))
        results.append(experience)
    first, second = results
    for name in ("labels", "gathered", "used", "object_labels", "attempts"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_recordings_come_once_each_then_again_without_news():
    experience, shown = empty(), []
    for seed in range(8):
        done = work(experience, 1, ("red",), seed, budget=2.0)
        shown += [r for _, behavior, r in done.shown if behavior == "look"]
        experience = experience.absorb(TOY, done.trial, np.array([1], np.int8))
        seen = {*shown}
        assert (experience.labels[1, 0, :, 0] >= 0).sum() == len(seen)
        assert len(seen) == min(len(shown), RECORDINGS)
    assert len(shown) > RECORDINGS
    assert shown[RECORDINGS : 2 * RECORDINGS] == shown[: len(shown[RECORDINGS : 2 * RECORDINGS])]
    assert sorted(shown[:RECORDINGS]) == list(range(RECORDINGS))


def test_failed_executions_use_no_recording_and_are_counted():
    failures = 0
    for seed in range(20):
        done = work(empty(), 0, ("red",), seed)
        steps = [s for s in done.trial.steps if s.decision.action == 1]  # lift: x0 to x1
        experience = empty().absorb(TOY, done.trial, np.array([1], np.int8))
        perceived = sum(step.observation is not None for step in steps)
        failed = sum(step.next_x == step.x for step in steps)
        failures += failed
        assert experience.used[0, 1] == perceived
        assert experience.attempts[1, 0] <= failed
    assert failures > 0


@pytest.mark.statistical
def test_exhausted_recordings_do_not_bias_what_is_known_of_success():
    counted = np.zeros(2, int)
    for seed in range(300):  # of about eight lifts in a trial only three are perceived
        done = work(empty(), 0, ("red",), seed, budget=100.0)
        counted += empty().absorb(TOY, done.trial, np.array([1], np.int8)).attempts[1]
    share, n = counted[1] / counted.sum(), counted.sum()
    assert abs(share - 0.9) < 4 * np.sqrt(0.9 * 0.1 / n)


def test_pretraining_is_the_first_recording_of_every_behavior_labelled_for_all():
    experience = empty().pretrain(DATASET, np.array([0, 2]))
    assert experience.evidence().tolist() == [[2, 2, 0]] * 2
    d = experience.training_set()
    assert set(d.object.tolist()) == {0, 2}
    assert (d.recording == 0).all()
    np.testing.assert_array_equal(d.labels, DATASET.labels[d.object])
    np.testing.assert_array_equal(experience.object_labels[[1, 3]], -1)


def test_memory_labels_earlier_and_later_recordings():
    past, plain = empty(memory=True), empty()
    nothing = np.array([-1], np.int8)
    for seed, values in ((0, nothing), (1, np.array([1], np.int8)), (2, nothing)):
        trial = work(past, 0, ("red",), seed, budget=2.0).trial
        past, plain = past.absorb(TOY, trial, values), plain.absorb(TOY, trial, values)
    assert plain.gathered[0].sum() == past.gathered[0].sum() > plain.evidence()[0].sum() > 0
    np.testing.assert_array_equal(past.labels[0, ..., 0] == 1, past.gathered[0])


@pytest.fixture(scope="module")
def trial():
    return work(empty(), 0, ("red", "heavy"), 0).trial


class TestFeedback:
    @staticmethod
    def said(trial, report, truth, **options):
        trial = replace(
            trial,
            report=None if report is None else np.array(report, bool),
            truth=np.array(truth, bool),
        )
        return Feedback(**options).labels(trial, np.random.default_rng(0)).tolist()

    @pytest.mark.parametrize(
        ("report", "truth", "told"),
        [
            ([1], [1], [1]),
            ([1], [0], [0]),
            ([0], [1], [1]),
            ([0], [0], [0]),
            (None, [1], [-1]),
            ([1, 0], [1, 0], [1, 0]),
            ([1, 0], [1, 1], [-1, -1]),
            ([0, 1], [1, 0], [-1, -1]),
            (None, [1, 1], [-1, -1]),
        ],
    )
    def test_a_verdict_teaches_what_it_implies(self, trial, report, truth, told):
        assert self.said(trial, report, truth) == told

    @pytest.mark.parametrize("report", [[1, 0], [0, 0], None])
    def test_all_answers_teach_everything(self, trial, report):
        assert self.said(trial, report, [0, 1], answers="all") == [0, 1]

    @pytest.mark.statistical
    @pytest.mark.parametrize("answers", ["verdict", "all"])
    def test_people_err_as_often_as_said(self, trial, answers):
        one = replace(trial, report=np.array([True]), truth=np.array([True]))
        feedback, rng, n = Feedback(answers, 0.2), np.random.default_rng(1), 4000
        wrong = sum(feedback.labels(one, rng)[0] == 0 for _ in range(n))
        assert abs(wrong / n - 0.2) < 5 * np.sqrt(0.2 * 0.8 / n)

    def test_an_erring_verdict_on_two_attributes_labels_the_wrong_report(self, trial):
        two = replace(trial, report=np.array([True, False]), truth=np.array([True, True]))
        feedback, rng = Feedback("verdict", 0.5), np.random.default_rng(1)
        labels = {tuple(feedback.labels(two, rng).tolist()) for _ in range(50)}
        assert labels == {(-1, -1), (1, 0)}

    @pytest.mark.parametrize(
        ("wrong", "message"),
        [
            ({"answers": "verdikt"}, "did you mean 'verdict'"),
            ({"error": 1.0}, "give 0 to below 1"),
            ({"error": -0.1}, "give 0 to below 1"),
            ({"error": float("nan")}, "give 0 to below 1"),
        ],
    )
    def test_settings_are_checked(self, wrong, message):
        with pytest.raises(SettingsError, match=message):
            Feedback(**wrong)


def test_recordings_that_are_not_there_are_never_handed_out():
    features = {context: values.copy() for context, values in DATASET.features.items()}
    for (behavior, _), values in features.items():
        values[(0, slice(1, None)) if behavior == "look" else 1] = np.nan
    ragged = replace(DATASET, features=features)
    experience = Experience.none(ragged, np.random.default_rng(3))
    for o in range(OBJECTS):
        for e, count in enumerate(ragged.recording_counts[o, :2]):
            assert sorted(experience.supply(o)[e]) == list(range(count))
    after = experience
    for o in range(2):
        trial = work(after, o, ("red",), seed=o).trial
        after = after.absorb(TOY, trial, np.array([1], np.int8))
    taught = after.pretrain(ragged, np.arange(OBJECTS)).recordings()
    assert len(taught) >= 2 * OBJECTS - 1
    assert (taught.recording < ragged.recording_counts[taught.object, taught.behavior]).all()
