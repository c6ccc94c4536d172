"""Success probabilities learned from what happened."""

import pytest

from meal_bayes.domain import learn_diagram, load_domain


@pytest.fixture
def diagram():
    return load_domain("simulated_arm").diagram


def probabilities(diagram):
    return {(e.source, e.behavior, e.target): e.probability for e in diagram.effects}


def test_an_arrow_learns_the_posterior_mean_under_jeffreys_prior(diagram):
    happened = {("lifted", "shake", "lifted"): 7, ("lifted", "shake", "ready"): 3}
    learned = probabilities(learn_diagram(diagram, happened))
    assert learned["lifted", "shake", "lifted"] == pytest.approx(7.5 / 11.5)
    assert learned["lifted", "shake", "ready"] == pytest.approx(3.5 / 11.5)
    assert learned["lifted", "shake", "moved"] == pytest.approx(0.5 / 11.5)


def test_failing_in_place_is_an_outcome_where_no_arrow_keeps_the_state(diagram):
    happened = {("ready", "grasp", "grasped"): 9, ("ready", "grasp", "ready"): 1}
    learned = probabilities(learn_diagram(diagram, happened))
    assert learned["ready", "grasp", "grasped"] == pytest.approx(9.5 / 11)
    assert ("ready", "grasp", "ready") not in learned


def test_much_experience_tells_the_true_probabilities_and_keeps_the_percepts(diagram):
    true = probabilities(diagram)
    happened = {key: round(1e6 * p) for key, p in true.items()}
    learned = learn_diagram(diagram, happened)
    assert probabilities(learned) == pytest.approx(true, abs=1e-5)
    senses = {(e.source, e.behavior, e.target): e.senses for e in diagram.effects}
    assert {(e.source, e.behavior, e.target): e.senses for e in learned.effects} == senses


def test_states_that_no_arrow_names_are_not_counted(diagram):
    happened = {("lifted", "hold", "moved"): 50, ("lifted", "hold", "lifted"): 1}
    assert probabilities(learn_diagram(diagram, happened))["lifted", "hold", "lifted"] == 1.0
