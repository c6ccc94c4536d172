"""A detector's scores are percepts: learned from, saved, logged and recalled like any other."""

from pathlib import Path

import numpy as np
import pytest

from meal_bayes import Learner, Outcome, recall
from meal_bayes.errors import ConformanceError
from meal_bayes.planners import unvalued
from meal_bayes.testing import check_robot

pytestmark = [
    pytest.mark.filterwarnings("ignore:'lift' yielded nothing several times"),
    pytest.mark.filterwarnings("ignore:'look' moved nothing"),
]
KITCHEN = Path(__file__).parents[2] / "examples" / "kitchen.toml"
LOOK = 0


class Scoring:
    """A robot whose camera gives a number for how red a cup is."""

    def __init__(self, red, rng, *, sign=1.0, scale=1.0):
        self.red = red
        self.rng = rng
        self.sign = sign
        self.scale = scale

    def start(self):
        return "table"

    def execute(self, behavior):
        state = "held" if behavior == "lift" else "table"
        if behavior != "look":
            return Outcome(state)
        score = 1 / (1 + np.exp(-self.sign * self.rng.normal(2.0 * self.red, 1.0)))
        return Outcome(state, percepts={"red": self.scale * score})


def taught(learner, n=14, seed=0, **options):
    """Ask about cups, and tell what they were."""
    rng = np.random.default_rng(seed)
    for _ in range(n):
        red = bool(rng.random() < 0.5)
        learner.tell(learner.ask("Is it red?", Scoring(red, rng, **options)), {"red": red})
    return learner


def look(session, score):
    """Let a session look, whose camera gives a score."""
    session.command(unvalued(session.momdp, LOOK))
    session.observe(Outcome("table", percepts={"red": score}))


def new(logs=None):
    return Learner(KITCHEN, reward=100, logs=logs)


def same(one, other):
    """Return whether two learners know the same."""
    first, second = (learner._fits.of(learner.agent) for learner in (one, other))
    np.testing.assert_array_equal(one.experience.scores.values, other.experience.scores.values)
    np.testing.assert_array_equal(first.edges, second.edges)
    np.testing.assert_array_equal(first.levels.values, second.levels.values)
    ours, theirs = one.knowledge(), other.knowledge()
    return ours == theirs


def test_a_detector_of_scores_is_learned_and_is_right():
    learner = taught(new())
    known = learner.knowledge().posterior
    assert not known.given.any()  # labels decide
    assert known.youden[0, LOOK] > 0.3
    rng = np.random.default_rng(5)
    right = [
        learner.ask("Is it red?", Scoring(red, rng), learn=False).answer == {"red": red}
        for red in [True, False] * 10
    ]
    assert sum(right) >= 15


@pytest.mark.long
def test_the_scale_of_the_scores_changes_nothing_learned():
    levels = []
    for scale in (1.0, 40.0):
        learner = taught(new(), scale=scale)
        levels.append(learner._fits.of(learner.agent).levels.values)
    np.testing.assert_array_equal(*levels)


def test_what_was_scored_is_known_after_saving_and_from_the_logs(tmp_path):
    learner = taught(new(tmp_path / "logs"))
    learner.save(tmp_path / "mind")
    assert same(learner, Learner.load(tmp_path / "mind", logs=None))
    recalled = new()
    assert len(recall(recalled, tmp_path / "logs")) == 14
    assert same(learner, recalled)
    # The scores themselves are kept, so that all of it may be cut anew.
    assert same(learner.refit(), recalled.refit())


def test_the_first_scores_move_no_belief_and_are_no_failure():
    learner = new()
    session = learner.begin("Is it red?", "cup", state="table", commanded=True)
    look(session, 0.9)
    assert session.belief.positive == pytest.approx(1 / 3, abs=0.01)
    assert not session.steps[-1].warning
    session.cancel()
    rows = learner.experience.executions.values
    assert rows["success"].tolist() == [1]
    assert learner.experience.scores.values[:, 0].tolist() == [0.9]
    session = learner.begin("Is it red?", "mug", state="table", commanded=True)
    look(session, 0.95)
    assert session.steps[-1].observation.tolist() == [2]  # more than the only one before
    session.cancel()


def test_labels_by_name_teach_of_scores_that_came_before():
    learner = new()
    rng = np.random.default_rng(3)
    for number in range(8):
        session = learner.begin("Is it red?", f"cup {number}", state="table", commanded=True)
        look(session, float(rng.random()))
        session.cancel()
    for number in range(8):
        learner.tell(f"cup {number}", {"red": bool(number % 2)})
    assert learner.knowledge().posterior.counts[0, LOOK].sum() == 8


def test_scores_that_fall_where_it_is_true_are_told():
    learner = new()
    for number in range(12):
        session = learner.begin("Is it red?", f"cup {number}", state="table", commanded=True)
        look(session, 0.01 if number % 2 else 0.99)
        session.cancel()

    def tell():
        for number in range(12):
            learner.tell(f"cup {number}", {"red": bool(number % 2)})

    with pytest.warns(UserWarning, match=r"'red' by look are lower if it is true.*negative"):
        tell()


def test_another_scale_is_told_in_a_trial_with_both_ranges():
    learner = new()
    rng = np.random.default_rng(0)
    for number in range(12):
        session = learner.begin("Is it red?", f"cup {number}", state="table", commanded=True)
        look(session, float(rng.random()))
        session.cancel()
    held = len(learner.experience.instances)
    session = learner.begin("Is it red?", "mug", state="table", commanded=True)
    with pytest.warns(UserWarning, match=r"look.*'red' is the score 88.*before were from"):
        look(session, 88.0)
    assert "another scale" in session.steps[-1].warning
    assert len(learner.experience.instances) == held
    session.cancel()


def test_check_robot_takes_scores_and_tells_what_is_none():
    class Driver(Scoring):
        def execute(self, behavior):
            outcome = super().execute(behavior)
            if behavior == "lift":
                return Outcome("held", percepts={"full": 0.2})
            return outcome

    rng = np.random.default_rng(0)
    check_robot(Driver(True, rng), KITCHEN)
    with pytest.raises(ConformanceError, match=r"'red' is nan"):
        check_robot(Driver(True, rng, scale=np.nan), KITCHEN)

    class Changing(Driver):
        scores = 0

        def execute(self, behavior):
            self.scores += 1
            self.scale = 1.0 if self.scores < 30 else 100.0
            return super().execute(behavior)

    with pytest.raises(ConformanceError, match="another scale"):
        check_robot(Changing(True, rng), KITCHEN)
