"""Coupled questions: sampled values of plans have the standard errors that they scatter by."""

import numpy as np
import pytest

from meal_bayes import Learner, load_percepts
from meal_bayes.planners.plans import policy
from meal_bayes.planners.solver import History


@pytest.mark.parametrize(("question", "answer"), [("weight", "values"), ("color", "values")])
def test_sampled_values_scatter_by_no_more_than_their_errors(question, answer):
    learner = Learner("roc36", agent="olfc", logs=None, seed=1).fit(load_percepts("roc36"))
    trial = learner.ask(question, "heavy_blue_beans", answer=answer)
    solved = policy.OpenLoop().solve(trial.momdp, np.random.default_rng(0))
    history = History(trial.first_belief)
    decisions = [solved.decide(history, np.random.default_rng(seed)) for seed in range(40)]
    behavior = int(np.nanargmax(decisions[0].values[:-1]))
    values = np.array([decision.values[behavior] for decision in decisions])
    errors = np.array([decision.value_se[behavior] for decision in decisions])
    assert (errors > 0).all()
    assert all(decision.value_se[-1] == 0 for decision in decisions)  # the answer now is exact
    assert values.std() < 1.5 * errors.mean()
    assert (abs(values - values.mean()) < 4 * errors.mean()).all()
