"""Point-based value iteration, from the definitions: lower <= optimum <= upper, and all meet."""

from dataclasses import replace

import numpy as np
import pytest
from planner_models import load_reference

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram
from meal_bayes.momdp import MOMDP, Objective, build_momdp, initial_belief, percept_probabilities
from meal_bayes.planners import Factored


class PointBased:
    """PBVI [Pineau et al. 2003] on (x, y); shares no code with the planners that it judges.

    Each alpha vector (Y,) of x is the value of a plan, so the best of them at the start is a lower
    bound on the optimum: backups at points only ever add plans.
    """

    def __init__(self, momdp: MOMDP) -> None:
        self.momdp = momdp
        truth = momdp.query.values
        self.reports = momdp.reports.of_right((truth[:, None] == truth).astype(float))  # (Y,Y)
        self.plans = [self.reports] * momdp.terminal
        bonus = momdp.bonus[np.arange(truth.shape[1]), :, truth.astype(int)].sum(axis=1)  # (Y,E)
        comes = (momdp.transition * momdp.observation_probability).sum(axis=2).T  # (X,E)
        self.reward = comes[:, None] * bonus - momdp.cost  # (X,Y,E)
        self.outcomes = {
            (x, e): [self._outcome(x, e, int(to)) for to in np.flatnonzero(momdp.transition[e, x])]
            for e, x in np.ndindex(momdp.n_behaviors, momdp.terminal)
            if momdp.legal[x, e]
        }

    def _outcome(self, x: int, e: int, to: int) -> tuple[int, np.ndarray]:
        """Return x' and the discounted Pr(x', z | x, y, behavior) (Z+1,Y), no percept last."""
        momdp = self.momdp
        comes = momdp.observation_probability[e, x, to]
        n_y = len(self.reports)
        rows = [comes * percept_probabilities(momdp, e).T, np.full((1, n_y), 1 - comes)]
        return to, momdp.discount * momdp.transition[e, x, to] * np.concatenate(rows)

    def solve(self, trials: int, sweeps: int, seed: int = 0, spacing: float = 0.05) -> float:
        """Back up the beliefs of random trials; return the lower bound."""
        points = self._points(trials, spacing, np.random.default_rng(seed))
        for _ in range(sweeps):
            for x, beliefs in reversed(list(enumerate(points))):
                if len(beliefs):
                    self.plans[x] = self._backed_up(x, beliefs)
        belief = initial_belief(self.momdp)
        return float((self.plans[belief.x] @ belief.joint).max())

    def _points(self, trials: int, spacing: float, rng: np.random.Generator) -> list[np.ndarray]:
        start = initial_belief(self.momdp)
        points = [[] for _ in self.plans]
        for _ in range(trials):
            x = start.x
            belief = start.joint
            for _ in range(15):
                points[x].append(belief)
                legal = np.flatnonzero(self.momdp.legal[x])
                if not len(legal):
                    break
                targets, weights = zip(*self.outcomes[x, int(rng.choice(legal))], strict=True)
                chances = np.concatenate([w @ belief for w in weights])
                z = rng.choice(len(chances), p=chances / chances.sum())
                x = targets[z // len(weights[0])]
                belief = np.concatenate(weights)[z] * belief
                belief /= belief.sum()
        # One point of each cell, in square roots of probabilities.
        cells = [np.round(np.sqrt(beliefs) / spacing) for beliefs in points]
        first = [np.unique(c, axis=0, return_index=True)[1] if len(c) else [] for c in cells]
        return [np.array(b)[i] for b, i in zip(points, map(np.sort, first), strict=True)]

    def _backed_up(self, x: int, beliefs: np.ndarray) -> np.ndarray:
        """Keep the best plan at each belief: one that is there, or a behavior and what follows."""
        vectors = self.plans[x][(beliefs @ self.plans[x].T).argmax(axis=1)]
        for e in np.flatnonzero(self.momdp.legal[x]).tolist():
            ahead = np.tile(self.reward[x, :, e], (len(beliefs), 1))
            for to, weights in self.outcomes[x, e]:
                after = beliefs[:, None] * weights  # (n,Z+1,Y)
                plans = (
                    self.plans[to] if to < self.momdp.terminal else np.zeros((1, len(weights.T)))
                )
                ahead += (weights * plans[(after @ plans.T).argmax(axis=2)]).sum(axis=1)
            better = (ahead * beliefs).sum(axis=1) > (vectors * beliefs).sum(axis=1)
            vectors[better] = ahead[better]
        return np.unique(np.concatenate([self.reports, vectors]).round(9), axis=0)


def acyclic(n: int, levels: int, seed: int, **options) -> MOMDP:
    """A diagram that comes to an end: look, then grasp or push, then shake; failures on the way."""
    behaviors = ("look", "grasp", "push", "shake")
    effects = (
        Effect("x0", "look", "x1", 0.9),
        Effect("x1", "grasp", "x2", 0.8),
        Effect("x1", "push", "x3", 0.5),
        Effect("x1", "push", "x2", 0.3, senses=False),
        Effect("x2", "shake", "x3", 0.95),
    )
    costs = (0.5, 2.0, 1.5, 4.0)
    rng = np.random.default_rng(seed)
    names = ("red", "heavy", "empty")[:n]
    domain = Domain(
        "acyclic",
        names,
        tuple(Behavior(b, c, ("all",)) for b, c in zip(behaviors, costs, strict=True)),
        TransitionDiagram(("x0", "x1", "x2", "x3", "term"), "x0", effects),
        report_reward=50.0,
    )
    rows = rng.dirichlet(np.ones(levels), (n, 4, 2))
    return build_momdp(domain, Query(names), rows, prior=rng.uniform(0.2, 0.8, n), **options)


@pytest.mark.quick(6)
@pytest.mark.parametrize(
    ("n", "levels", "objective", "shaped"),
    [
        (1, 2, Objective(), False),
        (2, 2, Objective(discount=1.0), False),
        (1, 4, Objective(discount=0.8), False),
        (2, 2, Objective(), True),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_the_oracle_meets_brute_force_and_the_bound_holds(
    small, n, levels, objective, shaped, seed
):
    momdp = acyclic(n, levels, seed, objective=objective)
    if shaped:
        bonus = np.random.default_rng(seed).uniform(-3, 3, momdp.bonus.shape)
        momdp = replace(momdp, bonus=bonus)
    brute_force = small.expectimax(momdp)
    best = brute_force.value(momdp.start, brute_force.nothing_seen())
    lower = PointBased(momdp).solve(trials=400, sweeps=25, spacing=1e-6)
    assert lower == pytest.approx(best, abs=1e-6)
    assert lower <= Factored(2000).solve(momdp, np.random.default_rng(0)).upper_bound + 1e-9


@pytest.mark.parametrize(
    ("name", "at_least", "upper"),
    [("A1", 440.0, 441.3), ("A2", 380.0, 387.7)],  # SARSOP 60 s: 441.298 and 384.6
)
def test_reference_models_are_solved_within_known_bounds(name, at_least, upper):
    momdp = load_reference()[name]
    lower = PointBased(momdp).solve(trials=300, sweeps=40)
    assert at_least < lower < upper
    assert lower < Factored().solve(momdp, np.random.default_rng(0)).upper_bound < upper + 0.5
