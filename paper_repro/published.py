"""Baselines as the published code has them, where it departs from the paper."""

from dataclasses import dataclass, replace

import numpy as np

from meal_bayes.agents import Agent, load_agent
from meal_bayes.domain import Domain, Query
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision, History, Policy, RandomLegal, Solver, unvalued

ASK = "ask"


@dataclass(frozen=True, slots=True)
class RandomLegalAsking:
    """Random Legal that may ask a person as well, at the start alone (PP `_legal_actions`)."""

    budget: float

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "RandomLegalAskingPolicy":
        """Make the policy."""
        first, later = RandomLegal(self.budget), RandomLegal(self.budget, (ASK,))
        return RandomLegalAskingPolicy(
            momdp.start, first.solve(momdp, rng), later.solve(momdp, rng)
        )


@dataclass(frozen=True, slots=True)
class RandomLegalAskingPolicy:
    """Policy of `RandomLegalAsking`."""

    start: int
    first: Policy
    later: Policy

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Draw a legal behavior, or report once the budget is spent."""
        policy = self.first if history.belief.x == self.start else self.later
        return policy.decide(history, rng)


def _random_legal(domain: Domain, query: Query) -> Solver:
    return RandomLegalAsking(domain.legal_budget[min(len(query), len(domain.legal_budget)) - 1])


@dataclass(frozen=True, slots=True)
class RandomOfAll:
    """Random that draws from all actions, illegal ones and `ask` too."""

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "RandomOfAllPolicy":
        """Make the policy."""
        return RandomOfAllPolicy(momdp)


@dataclass(frozen=True, slots=True)
class RandomOfAllPolicy:
    """Policy of `RandomOfAll`."""

    momdp: MOMDP

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Draw an action."""
        actions = self.momdp.n_behaviors + 2 ** len(self.momdp.query)
        return unvalued(self.momdp, int(rng.integers(actions)))


def _random(domain: Domain, query: Query) -> Solver:
    return RandomOfAll()


AGENTS = {
    "random": Agent("random", _random),
    "random_legal": Agent("random_legal", _random_legal),
}


def online_agent(name: str) -> Agent:
    """Return an online agent as the published code has it."""
    agent = load_agent(name)
    return replace(agent, solver=_random_legal) if name == "iterative_random_legal" else agent
