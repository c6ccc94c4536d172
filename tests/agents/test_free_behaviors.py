"""Where behaviors cost nothing, `bayes` asks as much as where they cost next to nothing."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.domain import Query
from meal_bayes.learner.tasks import replay_task


@pytest.mark.parametrize("apart", [7, pytest.param(3, marks=pytest.mark.long)])
def test_free_behaviors_are_used_and_come_to_an_end(make, apart):
    table, trials = load_percepts("cy101"), {}
    for cost in (0.0, 0.01):
        behaviors = tuple(replace(each, cost=cost) for each in table.domain.behaviors)
        free = replace(table, domain=replace(table.domain, behaviors=behaviors))
        learner = make.learner(free, "bayes")
        names, count = free.domain.attributes, len(free.domain.attributes) - 1
        asked = [(o, names[i % count : i % count + 2]) for i, o in enumerate(free.objects)]
        trials[cost] = [
            learner.ask(replay_task(Query(two), free, name)) for name, two in asked[:16:apart]
        ]
    lengths = {cost: [len(trial.steps) for trial in done] for cost, done in trials.items()}
    assert max(lengths[0.0]) < 60
    assert np.mean(lengths[0.0]) > 3
    reports = [[trial.report.tolist() for trial in done] for done in trials.values()]
    assert reports[0] == reports[1]
    assert all(trial.cost == 0 for trial in trials[0.0])


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
