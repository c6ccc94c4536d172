"""What users give to a learner that cannot be meant: one error of the package, and no trial."""

import inspect

import numpy as np
import pytest

from meal_bayes import Learner, MealBayesError, ask, load_domain, load_percepts, read_query
from meal_bayes.domain import read_event
from meal_bayes.errors import SettingsError
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.planners import Decision, RandomLegal

OBJECTS = ("light_blue_beans", "heavy_blue_beans")


@pytest.fixture(scope="module")
def learner():
    table = load_percepts("roc36")
    return Learner(table.domain, agent="greedy", logs=None).fit(table)


@pytest.mark.parametrize(
    "question", ["not heavy", "heavy and blue", "light or heavy", "neither red nor heavy", "heavy"]
)
def test_an_answer_is_by_what_was_asked(learner, question):
    trial = learner.ask(question, OBJECTS[1], answer="yes or no")
    words = read_event(question, learner.domain).text.removesuffix("?")
    assert trial.answer == {words: bool(trial.report[0])}
    assert 0 < trial.probability < 1
    assert trial.report[0] == (trial.probability > 0.5)


@pytest.mark.parametrize("options", [{"answer": "yes or no"}, {"payoffs": (1, -1, 1, -1)}])
def test_a_query_says_itself_how_it_is_answered(learner, options):
    query = read_query("heavy, blue", learner.domain)
    for question in (query, learner.task(query, OBJECTS[0])):
        with pytest.raises(SettingsError, match="already contains the kind of answer"):
            learner.ask(question, OBJECTS[0], **options)


BY_NAME = {
    "seed": 3,
    "horizon": 7.0,
    "refit_every": None,
    "learn_success": False,
    "label_accuracy": 0.9,
    "reward": 100.0,
    "percepts": "model",
    "classifier": "any",
    "payoffs": (1, -1, 1, -1),
    "posterior": "any.nc",
}


@pytest.mark.parametrize("name", BY_NAME)
def test_settings_are_one_value_or_by_name(name):
    """One of two ways would be ignored, and a seed is not seen to be."""
    with pytest.raises(SettingsError, match=f"{name} by name"):
        Learner("roc36", logs=None, settings=LearnerSettings(), **{name: BY_NAME[name]})


def test_all_settings_by_name_are_known():
    options = inspect.signature(Learner).parameters
    assert {*BY_NAME} == {*options} - {"domain", "agent", "logs", "settings"}


def test_settings_may_be_repeated_by_name_as_they_are_by_default():
    settings = LearnerSettings(seed=4, reward=7.0)
    assert Learner("roc36", logs=None, settings=settings, refit_every=0.2).settings == settings


@pytest.mark.parametrize("name", ["roc36", "toy"])
def test_a_reward_that_is_not_set_is_the_domain_s(name, tmp_path):
    domain = load_domain(name)
    learner = Learner(domain, agent="prior", logs=None, settings=LearnerSettings(seed=1))
    learner.save(tmp_path / "saved")
    named = Learner(domain, agent="prior", logs=None, seed=1)
    loaded = Learner.load(tmp_path / "saved", logs=None)
    for each in (learner, named, loaded):
        assert each.settings == learner.settings
        assert each.settings.reward == domain.report_reward


@pytest.mark.parametrize("settings", [{"seed": 3}, 5, "fast", LearnerSettings])
def test_settings_of_another_kind_are_refused(settings):
    with pytest.raises(SettingsError, match="LearnerSettings"):
        Learner("roc36", logs=None, settings=settings)


def test_two_objects_are_not_one(learner):
    with pytest.raises(SettingsError, match="give one"):
        learner.ask("heavy", OBJECTS[0], object_name=OBJECTS[1])
    with pytest.raises(SettingsError, match="not about"):
        learner.ask(learner.task("heavy", OBJECTS[0]), OBJECTS[1])
    assert learner.ask("heavy", OBJECTS[0], object_name=OBJECTS[0]).task.object_name == OBJECTS[0]


class Silent:
    """A planner that forgets to return its policy, or whose policy forgets the decision."""

    def __init__(self, policy, decision):
        self.policy = policy
        self.decision = decision

    def solve(self, momdp, rng):
        return self if self.policy else None

    def decide(self, history, rng):
        return self.decision


def choosing(action):
    nothing = np.full(2, np.nan)
    return Decision(action, nothing, nothing, np.zeros(2, int))


@pytest.mark.parametrize(
    ("agent", "says"),
    [
        (Silent(False, None), "expected a policy"),
        (Silent(True, None), "expected a Decision"),
        (Silent(True, 0), "expected a Decision"),
        (Silent(True, "look"), "expected a Decision"),
        *((Silent(True, choosing(action)), "its index") for action in ("look", 1.0, None, True)),
        (lambda domain, query: None, "expected an object with a method solve"),
        (RandomLegal.solve, "function of domain and query"),
        (dict, "function of domain and query|expected an object with a method solve"),
    ],
)
def test_a_planner_that_plans_nothing_is_told(agent, says):
    with pytest.raises(SettingsError, match=says):
        ask("heavy", dataset="roc36", object=OBJECTS[0], agent=agent, logs=None)


def test_a_robot_can_start(dataset, make):
    learner = make.learner(dataset, "greedy")
    for robot in (type("Arm", (), {"execute": print})(), type("Arm", (), {"start": print})(), 5):
        with pytest.raises(SettingsError, match=r"start\(\) and execute\(behavior\)"):
            learner.ask("red", robot)


@pytest.mark.parametrize("value", ["3", float("nan"), float("inf"), -1])
@pytest.mark.parametrize("name", ["reward", "horizon", "refit_every", "percepts", "seed"])
def test_settings_that_mean_nothing_are_told(name, value):
    never = name == "refit_every" and value == float("inf")
    if never:
        return
    with pytest.raises(MealBayesError, match=name):
        Learner("toy", logs=None, **{name: value})
