"""No named agent ever commands what is not legal, whether its percepts tell much or nothing."""

import pytest

from meal_bayes.agents import AGENTS


@pytest.mark.parametrize("trials", [6, pytest.param(200, marks=pytest.mark.long)])
@pytest.mark.parametrize("signal", [0.0, 2.0])
@pytest.mark.parametrize("name", AGENTS)
def test_nothing_illegal_is_commanded(make, name, signal, trials):
    """A session refuses what is not legal, by `MOMDP.check_action`."""
    table = make.table("ispy32", signal=signal)
    learner = make.learner(table, name)
    for index in range(trials):
        n = 1 + 2 * (index % 2)
        task = make.task(table, index // 2 % 8, *table.domain.attributes[index // 16 :][:n])
        trial = learner.ask(task)
        assert trial.last_belief.x == trial.momdp.terminal
