"""The published baselines and solver, and MORC as the paper lets it end a trial.

This module imports nothing that judges or shows: the names of their runs go by its code (`key`).
"""

from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from meal_bayes.agents import Agent, ITRSBonus, load_agent
from meal_bayes.arrays import Floats
from meal_bayes.digests import digest_of
from meal_bayes.domain import Domain, Query
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision, History, Policy, Random, Solver, unvalued
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


@dataclass(frozen=True, slots=True)
class Declining:
    """A planner that gives up by an illegal behavior, the paper's only way, at its cost.

    Such a behavior ends the trial, so that the cheapest one is as good as any. Its cost at the
    start is what giving up costs in planning: rewards of reports are as much higher, which leaves
    the differences between actions. What is paid goes by the state (`decline_costs`).

    Attributes
    ----------
    planner : Solver
    """

    planner: Solver

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Policy:
        """Plan with rewards relative to giving up."""
        fee = float(decline_costs(momdp)[momdp.start])
        planned = replace(momdp, correct=momdp.correct + fee, incorrect=momdp.incorrect + fee)
        return self.planner.solve(planned, rng)


@dataclass(frozen=True, slots=True)
class Weighing:
    """A planner for which a right and a wrong report weigh something else than the trial pays.

    Attributes
    ----------
    planner : Solver
    correct, incorrect : float
        Rewards of a right and of a wrong report in planning.
    """

    planner: Solver
    correct: float
    incorrect: float

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Policy:
        """Plan with these rewards."""
        planned = replace(momdp, correct=self.correct, incorrect=self.incorrect)
        return self.planner.solve(planned, rng)


@dataclass(frozen=True, slots=True)
class _Weighed:
    """Makes MORC's planner of a query with rewards of its own."""

    correct: float
    incorrect: float

    def __call__(self, domain: Domain, query: Query) -> Solver:
        return Weighing(_MORC.solver(domain, query), self.correct, self.incorrect)


def weighing(correct: float, incorrect: float) -> Agent:
    """Return MORC that plans with its own bonus of success and penalty of failure."""
    name = f"morc_{correct:g}_{-incorrect:g}"
    return replace(_MORC, name=name, solver=_Weighed(correct, incorrect))


def decline_costs(momdp: MOMDP) -> Floats:
    """Return the cost of the cheapest illegal behavior in each state, (X,) s."""
    illegal = np.where(momdp.legal, np.inf, momdp.cost)
    return np.asarray(illegal.min(axis=1))


def _declining(domain: Domain, query: Query) -> Solver:
    return Declining(_MORC.solver(domain, query))


_MORC = load_agent("morc")
DECLINES = "morc_illegal"
ANSWERS = "morc_must_answer"
WAYS = {  # in which MORC may end a trial; by itself it answers "I do not know" for nothing
    DECLINES: replace(_MORC, name=DECLINES, solver=_declining),
    ANSWERS: replace(_MORC, name=ANSWERS, abstain=False),
}
AGENTS = {
    "random": Agent("random", _random, abstain=True),
    "random_legal": Agent("random_legal", _random_legal),
    "sarsop": Agent("sarsop", _sarsop, abstain=True),
}


@lru_cache(maxsize=1)
def key() -> str:
    """Return what names the code of these agents, by which their trials are reused."""
    return digest_of(*(Path(__file__).with_name(name) for name in ("agents.py", "sarsop.py")))[:16]


def online_agent(name: str) -> Agent:
    """Return an online agent as the published code has it."""
    agent = load_agent(name)
    if isinstance(agent.exploration, ITRSBonus):  # which pays for percepts without end
        agent = replace(agent, exploration=replace(agent.exploration, bonus_limit=np.inf))
    return replace(agent, solver=_random_legal) if name == "iterative_random_legal" else agent
