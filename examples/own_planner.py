"""A planner of your own, compared with the package's agents on the recordings of a real robot.

    python examples/own_planner.py
    meal-bayes run offline --dataset roc36 --trials 20 --agent morc,own_planner:Cautious

Run the second command in the folder of this file. A planner is an object with a method `solve`; its
policy has a method `decide`. The observation model, the prior and the logs are those of `bayes`.
"""

from dataclasses import dataclass

import meal_bayes as mb
from meal_bayes.momdp import MOMDP, best_report
from meal_bayes.planners import unvalued
from meal_bayes.testing import check_solver


@dataclass
class Cautious:
    """Execute the cheapest legal behavior that was not tried yet, and report when sure."""

    sure: float = 0.95  # probability of the report at which the planner stops
    patience: int = 12  # maximum number of behaviors

    def solve(self, momdp, rng):
        return CautiousPolicy(self, momdp)  # a new one for each problem


@dataclass
class CautiousPolicy:
    planner: Cautious
    momdp: MOMDP

    def decide(self, history, rng):
        planner = self.planner
        momdp = self.momdp
        belief = history.belief
        legal = [e for e in range(momdp.n_behaviors) if momdp.legal[belief.x, e]]
        tired = len(history.actions) >= planner.patience
        if belief.certainty >= planner.sure or tired or not legal:
            return unvalued(momdp, best_report(momdp, belief))
        untried = [e for e in legal if e not in history.actions] or legal
        return unvalued(momdp, min(untried, key=lambda e: momdp.cost[e]))


def main(trials=20):
    check_solver(Cautious())
    config = mb.OfflineConfig(
        "roc36", attributes=2, trials=trials, agents=("random_legal", "predefined_plus", Cautious())
    )
    run = mb.run_offline(config)
    for row in mb.summarize(run.trials()):
        print(f"{row.agent:<16} accuracy {row.accuracy:.2f}  cost {row.cost_s:5.1f} s")


if __name__ == "__main__":
    main()
