import numpy as np

from meal_bayes.evaluation.canvas import save
from meal_bayes.evaluation.posterior_plots import forest, predictive

MIDDLE = np.array([[[0.1, 0.9], [0.4, 0.5], [0.2, 0.7]], [[0.3, 0.3], [0.1, 0.95], [0.5, 0.4]]])
NAMES = (["red", "full"], ["look", "lift", "tap"])


def texts(axes):
    return [text.get_text() for text in axes.texts]


def test_forest_orders_pairs_by_their_difference(tmp_path):
    axes = forest(MIDDLE, MIDDLE - 0.05, MIDDLE + 0.05, *NAMES)
    assert [tick.get_text() for tick in axes.get_yticklabels()] == [
        "look", "tap", "lift", "lift", "look", "tap",
    ]  # fmt: skip
    assert texts(axes) == ["red", "full"]
    lines = {bars.get_label(): bars for bars in axes.containers}
    assert set(lines) == {"of false objects", "of true objects"}
    x = lines["of true objects"].lines[0].get_xdata()
    np.testing.assert_allclose(x, [0.9, 0.7, 0.5, 0.95, 0.3, 0.4])
    segments = lines["of true objects"].lines[2][0].get_segments()
    np.testing.assert_allclose([end[0] for end in segments[0]], [0.85, 0.95])
    assert "interval" in axes.get_xlabel()
    assert save(axes, tmp_path / "forest.png").stat().st_size > 5000


def test_forest_says_what_it_leaves_out():
    axes = forest(MIDDLE, MIDDLE, MIDDLE, *NAMES, most=2)
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["look", "lift"]
    assert "the 2 pairs that differ most; 4 more are not shown" in axes.get_xlabel()


def test_predictive_shows_fractions_beside_their_intervals(tmp_path):
    observed = np.array([[8, 1, 1], [0, 0, 5]])
    predicted = np.stack([observed] * 99 + [[[7, 2, 1], [1, 0, 4]]])
    axes = predictive(observed, predicted)
    heights = [bar.get_height() for bar in axes.patches]
    np.testing.assert_allclose(heights, [0.8, 0.1, 0.1, 0, 0, 1])
    labels = {container.get_label() for container in axes.containers}
    assert {"false, observed", "true, predicted"} <= labels
    assert axes.get_xlabel() == 'percepts of 2 that say "yes"'
    assert save(axes, tmp_path / "predictive.png").stat().st_size > 5000
