"""What holds for every belief: of any rows, precisions, latent classes and percepts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.special import logsumexp
from scipy.stats import dirichlet_multinomial, multinomial

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import Transition, build_momdp, update_belief
from meal_bayes.momdp.observation import predictive, sample_rows
from meal_bayes.planners.kernels import entry_kernel
from meal_bayes.planners.open_loop.errors import predictive as compiled


def rows_of(shape):
    cells = hnp.arrays(float, shape, elements=st.floats(0.02, 1.0))
    return cells.map(lambda a: a / a.sum(axis=-1, keepdims=True))


@st.composite
def problems(draw, levels=(2, 4)):
    """A `toy` problem of two attributes: any rows, precisions, latent classes; and a history."""
    k, c = draw(st.sampled_from(levels)), draw(st.sampled_from([2, 3, 4, 6]))
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
        counts, row = belief.percept_counts[i, e], momdp.confusion[i, e, c]
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
    for one, other in zip(follow(momdp, steps), follow(split(momdp), steps), strict=True):
        np.testing.assert_allclose(one.log_odds, other.log_odds, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(one.joint, other.joint, rtol=1e-12)
        latent_classes = np.exp(other.log_prob).reshape(2, 2, -1).sum(axis=1)
        np.testing.assert_allclose(np.exp(one.log_prob), latent_classes, rtol=1e-10, atol=1e-300)


@entry_kernel
def fill(mean, precision, count, total, out):
    for i in range(out.shape[0]):
        out[i] = compiled(mean[i], precision[i], count[i], total[i])


@pytest.mark.parametrize("seed", range(5))
def test_arrays_and_kernels_have_one_predictive(seed):
    rng, size = np.random.default_rng(seed), 200
    mean, counts = rng.dirichlet(np.ones(4), size), rng.integers(0, 40, (size, 4))
    precision = np.where(rng.random(size) < 0.25, np.inf, rng.gamma(1.0, 20.0, size) + 1e-6)
    weight, total = (np.repeat(a, 4).astype(float) for a in (precision, counts.sum(axis=1)))
    found = np.empty(mean.size)
    fill(mean.ravel(), weight, counts.ravel().astype(float), total, found)
    expected = predictive(mean.ravel(), weight, counts.ravel(), total)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.statistical
@pytest.mark.parametrize("precision", [0.5, 5.0, np.inf])
def test_sampled_rows_have_the_predictive_as_their_mean(precision):
    mean, counts, draws = np.array([0.1, 0.6, 0.3]), np.array([2, 0, 5]), 20_000
    rows = sample_rows(np.tile(mean, (draws, 1)), precision, counts, rng=np.random.default_rng(1))
    np.testing.assert_allclose(rows.sum(axis=1), 1.0)
    error = 4.5 * rows.std(axis=0) / np.sqrt(draws) + 1e-12
    assert (abs(rows.mean(axis=0) - predictive(mean, precision, counts, 7)) <= error).all()
    if np.isinf(precision):
        np.testing.assert_array_equal(rows, np.tile(mean, (draws, 1)))
