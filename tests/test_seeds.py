"""Named random streams."""

import numpy as np
import pytest

from meal_bayes.seeds import _words, stream


@pytest.mark.parametrize("root", [0, 7, 2**32 - 1, 2**32, 2**127 + 5, 2**128, 2**200])
def test_the_name_of_a_stream_is_the_spawn_key_of_its_seed(root):
    key = (*_words("text", "robot"), *_words("number", "3"))
    spawned = np.random.PCG64(np.random.SeedSequence(root, spawn_key=key))
    assert stream(root, "robot", np.int64(3)).bit_generator.state == spawned.state


@pytest.mark.parametrize("root", [-1, 1.5])
def test_what_is_no_seed_is_refused(root):
    with pytest.raises((TypeError, ValueError)):
        stream(root, "robot")
