"""Settings of online runs are checked where they are made."""

import pytest

from meal_bayes.errors import SettingsError
from meal_bayes.experiments import OnlineConfig


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"agents": ("bayes", "bayess")}, "did you mean 'bayes'"),
        ({"agents": ("bayes", "bayes")}, "named twice"),
        ({"agents": ()}, "No agent named"),
        ({"learning": (("by_objects", False),)}, "did you mean 'by_object'"),
        ({"percepts": "modell"}, "did you mean 'model'"),
        ({"attributes": 0}, "attributes is 0"),
        ({"trials": -1}, "trials is -1"),
        ({"first": -1}, "0 or more"),
        ({"reward": float("nan")}, "reward is nan"),
        ({"seed": 1.5}, "seed is 1.5; give a whole number"),
        ({"split": (33, 0, 34)}, "give three shares"),
        ({"log": "some"}, "log 'some'"),
        ({"answers": "verdikt"}, "did you mean 'verdict'"),
        ({"error": 1.5}, "give 0 to below 1"),
        ({"normalizer": "papre"}, "did you mean 'paper'"),
        ({"alpha": -1.0}, "alpha"),
        ({"beta": float("nan")}, "beta"),
        ({"horizon": 0}, "horizon"),
    ],
)
def test_configs_are_checked(wrong, message):
    with pytest.raises(SettingsError, match=message):
        OnlineConfig("toy", **wrong)
