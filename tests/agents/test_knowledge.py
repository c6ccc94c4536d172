"""The held-out object is held out of what is known."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.agents import knowledge_without
from meal_bayes.perception import table_counts

HELD_OUT = 3


def numbers(knowledge):
    """All that is known, in one vector."""
    posterior = knowledge.posterior
    parts = [posterior.mean, posterior.precision, posterior.counts]
    spread = 0.0 if knowledge.trait is None else knowledge.trait.sd
    rest = [knowledge.base_rates, [spread]]
    return np.concatenate([np.ravel(part) for part in (*parts, *rest)])


@pytest.mark.parametrize("object_level", [False, True])
@pytest.mark.parametrize("levels", [2, 4])
def test_every_object_but_the_held_out_one_enters(table, make, object_level, levels):
    def learn(table):
        return numbers(knowledge_without(table, HELD_OUT, levels=levels, object_level=object_level))

    before = learn(table)
    for other in range(len(table.objects)):
        after = learn(make.change_object(table, other))
        assert np.array_equal(before, after) == (other == HELD_OUT)


def test_a_frame_says_what_tells_most_of_each_attribute(table):
    knowledge = knowledge_without(table, HELD_OUT)
    frame = knowledge.to_frame()
    assert tuple(frame.index) == table.domain.attributes
    np.testing.assert_array_equal(frame["base_rate"], knowledge.base_rates)
    for place, row in enumerate(frame.itertuples()):
        e = table.domain.behavior_index(row.behavior)
        false, true = knowledge.posterior.mean[place, e]
        assert row.youden == pytest.approx(true[1] - false[1])
        assert row.youden == knowledge.posterior.youden[place].max()
        right = row.base_rate * true[1] + (1 - row.base_rate) * false[0]
        assert row.right == pytest.approx(right)


def test_a_frame_says_where_nothing_tells_anything(table):
    nothing = replace(table, training_bins=np.zeros_like(table.training_bins))
    frame = knowledge_without(nothing, HELD_OUT).to_frame()
    assert frame["behavior"].isna().all()
    assert frame[["youden", "right"]].isna().all(axis=None)


def test_the_paper_s_reading_takes_percepts_as_independent(table):
    knowledge = knowledge_without(table, HELD_OUT, object_level=False)
    assert np.isinf(knowledge.posterior.dispersion).all()
    assert knowledge.trait is None
    total = table_counts(table, HELD_OUT).sum(axis=0)
    np.testing.assert_array_equal(knowledge.posterior.counts, total)
    np.testing.assert_allclose(
        knowledge.posterior.mean, (total + 1) / (total + 1).sum(axis=-1, keepdims=True)
    )


def test_ours_lets_objects_differ(table):
    knowledge = knowledge_without(table, HELD_OUT)
    assert np.isfinite(knowledge.posterior.dispersion).all()
    assert 0.1 <= knowledge.trait.sd <= 2.0
