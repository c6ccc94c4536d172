"""Where behaviors cost nothing, `bayes` asks as much as where they cost next to nothing."""

from dataclasses import replace

import numpy as np
import pytest


@pytest.mark.parametrize("agent", ["morc", "morc_itrs", "bayes", "olfc", "greedy"])
def test_free_behaviors_that_say_nothing_are_not_used(make, table, agent):
    behaviors = tuple(replace(each, cost=0.0) for each in table.domain.behaviors)
    shown = table.training_bins.sum(axis=-1, keepdims=True)  # all of them in one bin
    same = shown * (np.arange(table.training_bins.shape[-1]) == 4)
    log_odds = np.where(np.isnan(table.log_odds), np.nan, 1.0)
    free = replace(
        table, domain=replace(table.domain, behaviors=behaviors), log_odds=log_odds,
        training_bins=same.astype(np.uint8),
    )  # fmt: skip
    learner = make.learner(free, agent, percepts="model")
    for n in (1, 2):
        assert len(learner.ask(make.task(free, 0, *free.domain.attributes[:n])).steps) == 1
