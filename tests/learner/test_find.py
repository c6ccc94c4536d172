"""`Learner.find` asks about one object after another, until one answer is yes."""

import pytest

from meal_bayes import Learner, MealBayesError, load_percepts
from meal_bayes.domain import Query
from meal_bayes.errors import DataError, QueryError, RobotError, SettingsError
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import read_trials

pytestmark = pytest.mark.filterwarnings("ignore:There is no recording")

BOXES = ["light_blue_beans", "medium_brown_rice", "heavy_green_glass", "heavy_blue_beans"]


class Untold:
    """A robot that is not to be asked."""

    def start(self):
        raise AssertionError

    execute = start


@pytest.fixture(scope="module")
def replaying():
    return Learner("roc36", agent="olfc", logs=None).fit(load_percepts("roc36"))


@pytest.fixture(scope="module")
def found(replaying, tmp_path_factory):
    folder = tmp_path_factory.mktemp("found")
    return replaying.find("Which one is heavy and blue?", BOXES, log=folder), folder


def test_it_ends_with_the_first_yes(found):
    result, _ = found
    *others, last = result.trials
    assert result.object_name == last == "heavy_blue_beans"
    assert all(not result.trials[name].report[0] for name in others)
    assert result.trials[last].report[0]
    assert result.success is True
    assert result.probability == result.trials[last].probability > 0.9
    assert result.cost == sum(trial.cost for trial in result.trials.values())
    assert "heavy_blue_beans" in repr(result)


def test_trials_are_ordinary_logs_in_one_folder(found):
    result, folder = found
    names = [f"{n:02d}-{name}.mcap" for n, name in enumerate(result.trials, start=1)]
    assert sorted(path.name for path in folder.iterdir()) == names
    again = {trial.task.object_name: trial for trial in read_trials(folder)}
    assert list(again) == list(result.trials)
    for name, trial in again.items():
        assert trial.cost == result.trials[name].cost
        assert trial.report.tolist() == result.trials[name].report.tolist()


def test_of_none_all_are_asked(replaying):
    light = ["light_blue_beans", "light_blue_rice"]
    result = replaying.find("Which one is heavy and blue?", light)
    assert result.object_name is None
    assert set(result.trials) == set(light)
    assert result.success is True
    no = [1.0 - trial.probability for trial in result.trials.values()]
    assert result.probability == pytest.approx(no[0] * no[1])


def test_labels_of_the_named_objects_teach_nothing(replaying):
    """Left out alone, the one object that is blue would expect it least of all."""
    trials = replaying.find("blue", BOXES, max_steps=0).trials.values()
    priors = {float(trial.first_belief.positive[0]) for trial in trials}
    assert len(priors) == 1


def test_the_most_probable_object_is_asked_first(dataset, make):
    learner = make.learner(dataset, make.agent("look", memory=True))
    learner.tell("mug", {"red": False})
    learner.tell("pot", {"red": True})
    cups = {"mug": make.arm(), "cup": make.arm(), "pot": make.arm(red=True)}
    result = learner.find("red", cups, learn=False, payoffs=(60, -60, 60, -6000))
    assert next(iter(result.trials)) == "pot"


def test_each_trial_begins_where_its_robot_is(dataset, make):
    class Holding(type(make.arm())):
        def start(self):
            self.state = "held"
            return self.state

    result = make.learner(dataset, make.agent("reset", "look")).find(
        "red", {"mug": make.arm(), "pot": Holding()}, payoffs=(1, -1000, 0, 0)
    )
    states = {name: trial.momdp.x_names[trial.steps[0].x] for name, trial in result.trials.items()}
    assert states["pot"] == "held"


def test_truth_and_lessons_are_those_of_each_trial(dataset, make):
    learner = make.learner(dataset, make.agent("look"))
    cups = {"mug": make.arm(), "pot": make.arm()}
    result = learner.find("red", cups, truth={"mug": {"red": False}}, payoffs=(1, -1000, 0, 0))
    assert result.object_name is None
    assert result.success is None
    assert [trial.success for trial in result.trials.values()] == [True, None]
    assert {trial.task.key for trial in result.trials.values()} <= set(learner.experience.trials)


def test_a_fault_of_a_robot_is_raised(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent("look"))
    with pytest.raises(RobotError, match="nowhere"):
        learner.find("red", {"mug": make.faulty(Outcome("nowhere"))}, log=tmp_path)
    (trial,) = read_trials(tmp_path)
    assert "nowhere" in trial.ended


@pytest.mark.parametrize(
    ("question", "objects", "error", "message"),
    [
        ("purple", BOXES, QueryError, "purple"),
        ("blue", [], SettingsError, "objects"),
        ("blue", "heavy_blue_beans", SettingsError, "objects"),
        ("blue", [BOXES[0], BOXES[0]], SettingsError, BOXES[0]),
        ("blue", ["nothing"], SettingsError, "nothing"),
        (Query(("heavy", "blue")), BOXES, QueryError, "yes-or-no"),
    ],
)
def test_what_cannot_be_searched_is_told_at_once(replaying, question, objects, error, message):
    with pytest.raises(error, match=message):
        replaying.find(question, objects)


def test_a_file_is_no_folder(replaying, tmp_path):
    with pytest.raises(SettingsError, match=r"a\.mcap"):
        replaying.find("blue", BOXES, log=tmp_path / "a.mcap")


@pytest.mark.parametrize(
    ("truth", "error", "message"),
    [
        ({"nothing": {"blue": True}}, SettingsError, "Unknown object 'nothing'"),
        ({BOXES[0]: {"bleu": True}}, QueryError, "blue"),
        ({BOXES[0]: {"blue": 0.5}}, DataError, "blue"),
        ({BOXES[1]: {"blue": True}, "": {}}, SettingsError, "Unknown object"),
        ("blue", SettingsError, "give {object"),
    ],
)
def test_a_misspelled_truth_is_told_before_a_robot_moves(replaying, truth, error, message):
    with pytest.raises(error, match=message):
        replaying.find("blue", BOXES, truth=truth)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ({"pot": 5}, "start\\(\\)"),
        ({"pot": "mug"}, "start\\(\\)"),
        ({"pot": Untold}, "start\\(\\)"),
        ({"pot": None}, "Give a robot"),
        ({5: Untold()}, "text"),
        ({"": Untold()}, "name"),
        ({"mug ": Untold()}, "name"),
        ({"cup  1": Untold()}, "cannot be seen"),
    ],
)
def test_what_is_no_robot_is_told_before_one_moves(dataset, make, second, message):
    arm = make.arm()
    with pytest.raises(MealBayesError, match=message):
        make.learner(dataset, "greedy").find("red", {"mug": arm, **second})
    assert not arm.executed


def test_a_wrong_truth_is_told_before_a_robot_moves(dataset, make):
    arms = {"mug": make.arm(), "pot": make.arm()}
    for truth in ([1, 0], "no"):
        with pytest.raises(MealBayesError, match="truth"):
            make.learner(dataset, "greedy").find("red", arms, truth={"mug": [1], "pot": truth})
    assert not any(arm.executed for arm in arms.values())


@pytest.mark.parametrize("objects", [[1, 2], [None], [BOXES[0], b"mug"], {1: None}])
def test_objects_are_named_by_text(replaying, objects):
    with pytest.raises(SettingsError, match="text"):
        replaying.find("blue", objects)
