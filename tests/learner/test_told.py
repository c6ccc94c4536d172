"""What people told, in several folders: it holds in the order in which it was told."""

import contextlib
import copy
import itertools
import warnings
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meal_bayes import Learner, Outcome, load_domain, load_percepts
from meal_bayes.errors import LogError, QueryError, SettingsError
from meal_bayes.learner import recall
from meal_bayes.learner.views import labeled_table
from meal_bayes.trial_log import Logs
from meal_bayes.trial_log import file as log_file
from meal_bayes.trial_log import folder as log_folder
from meal_bayes.trial_log.folder import feedback_files
from meal_bayes.trials.text import UNFINISHED

TELLINGS = st.lists(
    st.tuples(st.integers(0, 1), st.sampled_from(("mug", "cup")), st.booleans()), max_size=6
)


def begun(dataset, make, folder):
    """Return a learner that has met one object and logs in a folder."""
    learner = Learner(dataset.domain, agent=make.agent("look"), logs=folder)
    learner.ask("red", make.arm(), object_name="mug")
    return learner


def red(learner):
    """Return what is held of each object's color."""
    names = learner.experience.objects
    labels = {name: int(learner.experience.object_labels.values[o, 0]) for name, o in names.items()}
    return {name: label for name, label in labels.items() if label >= 0}


