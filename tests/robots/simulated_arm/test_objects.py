"""Objects are drawn from a seed, and attributes follow from parameters by stated thresholds."""

from collections import Counter

import pytest

from meal_bayes.domain import load_domain


def test_equal_names_draw_equal_objects(sim):
    assert sim.draw_object(3, "new", 1) == sim.draw_object(3, "new", 1)
    drawn = {sim.draw_object(seed, "new", n) for seed in range(3) for n in range(3)}
    assert len(drawn) == 9


def test_every_attribute_of_the_domain_is_told_and_both_values_are_common(sim):
    domain = load_domain("simulated_arm")
    truths = [sim.attributes_of(sim.draw_object(0, "count", n)) for n in range(300)]
    assert all(tuple(truth) == domain.attributes for truth in truths)
    positive = Counter(name for truth in truths for name, value in truth.items() if value)
    assert all(0.2 < positive[name] / 300 < 0.8 for name in domain.attributes), positive


@pytest.mark.parametrize(
    ("attribute", "said", "otherwise"),
    [
        ("heavy", {"shell_mass": 0.23}, {"shell_mass": 0.21}),
        ("heavy", {"content_mass": 0.08}, {"content_mass": 0.06}),
        ("soft", {"stiffness": 3900.0}, {"stiffness": 4100.0}),
        ("slippery", {"friction": 0.49}, {"friction": 0.51}),
        ("full", {"content": "slab"}, {"content": "nothing"}),
        ("rattles", {"content": "few large balls"}, {"content": "slab"}),
        ("tall", {"height": 0.106}, {"height": 0.104}),
        ("blue", {"color": "blue"}, {"color": "red"}),
    ],
)
def test_an_attribute_follows_from_its_threshold(sim, make_object, attribute, said, otherwise):
    assert sim.attributes_of(make_object(**said))[attribute]
    assert not sim.attributes_of(make_object(**otherwise))[attribute]
