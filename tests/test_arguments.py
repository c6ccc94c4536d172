"""What a domain, a path of a table and a number may be, at every function that takes one."""

import numpy as np
import pytest

import meal_bayes as mb
from meal_bayes import agents, datasets, evaluation, learner, momdp, planners, trials
from meal_bayes.datasets import make_synthetic
from meal_bayes.domain import read_event, read_question
from meal_bayes.errors import MealBayesError, SettingsError
from meal_bayes.testing import check_robot


class Still:
    """A driver of the toy domain that stays where it is, and senses nothing."""

    def start(self):
        return "x0"

    def execute(self, behavior):
        return mb.Outcome("x0")


DOMAIN_TAKERS = {
    "check_robot": lambda domain: check_robot(Still(), domain, trials=1, steps=1),
    "make_synthetic": lambda domain: make_synthetic(
        domain, objects=4, recordings=2, rng=np.random.default_rng(0)
    ),
    "from_frames": lambda domain: mb.Dataset.from_frames(
        domain, {("look", "vision"): {"cup": np.ones((1, 2))}}, {"cup": {}}
    ),
    "build_momdp": lambda domain: mb.build_momdp(
        domain, mb.Query(("heavy",)), np.full((1, 2, 2, 2), 0.5)
    ),
    "read_query": lambda domain: mb.read_query("heavy", domain),
    "read_event": lambda domain: read_event("not heavy", domain),
    "read_question": lambda domain: read_question("heavy", domain),
    "Learner": lambda domain: mb.Learner(domain, logs=None).domain,
    "load_percepts": lambda domain: mb.load_percepts("roc36", domain=domain),
}


def what(function, domain):
    """Return what a function makes of a domain: a value, or an error, as text."""
    try:
        return repr(function(domain))
    except MealBayesError as fault:
        return str(fault)


@pytest.mark.parametrize("name", DOMAIN_TAKERS)
def test_whatever_takes_a_domain_takes_it_as_a_learner_does(name, tmp_path):
    shipped = "roc36" if name == "load_percepts" else "toy"
    path = tmp_path / "own.toml"
    path.write_text(f'extends = "{shipped}"')
    function = DOMAIN_TAKERS[name]
    expected = what(function, mb.load_domain(shipped))
    for domain in (shipped, str(path), path, {"extends": shipped}):
        assert what(function, domain) == expected


def test_a_table_is_written_by_a_name_that_reads_it_again(tmp_path):
    with pytest.raises(SettingsError, match=r"give a name that ends in \.npz"):
        mb.save_percepts(mb.load_percepts("roc36"), tmp_path / "table")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(SettingsError, match=r"percept table in \.npz"):
        mb.load_percepts("table")


@pytest.mark.parametrize("number", [np.int64(1), np.uint8(1), np.int16(1)])
def test_numbers_of_numpy_stay_numbers(number):
    toy = mb.load_domain("toy")
    problem = mb.build_momdp(toy, mb.Query(toy.attributes[:2]), np.full((2, 3, 2, 2), 0.5))
    belief = mb.initial_belief(problem)
    momdp.percept_probabilities(problem, number)
    momdp.belief_of(problem, number, belief.log_prob, belief.percept_counts.astype(np.int8))
    planners.RandomLegal(budget=np.float32(40.0))
    evaluation.resampled((1, number), np.float32(0.5))
    assert trials.task_key(["a", number]) == '["a", 1]'
    assert datasets.object_index(("a", "b"), np.str_("b")) == 1
    assert learner.implied(np.array([True]), right=np.True_).tolist() == [1]
    right = momdp.expected_reward(problem, belief, np.array([True, False]))
    assert momdp.expected_reward(problem, belief, [1, 0]) == right
    assert agents.load_agent(np.str_("bayes")).name == "bayes"