@pytest.mark.filterwarnings("ignore:There is no recording")
@given(tellings=TELLINGS)
@settings(max_examples=max(settings().max_examples // 5, 4))
def test_the_order_of_folders_plays_no_part(dataset, make, tmp_path_factory, tellings):
    """Nor does it undo what the learner has told since, that recalls its own logs."""
    place = tmp_path_factory.mktemp("days")
    folders = [place / "one", place / "two"]
    robots = [begun(dataset, make, folder) for folder in folders]
    own = [{}, {}]
    held = {}
    for robot, name, value in tellings:
        robots[robot].tell(name, {"red": value})
        if own[robot].get(name) != value:  # what moves nothing is not logged
            held[name] = own[robot][name] = value
    for order in itertools.permutations(folders):
        heir = Learner(dataset.domain, agent=make.agent("look"), logs=None)
        recall(heir, *order)
        recall(heir, *reversed(order))
        assert red(heir) == held
    for robot, folder in zip(robots, folders, strict=True):
        before = red(robot)
        recall(robot, folder)
        assert red(robot) == before


def test_a_label_of_yesterday_replaces_none_of_today(dataset, make, tmp_path):
    yesterday = begun(dataset, make, tmp_path / "one")
    yesterday.tell("mug", {"red": True})
    yesterday.save(tmp_path / "mind")
    agent = make.agent("look")
    today = Learner.load(tmp_path / "mind", agent=agent, logs=tmp_path / "two")
    today.tell("mug", {"red": False})
    recall(today, tmp_path / "one")
    assert red(today) == {"mug": 0}


def test_labels_of_a_recalled_trial_are_beside_its_log(dataset, make, tmp_path):
    begun(dataset, make, tmp_path / "one")
    heir = Learner(dataset.domain, agent=make.agent("look"), logs=tmp_path / "two")
    (trial,) = recall(heir, tmp_path / "one")
    heir.tell(trial, {"red": True})
    assert [trial.truth.tolist() for trial in Logs(tmp_path / "one").trials()] == [[1]]
    silent = Learner(dataset.domain, agent=make.agent("look"), logs=None)
    (trial,) = recall(silent, tmp_path / "one")
    silent.forget(trial)
    assert [trial.truth.tolist() for trial in Logs(tmp_path / "one").trials()] == [[1]]


def test_a_label_that_cannot_be_read_is_named(dataset, make, tmp_path):
    learner = begun(dataset, make, tmp_path)
    learner.tell("mug", {"red": True})
    (file,) = feedback_files(tmp_path / dataset.domain.name)
    file.write_bytes(file.read_bytes()[:200])
    heir = Learner(dataset.domain, agent=make.agent("look"), logs=None)
    with pytest.warns(UserWarning, match=file.name):
        recall(heir, tmp_path)
    assert red(heir) == {}


def test_a_trial_that_is_under_way_elsewhere_is_no_damage(dataset, make, tmp_path):
    """Warnings are errors here."""
    learner = begun(dataset, make, tmp_path)
    heir = Learner(dataset.domain, agent=make.agent("look"), logs=None)
    with learner.begin("red", object_name="cup"):
        assert [trial.ended for trial in recall(heir, tmp_path)] == ["", UNFINISHED]


def renamed(make, **changes):
    """Return the kitchen after somebody edited its file."""
    table = copy.deepcopy(make.kitchen)
    for name, value in changes.items():
        if name == "modalities":
            table["behaviors"][0]["modalities"] = value
        else:
            table[name] = value
    return load_domain(table)


@pytest.mark.parametrize("attributes", [["full"], ["crimson", "full"], ["Red"]])
def test_trials_about_what_a_domain_lacks_are_refused_as_a_whole(
    dataset, make, tmp_path, attributes
):
    learner = begun(dataset, make, tmp_path)
    learner.ask("full", make.arm(), object_name="cup")
    for files in ([tmp_path], sorted(tmp_path.rglob("*.mcap"), reverse=True)):
        heir = Learner(renamed(make, attributes=attributes), agent="greedy", logs=None)
        with pytest.raises(SettingsError, match="Load the domain of that trial"):
            recall(heir, *files)
        assert len(heir.experience.trials) == len(heir.experience.executions) == 0


@pytest.mark.parametrize("modalities", [[], ["depth"], ["color", "depth"]])
def test_features_of_other_modalities_are_named(dataset, make, tmp_path, modalities):
    begun(dataset, make, tmp_path)
    heir = Learner(renamed(make, modalities=modalities), agent=make.agent("look"), logs=None)
    with pytest.warns(UserWarning, match="features of look have the modalities color; .*ignored"):
        recall(heir, tmp_path)
    assert not any(heir.experience.features.values())


class Clock(datetime):
    """A clock that people set."""

    seconds = 0.0

    @classmethod
    def now(cls, tz=None):
        return datetime(2026, 3, 29, 1, 59, 59, tzinfo=tz) + timedelta(seconds=cls.seconds)


def full(*paths):
    raise OSError(28, "No space left on device")


@pytest.mark.filterwarnings("ignore:There is no recording")
@given(
    tellings=st.lists(
        st.tuples(
            st.sampled_from((0, 1, "mug", "cup")),  # a trial, or an object by its name
            st.sampled_from((True, False, None)),  # None: what was told is taken back
            st.sampled_from((0.0, 3.5, -3600.0, -86400.0, 1e9)),  # the clock is set by so much
            st.sampled_from(("", "full", "restart")),
        ),
        max_size=7,
    )
)
@example(tellings=[(0, True, 0.0, ""), (0, False, -3600.0, "")])
@example(tellings=[(0, True, 0.0, ""), (0, False, -3600.0, "restart")])
@example(tellings=[(0, True, 0.0, "full"), (0, True, 0.0, "")])
@example(tellings=[("mug", True, 0.0, ""), ("mug", None, 0.0, "full"), ("cup", True, 0.0, "")])
@settings(max_examples=max(settings().max_examples // 5, 4))
def test_neither_a_clock_that_is_set_nor_a_full_disk_moves_a_label(
    dataset, make, tmp_path_factory, tellings
):
    folder = tmp_path_factory.mktemp("logs")
    agent = make.agent("look")
    Clock.seconds = 0.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log_folder, "datetime", Clock)
        patch.setattr(log_folder, "_chosen_last", [""])
        live = Learner(dataset.domain, agent=agent, logs=folder)
        trials = [live.ask("red", make.arm(), object_name="mug") for _ in range(2)]
        for whose, value, set_by, event in [*tellings, ("vase", True, 0.0, "")]:
            Clock.seconds += set_by
            if event == "restart":  # another process, that remembers no name
                log_folder._chosen_last[0] = ""
            trial = trials[whose] if isinstance(whose, int) else whose
            with pytest.MonkeyPatch.context() as disk:
                if event == "full":
                    disk.setattr(log_file, "name_new", full)
                with contextlib.suppress(SettingsError, LogError):
                    if value is None:
                        live.forget(trial)
                    else:
                        live.tell(trial, {"red": value})
        live.ask("red", make.arm(), object_name="last")
    logged = [trial.task.object_name for trial in Logs(folder).trials()]
    assert logged == ["mug", "mug", "last"]
    heir = Learner(dataset.domain, agent=agent, logs=None)
    recall(heir, folder)
    assert red(heir) == red(live)
    for trial in trials:
        told = [each.experience.labels_of_trial(trial.task.key).tolist() for each in (live, heir)]
        assert told[0] == told[1]


@pytest.mark.parametrize("restarts", [0, 1, 2])
def test_a_full_disk_says_that_the_label_is_learned(dataset, make, tmp_path, monkeypatch, restarts):
    """The next call logs it, also if the learner was saved and loaded in between."""
    learner = begun(dataset, make, tmp_path / "logs")
    monkeypatch.setattr(log_file, "name_new", full)
    with pytest.raises(LogError, match=r"No space left.*was learned, but not logged"):
        learner.tell("mug", {"red": True})
    with pytest.raises(LogError):
        learner.refit()
    assert red(learner) == {"mug": 1}
    monkeypatch.undo()
    for number in range(restarts):
        learner.save(tmp_path / f"{number}.mind")
        logs = None if number == 0 and restarts == 2 else tmp_path / "logs"
        learner = Learner.load(tmp_path / f"{number}.mind", agent=make.agent("look"), logs=logs)
    learner.tell("mug", {"red": True})
    heir = Learner(dataset.domain, agent=make.agent("look"), logs=None)
    recall(heir, tmp_path / "logs")
    assert red(heir) == {"mug": 1}
    assert len(feedback_files(tmp_path / "logs" / dataset.domain.name)) == 2
    assert not learner.experience.unlogged


@given(
    events=st.lists(
        st.tuples(
            st.integers(0, 1),  # which robot
            st.sampled_from((0, 1, "mug", "recall")),  # the trial of a robot, an object, its logs
            st.sampled_from((True, False, None)),  # None: what was told is taken back
        ),
        max_size=8,
    )
)
@example(events=[(0, "mug", True), (1, "mug", False)])
@example(events=[(0, 0, True), (1, 0, True), (1, 0, None)])
@settings(max_examples=max(settings().max_examples // 5, 4))
def test_two_robots_that_recall_each_other_hold_the_same(dataset, make, tmp_path_factory, events):
    """The latest word holds, whoever said it, and whenever the other heard of it."""
    folder = tmp_path_factory.mktemp("logs")
    robots = [Learner(dataset.domain, agent=make.agent("look"), logs=folder) for _ in range(2)]
    trials = [robot.ask("red", make.arm(), object_name="mug") for robot in robots]
    for number, whose, value in events:
        robot = robots[number]
        if whose == "recall":
            recall(robot, folder)
            continue
        trial = trials[whose] if isinstance(whose, int) else whose
        with contextlib.suppress(SettingsError):
            if value is None:
                robot.forget(trial)
            else:
                robot.tell(trial, {"red": value})
    heir = Learner(dataset.domain, agent=make.agent("look"), logs=None)
    for learner in (*robots, heir):
        recall(learner, folder)
    for robot in robots:
        assert red(robot) == red(heir)
        for key in (*(trial.task.key for trial in trials), ("told", "mug")):
            told = [each.experience.labels_of_trial(key).tolist() for each in (robot, heir)]
            assert told[0] == told[1]


@pytest.mark.parametrize("name", ["mug", "Mug", "other cup"])
def test_labels_of_objects_of_which_nothing_was_perceived_are_no_typos(name):
    learner = Learner("toy", agent="bayes", logs=None)
    session = learner.begin("red", object_name="mug")
    session.fail()
    session.cancel()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        learner.tell(name, {"red": True})
    assert learner.experience.met


def test_a_name_that_differs_by_case_is_named():
    learner = Learner("toy", agent="bayes", logs=None)
    session = learner.begin("red", object_name="Mug")
    session.observe(Outcome("x0", percepts={"red": True}))
    session.cancel()
    with pytest.warns(UserWarning, match=r"no recording of 'mug'; did you mean 'Mug'\?"):
        learner.tell("mug", {"red": True})


COLORS = ["brown", "green", "blue"]


@pytest.fixture(scope="module")
def partly_labeled():
    """Return roc36's table, whose first object is only known not to be brown."""
    table = load_percepts("roc36")
    labels = np.array(table.labels)
    labels[0] = -1
    labels[0, table.domain.columns(["brown", "heavy"])] = 0
    return replace(table, labels=labels)


@given(
    told=st.lists(
        st.dictionaries(st.sampled_from([*COLORS, "light", "heavy"]), st.booleans(), min_size=1),
        max_size=4,
    ),
    given_first=st.booleans(),
)
@example(told=[{"brown": True}], given_first=False)
@example(told=[{"green": False, "blue": False}], given_first=False)
@example(told=[{"heavy": True}, {"light": True}], given_first=True)
def test_a_label_replaces_that_of_a_percept_table(partly_labeled, told, given_first):
    """As it replaces any earlier one; what is impossible beside the table is refused at once."""
    table = partly_labeled
    domain, name = table.domain, table.objects[0]
    learner = Learner(domain, agent="prior", logs=None)
    if given_first:
        learner.experience.add_labels(
            ("told", name), name, domain.labels({"brown": True}), given=True
        )
    learner.fit(table)
    expected = np.array(table.labels[0])
    for values in told:
        try:
            labels = domain.labels(values)
            expected = domain.replace(expected, labels)
        except QueryError:
            with pytest.raises(QueryError):
                learner.tell(name, values)
        else:
            learner.tell(name, values)
    labels = labeled_table(learner.experience, table).labels
    np.testing.assert_array_equal(labels[0], expected)
    np.testing.assert_array_equal(labels[1:], table.labels[1:])
    learner.ask("heavy", table.objects[1])
