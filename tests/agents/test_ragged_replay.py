"""Objects that lack recordings: agents meet no more percepts of a behavior than there are."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.experiments import offline_tasks


@pytest.fixture(scope="module")
def ragged():
    """Take ROC36's percepts of look away from every object, and all but one of every tap."""
    table = load_percepts("roc36")
    look, tap = (table.domain.behavior_index(name) for name in ("look", "tap"))
    log_odds, counts = table.log_odds.copy(), table.recording_counts.copy()
    log_odds[:, :, look], log_odds[:, 1:, tap] = np.nan, np.nan
    counts[:, look], counts[:, tap] = 0, 1
    return replace(table, log_odds=log_odds, recording_counts=counts)


@pytest.mark.parametrize("agent", ["random_legal", "predefined_plus", "greedy"])
def test_what_was_not_recorded_is_not_perceived(make, ragged, agent):
    learner, executed = make.learner(ragged, agent), 0
    for task in offline_tasks(ragged, 1, 6, 0):
        trial = learner.ask(task)
        names = [trial.momdp.action_name(step.decision.action) for step in trial.steps]
        pairs = zip(names, trial.steps, strict=True)
        seen = [name for name, step in pairs if step.observation is not None]
        assert "look" not in seen
        assert seen.count("tap") <= 1
        executed += names.count("look")
        assert trial.momdp.limit[ragged.domain.behavior_index("tap")] == 1
    assert executed
