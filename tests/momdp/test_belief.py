"""Beliefs at their ends, and what holds for all: of any rows, precisions, classes and percepts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.special import logsumexp
from scipy.stats import dirichlet_multinomial, multinomial

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import ImpossibleObservation, SettingsError
from meal_bayes.momdp import (
    Transition,
    belief_of,
    build_momdp,
    initial_belief,
    update_belief,
)
from meal_bayes.momdp.observation import predictive, sample_rows
from meal_bayes.planners.jit import entry_kernel
from meal_bayes.planners.plans.bayes_error import predictive as compiled


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
    no = [1 - fpr, fpr]
    yes = [1 - tpr, tpr]
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
    false = 0.2 * 0.8
    true = 0.25 * 0.2 * 0.8 + 0.75 * 0.7 * 0.3
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
    [(-1, 1, None), (99, 1, None), (0, -1, None), (0, 99, None), (0, 1, [-2]), (0, 1, [2]),
     (0, 1, [0, 1]), (0, 1, [0.5])],
)  # fmt: skip
def test_what_is_no_index_of_the_momdp_is_refused(momdp_of, action, x, percept):
    momdp = momdp_of("toy", 1)
    observation = None if percept is None else np.array(percept)
    with pytest.raises(SettingsError):
        update_belief(initial_belief(momdp), momdp, Transition(action, x, observation))


def rows_of(shape):
    cells = hnp.arrays(float, shape, elements=st.floats(0.02, 1.0))
    return cells.map(lambda a: a / a.sum(axis=-1, keepdims=True))


@st.composite
def problems(draw, levels=(2, 4)):
    """A `toy` problem of two attributes: any rows, precisions, latent classes; and a history."""
    k = draw(st.sampled_from(levels))
    c = draw(st.sampled_from([2, 3, 4, 6]))
    finite = st.floats(0.1, 300.0)
    precision = draw(hnp.arrays(float, (2, 3, c), elements=finite | st.just(np.inf)))
    latent_classes = draw(rows_of((2, 2, c)))
    if c % 2 == 0 and draw(st.booleans()):  # latent classes of its own for each truth
        latent_classes = latent_classes * np.eye(2).repeat(c // 2, axis=1)
        latent_classes /= latent_classes.sum(axis=-1, keepdims=True)
    momdp = build_momdp(
        load_domain("toy"),
        Query(("red", "heavy")),
        draw(rows_of((2, 3, c, k))),
        precision,
        prior=draw(hnp.arrays(float, 2, elements=st.floats(0.05, 0.95))),
        latent_classes=latent_classes,
    )
    percept = st.lists(st.integers(0, k - 1), min_size=2, max_size=2)
    step = st.tuples(st.sampled_from(["look", "lift"]), percept)
    return momdp, draw(st.lists(step, min_size=1, max_size=12))


@given(problems())
def test_beliefs_stay_finite_and_count_percepts(follow, problem):
    momdp, steps = problem
    for number, belief in enumerate(follow(momdp, steps), start=1):
        assert np.isfinite(belief.log_odds).all()
        assert ((belief.positive >= 0) & (belief.positive <= 1)).all()
        assert belief.joint.sum() == pytest.approx(1.0)
        assert belief.joint.max() == pytest.approx(belief.certainty)
        np.testing.assert_allclose(np.exp(belief.log_prob).sum(axis=1), 1.0)
        np.testing.assert_array_equal(belief.percept_counts.sum(axis=(1, 2)), number)


@given(problems())
def test_no_percept_leaves_the_belief(follow, problem):
    momdp, steps = problem
    belief = follow(momdp, steps)[-1]
    after = update_belief(belief, momdp, Transition(0, 1, None))
    assert after.x == 1
    np.testing.assert_array_equal(after.log_odds, belief.log_odds)
    np.testing.assert_array_equal(after.percept_counts, belief.percept_counts)


@given(problems())
def test_the_filter_is_the_dirichlet_multinomial(follow, problem):
    momdp, steps = problem
    belief = follow(momdp, steps)[-1]
    score = np.zeros((2, momdp.n_classes))
    for i, e, c in np.ndindex(2, 2, momdp.n_classes):
        counts = belief.percept_counts[i, e]
        row = momdp.confusion[i, e, c]
        if counts.sum() == 0:
            continue
        if np.isinf(momdp.precision[i, e, c]):
            score[i, c] += multinomial.logpmf(counts, counts.sum(), row)
        else:
            weight = momdp.precision[i, e, c] * row
            score[i, c] += dirichlet_multinomial.logpmf(counts, weight, counts.sum())
    false, true = logsumexp(score[:, None], b=momdp.latent_classes, axis=2).T
    prior = np.log(momdp.prior) - np.log1p(-momdp.prior)
    np.testing.assert_allclose(belief.log_odds, prior + true - false, atol=1e-8)


def split(momdp):
    """The same problem, every latent class split into a false one and a true one."""
    return build_momdp(
        load_domain("toy"),
        momdp.query,
        np.tile(momdp.confusion, (1, 1, 2, 1)),
        np.tile(momdp.precision, (1, 1, 2)),
        prior=momdp.prior,
        latent_classes=(momdp.latent_classes[:, :, None] * np.eye(2)[:, :, None]).reshape(2, 2, -1),
    )


@given(problems())
def test_latent_classes_that_truths_share_may_as_well_be_split(follow, problem):
    momdp, steps = problem
    for shared, apart in zip(follow(momdp, steps), follow(split(momdp), steps), strict=True):
        np.testing.assert_allclose(shared.log_odds, apart.log_odds, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(shared.joint, apart.joint, rtol=1e-12)
        latent_classes = np.exp(apart.log_prob).reshape(2, 2, -1).sum(axis=1)
        np.testing.assert_allclose(np.exp(shared.log_prob), latent_classes, rtol=1e-10, atol=1e-300)


@entry_kernel
def fill(mean, precision, count, total, out):
    for i in range(out.shape[0]):
        out[i] = compiled(mean[i], precision[i], count[i], total[i])


@pytest.mark.parametrize("seed", range(5))
def test_arrays_and_kernels_have_one_predictive(seed):
    rng = np.random.default_rng(seed)
    size = 200
    mean = rng.dirichlet(np.ones(4), size)
    counts = rng.integers(0, 40, (size, 4))
    precision = np.where(rng.random(size) < 0.25, np.inf, rng.gamma(1.0, 20.0, size) + 1e-6)
    weight, total = (np.repeat(a, 4).astype(float) for a in (precision, counts.sum(axis=1)))
    filled = np.empty(mean.size)
    fill(mean.ravel(), weight, counts.ravel().astype(float), total, filled)
    expected = predictive(mean.ravel(), weight, counts.ravel(), total)
    np.testing.assert_allclose(filled, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.statistical
@pytest.mark.parametrize("precision", [0.5, 5.0, np.inf])
def test_sampled_rows_have_the_predictive_as_their_mean(precision):
    mean = np.array([0.1, 0.6, 0.3])
    counts = np.array([2, 0, 5])
    draws = 20_000
    rows = sample_rows(np.tile(mean, (draws, 1)), precision, counts, rng=np.random.default_rng(1))
    np.testing.assert_allclose(rows.sum(axis=1), 1.0)
    error = 4.5 * rows.std(axis=0) / np.sqrt(draws) + 1e-12
    assert (abs(rows.mean(axis=0) - predictive(mean, precision, counts, 7)) <= error).all()
    if np.isinf(precision):
        np.testing.assert_array_equal(rows, np.tile(mean, (draws, 1)))
