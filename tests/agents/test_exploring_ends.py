"""Whoever is paid to explore stops: in generated domains, with every bonus and planner."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes.agents import ITRSBonus, LearningBonus, load_agent
from meal_bayes.domain import Query, domain_from_table
from meal_bayes.learner import Learner
from meal_bayes.planners import POMCP, Greedy, OpenLoop
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.robots import Outcome

BONUSES = {
    "learning": LearningBonus(),
    "published": ITRSBonus(),
    "generous": ITRSBonus(alpha=60.0, beta=1.0),
}
PLANNERS = {"search": POMCP(100), "plans": POMCP(0), "open loop": OpenLoop(), "greedy": Greedy()}
REWARD = 100.0
TRIALS = 4


@dataclass(frozen=True)
class Always:
    """The same planner for every query."""

    planner: object

    def __call__(self, domain, query):
        return self.planner


@st.composite
def domains(draw):
    """Draw a domain: looking, lifting what may slip, shaking what is held, perhaps a person."""
    costs = st.floats(0.5, 15.0)
    success = st.sampled_from([1.0, 0.8, 0.4])
    behaviors = [
        {"name": "look", "cost": draw(costs), "modalities": ["camera"]},
        {"name": "lift", "cost": draw(costs), "modalities": ["wrist"]},
        {"name": "shake", "cost": draw(costs), "modalities": ["wrist"]},
        {"name": "put_down", "cost": draw(costs)},
    ]
    effects = [
        {"from": "table", "do": "look", "to": "table", "probability": draw(success)},
        {"from": "table", "do": "lift", "to": "held", "probability": draw(success)},
        {"from": "held", "do": "shake", "to": "held", "probability": draw(success)},
        {"from": "held", "do": "put_down", "to": "table"},
    ]
    if draw(st.booleans()):
        behaviors.append({"name": "ask", "cost": draw(costs), "answer_accuracy": 0.95})
        effects.append({"from": "table", "do": "ask", "to": "table"})
    return domain_from_table({
        "name": "drawn",
        "attributes": ["red", "full", "heavy"][: draw(st.integers(1, 3))],
        "report_reward": REWARD,
        "behaviors": behaviors,
        "diagram": {"states": ["table", "held"], "start": "table", "effects": effects},
    })  # fmt: skip


class Arm:
    """Executes what the diagram says, with an object of known attributes; a person answers."""

    def __init__(self, domain, truth, rng):
        self.domain = domain
        self.truth = truth
        self.rng = rng

    def start(self):
        self.state = "table"
        return self.state

    def execute(self, behavior):
        effects = self.domain.diagram.effects
        (effect,) = (e for e in effects if (e.source, e.behavior) == (self.state, behavior))
        if self.rng.random() >= effect.probability:
            return Outcome(self.state)
        self.state = effect.target
        if behavior == "ask":
            return Outcome(self.state, answers=self.truth)
        spec = self.domain.behaviors[self.domain.behavior_index(behavior)]
        signal = np.array([*self.truth.values()]) * 2.0
        features = {name: signal + self.rng.normal(size=len(signal)) for name in spec.modalities}
        return Outcome(self.state, features or None)


def perceived(trials):
    """Return the most percepts of each behavior in any of these trials, (E,)."""
    return np.max([t.last_belief.percept_counts[0].sum(axis=1) for t in trials], axis=0)


def answered(trials, domain):
    """Return the most often that a person was asked in any of these trials."""
    asks = [e for e, spec in enumerate(domain.behaviors) if spec.answer_accuracy is not None]
    return max(sum(step.decision.action in asks for step in t.steps) for t in trials)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*yielded nothing several times")
@pytest.mark.filterwarnings("ignore:.*answered without touching anything")
@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("bonus", BONUSES)
@settings(max_examples=max(settings().max_examples // 25, 2))  # 100: --hypothesis-profile=bars
@given(domain=domains(), seed=st.integers(0, 999))
def test_no_agent_explores_or_asks_without_end(planner, bonus, domain, seed):
    solver = PLANNERS[planner]
    agent = replace(
        load_agent("bayes"), name="drawn", solver=Always(solver), exploration=BONUSES[bonus]
    )
    learner = Learner(domain, agent=agent, seed=seed, logs=None)
    rng = np.random.default_rng(seed)
    for _ in range(TRIALS):
        truth = {name: bool(rng.integers(2)) for name in domain.attributes}
        asked = [name for name in domain.attributes if rng.random() < 0.6] or domain.attributes[:1]
        query = Query(tuple(asked))
        tests = [learner.ask(query, Arm(domain, truth, rng), learn=False) for _ in range(3)]
        trial = learner.ask(query, Arm(domain, truth, rng), truth=truth)
        assert len(trial.steps) < MAX_STEPS
        unpaid = perceived([trial]) - trial.momdp.bonus_limit - perceived(tests)
        unpaid[domain.behavior_index("lift")] -= trial.momdp.bonus_limit[0]  # it leads to shaking
        assert (unpaid <= 0).all()
        assert answered([trial], domain) <= answered(tests, domain) + 2
        for step in trial.steps:
            assert not (step.decision.values > REWARD + 1e-9).any()
        learner.tell(trial, truth)
