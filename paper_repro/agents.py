"""The published baselines and solver.

This module imports nothing that judges or shows: the names of their runs go by its code.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meal_bayes.agents import Agent, ITRSBonus, load_agent
from meal_bayes.domain import Domain, Query
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision, History, Random, Solver, unvalued
from meal_bayes.planners.baselines import Baseline, draw_legal
from paper_repro.sarsop import Sarsop

ASK = "ask"


@dataclass(frozen=True, slots=True)
class RandomLegalAsking:
    """Random Legal that may ask a person as well, at the start alone (PP `_legal_actions`)."""

    budget: float

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Baseline:
        """Make the policy."""
        elsewhere = np.arange(len(momdp.legal)) != momdp.start
        asks = np.array([name == ASK for name in momdp.behavior_names])
        allowed = momdp.legal & ~np.outer(elsewhere, asks)
        return Baseline(partial(draw_legal, momdp, self.budget, allowed))


def _random_legal(domain: Domain, query: Query) -> Solver:
    return RandomLegalAsking(domain.legal_budget[min(len(query), len(domain.legal_budget)) - 1])


@dataclass(frozen=True, slots=True)
class RandomOfAll:
    """Random that draws from all actions, `ask` and illegal ones too (PP `run`).

    An illegal action ends the trial: here by abstaining, which has the published cost (it leaves
    the last action out), and a reward that is higher by that action's cost.
    """

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Baseline:
        """Make the policy."""
        return Baseline(partial(_any_action, momdp))


def _any_action(momdp: MOMDP, history: History, rng: np.random.Generator) -> Decision:
    action = int(rng.integers(momdp.abstention))
    illegal = action < momdp.n_behaviors and not momdp.legal[history.belief.x, action]
    return unvalued(momdp, momdp.abstention if illegal else action)


def _random(domain: Domain, query: Query) -> Solver:
    # Where illegal actions move nothing, as on ROC36, they are legal in roc36_every_action.toml.
    return RandomOfAll() if domain.diagram.abstain else Random()


def _sarsop(domain: Domain, query: Query) -> Solver:
    return Sarsop()  # of the paper's 5 s


AGENTS = {
    "random": Agent("random", _random, abstain=True),
    "random_legal": Agent("random_legal", _random_legal),
    "sarsop": Agent("sarsop", _sarsop, abstain=True),
}


def online_agent(name: str) -> Agent:
    """Return an online agent as the published code has it."""
    agent = load_agent(name)
    if isinstance(agent.exploration, ITRSBonus):  # which pays for percepts without end
        agent = replace(agent, exploration=replace(agent.exploration, paid=np.inf))
    return replace(agent, solver=_random_legal) if name == "iterative_random_legal" else agent
