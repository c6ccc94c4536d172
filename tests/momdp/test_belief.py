import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import ImpossibleObservation, SettingsError
from meal_bayes.momdp import (
    Transition,
    belief_of,
    build_momdp,
    initial_belief,
    update_belief,
)


def test_table_4_late_press(follow):
    rows = np.array([[0.82, 0.17], [0.20, 0.80]])
    domain = load_domain("cy101")
    confusion = np.tile(rows / rows.sum(axis=1, keepdims=True), (1, len(domain.behaviors), 1, 1))
    momdp = build_momdp(domain, Query(("soft",)), confusion, prior=0.43)
    (belief,) = follow(momdp, [("crush", [0])])
    assert belief.positive[0] == pytest.approx(0.16, abs=0.01)


def test_no_belief_is_cut_off_at_the_ends(follow):
    """Log-odds far beyond what a probability can tell from 1, of a class and of its truth."""
    latent_classes = np.array([[[1.0, 0.0], [0.0, 1.0]], [[1 - 1e-30, 1e-30], [1e-25, 1 - 1e-25]]])
    rows = np.tile([[0.99, 0.01], [0.01, 0.99]], (2, 3, 1, 1))
    momdp = build_momdp(
        load_domain("toy"), Query(("red", "heavy")), rows, latent_classes=latent_classes
    )
    yes, no = (follow(momdp, [("look", [z, z])] * 40)[-1].log_odds for z in (1, 0))
    far = 40 * np.log(99)
    np.testing.assert_allclose(yes, [far, 30 * np.log(10)], rtol=1e-12)
    np.testing.assert_allclose(no, [-far, -25 * np.log(10)], rtol=1e-12)


def mistaken(name, error, tpr=0.9, fpr=0.2, **options):
    """One attribute; a share `error` of the objects seems to have the other value."""
    domain = load_domain(name)
    no, yes = [1 - fpr, fpr], [1 - tpr, tpr]
    rows = np.tile([no, yes, yes, no], (1, len(domain.behaviors), 1, 1))
    latent_classes = [[[1 - error, error, 0, 0], [0, 0, 1 - error, error]]]
    attribute = "red" if name == "toy" else "heavy"
    return build_momdp(domain, Query((attribute,)), rows, latent_classes=latent_classes, **options)


def test_an_answer_tells_of_the_truth_whatever_the_object_seems(follow):
    momdp = mistaken("ispy32", 0.05)
    belief = follow(momdp, [("look", [1])] * 60)[-1]
    odds = 0.95 / 0.05
    for count in range(1, 4):
        ask = momdp.behavior_names.index("ask")
        belief = update_belief(belief, momdp, Transition(ask, belief.x, np.array([0])))
        p = odds * (0.3 / 0.7) ** count
        assert belief.positive[0] == pytest.approx(p / (1 + p))


def test_a_kind_that_is_ruled_out_leaves_the_others(follow):
    momdp = mistaken("toy", 0.05, tpr=1.0, fpr=0.0)
    belief = follow(momdp, [("look", [1])] * 5)[-1]
    np.testing.assert_allclose(np.exp(belief.log_prob[0]), [0, 0.05, 0.95, 0], atol=1e-15)
    assert belief.positive[0] == pytest.approx(0.95)
    with pytest.raises(ImpossibleObservation, match="'red' by 'look' has probability zero"):
        follow(momdp, [("look", [1]), ("look", [0])])


def test_a_truth_may_lack_a_kind(follow):
    """Nothing is undefined."""
    rows = np.tile([[0.8, 0.2], [0.3, 0.7]], (1, 3, 1, 1))
    latent_classes = np.array([[[1.0, 0.0], [0.25, 0.75]]])
    momdp = build_momdp(load_domain("toy"), Query(("red",)), rows, latent_classes=latent_classes)
    belief = follow(momdp, [("look", [1]), ("lift", [0])])[-1]
    false, true = 0.2 * 0.8, 0.25 * 0.2 * 0.8 + 0.75 * 0.7 * 0.3
    assert belief.positive[0] == pytest.approx(true / (true + false))
    assert momdp.log_truth[0, 0, 1] == -np.inf


def test_sure_weights_are_sure_beliefs(momdp_of):
    seen = np.zeros((2, 3, 2), dtype=int)
    sure = np.array([[0.0, -np.inf], [-np.inf, 0.0]])
    belief = belief_of(momdp_of("toy", 2), 0, sure, seen)
    np.testing.assert_array_equal(belief.log_odds, [-np.inf, np.inf])
    np.testing.assert_array_equal(belief.positive, [0.0, 1.0])
    assert belief.certainty == 1.0
    assert belief.entropy == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("action", "x", "percept"),
    [(-1, 1, None), (99, 1, None), (0, -1, None), (0, 99, None), (0, 1, [-1]), (0, 1, [2]),
     (0, 1, [0, 1]), (0, 1, [0.5])],
)  # fmt: skip
def test_what_is_no_index_of_the_momdp_is_refused(momdp_of, action, x, percept):
    momdp = momdp_of("toy", 1)
    observation = None if percept is None else np.array(percept)
    with pytest.raises(SettingsError):
        update_belief(initial_belief(momdp), momdp, Transition(action, x, observation))
