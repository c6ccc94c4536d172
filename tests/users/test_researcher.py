"""A researcher's tour: an own classifier, an own planner, and both in Gymnasium beside ours."""

from dataclasses import dataclass

import gymnasium
import numpy as np
from sklearn.linear_model import LogisticRegression

import meal_bayes as mb
import meal_bayes.gym  # registers the environments
from meal_bayes.datasets import make_synthetic
from meal_bayes.momdp import MOMDP, best_answer
from meal_bayes.planners import unvalued


@dataclass(frozen=True)
class Patient:
    """Executes anything legal until it is sure, or has no patience left."""

    patience: int = 8

    def solve(self, momdp, rng):
        return PatientPolicy(momdp, self.patience)


@dataclass(frozen=True)
class PatientPolicy:
    momdp: MOMDP
    patience: int

    def decide(self, history, rng):
        momdp, belief = self.momdp, history.belief
        if belief.certainty > 0.95 or len(history.actions) >= self.patience:
            return unvalued(momdp, best_answer(momdp, belief))
        return unvalued(momdp, int(rng.choice(np.flatnonzero(momdp.legal[belief.x]))))


def test_everything_of_my_own(tmp_path, monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path))
    rng = np.random.default_rng(0)
    domain = mb.load_domain("toy")
    recordings = make_synthetic(domain, objects=40, recordings=3, signal=6.0, rng=rng)
    table = mb.build_percept_table(recordings, classifier=LogisticRegression())
    agents = "random_legal", Patient(), "bayes"
    run = mb.run_offline(
        mb.OfflineConfig(table, attributes=1, trials=40, agents=agents), logs=tmp_path / "logs"
    )
    summary = mb.summarize(run)
    assert [row.agent for row in summary] == ["random_legal", "Patient", "bayes"]
    assert summary.compare("bayes", "Patient").estimate > 0
    assert len(run.steps()) == run.outcomes().steps.sum()
    assert "Patient" in run._repr_html_()
    env = gymnasium.make(
        "meal_bayes/Own-v0", dataset=table, attributes=1, agent=Patient(), objects="test"
    )
    _, info = env.reset(seed=0)
    ended = False
    while not ended:
        action = env.unwrapped.decide()
        assert info["action_mask"][action]
        _, reward, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    assert np.isfinite(reward)
