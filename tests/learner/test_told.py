"""What people told, in several folders: it holds in the order in which it was told."""

import copy
import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes import Learner, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.learner import recall
from meal_bayes.trial_log import Logs
from meal_bayes.trial_log.names import feedback_files

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
    labels = {name: int(learner.experience.known.values[o, 0]) for name, o in names.items()}
    return {name: label for name, label in labels.items() if label >= 0}


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
        assert len(recall(heir, tmp_path)) == 1


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
    with pytest.warns(UserWarning, match="Features of look are of color; .*left aside"):
        recall(heir, tmp_path)
    assert not any(heir.experience.features.values())
