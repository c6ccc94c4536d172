"""The reference models of the benchmarks are what the file says."""

import json
from itertools import pairwise

import numpy as np
from planner_reference import load_reference


def test_every_model_is_what_the_file_says(reference):
    models = load_reference(reference)
    table = json.loads((reference / "planner_reference.json").read_text())["models"]
    assert list(models) == ["A1", "A2", "A3", "A4", "A5"]
    for row, (name, momdp) in zip(table, models.items(), strict=True):
        assert momdp.query.attributes == tuple(row["attributes"])
        assert len(momdp.query) == int(name[1])
        assert (momdp.discount, momdp.correct, momdp.incorrect) == (0.99, 500.0, -500.0)
        assert momdp.x_names == ("x0", "x1", "x2", "x3", "x4", "term")
        np.testing.assert_array_equal(momdp.prior, 0.5)
        for e, behavior in enumerate(row["behaviors"]):
            source, target = (momdp.x_names.index(behavior[end]) for end in ("source", "target"))
            assert momdp.behavior_names[e] == behavior["behavior"]
            assert momdp.cost[e] == behavior["cost_s"]
            assert momdp.transition[e, source, target] == behavior["success"]
            assert momdp.observation_probability[e, source, target] == behavior["informative"]
            np.testing.assert_array_equal(np.flatnonzero(momdp.legal[:, e]), [source])
            if behavior["informative"]:
                rates = momdp.confusion[:, e, :, 1]
                np.testing.assert_array_equal(rates[:, 1], behavior["true_positive_rate"])
                np.testing.assert_array_equal(rates[:, 0], behavior["false_positive_rate"])
    for fewer, more in pairwise(models.values()):  # each asks one attribute more, by the same rates
        n = len(fewer.query)
        assert more.query.attributes[:n] == fewer.query.attributes
        np.testing.assert_array_equal(more.confusion[:n], fewer.confusion)
