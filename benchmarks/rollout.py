"""The value of any policy inside a MOMDP, with its interval, by simulated episodes."""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import ByValue, Floats
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import (
    MOMDP,
    Belief,
    Transition,
    best_answer,
    expected_reward,
    initial_belief,
    report_certainty,
    update_belief,
)
from meal_bayes.momdp.belief import percepts_left
from meal_bayes.momdp.observation import sample_rows
from meal_bayes.momdp.reports import ABSTAINED
from meal_bayes.planners.solver import MAX_STEPS, History, Policy, decide


@dataclass(frozen=True, slots=True)
class Rollouts(ByValue):
    """What a policy came to in simulated episodes; n of them."""

    returns: Floats  # (n,) discounted; the report's reward as its expectation
    certainty: Floats  # (n,) Pr(report right | all percepts), 0 where abstained
    success: NDArray[np.bool_]  # (n,) was the report right?
    cost: Floats  # (n,) s
    abstained: NDArray[np.bool_]  # (n,)
    decisions: int
    simulations: int
    cpu_s: float  # of the process in `decide`, s

    @property
    def value(self) -> float:
        """Estimate of the policy's value."""
        return float(self.returns.mean())

    @property
    def value_se(self) -> float:
        """Standard error of `value`."""
        return float(self.returns.std(ddof=1) / np.sqrt(len(self.returns)))


def simulate(
    momdp: MOMDP,
    policy: Policy,
    episodes: int,
    rng: np.random.Generator,
    *,
    max_steps: int = MAX_STEPS,
) -> Rollouts:
    """Simulate episodes; truths, objects' rows and failures are drawn from the MOMDP.

    The reward of a report is replaced by its expectation given everything perceived: unbiased
    under the model, with a standard error 3 to 8 times smaller.

    Parameters
    ----------
    momdp : MOMDP
        The world. At finite precision every episode draws the object's rows.
    policy : Policy
        Decides.
    episodes : int
        How many, 2 or more.
    rng : np.random.Generator
        Every episode spawns its own streams of world and policy from it, so that policies are
        paired: at equal states they meet the same objects, failures and percepts.
    max_steps : int
        After which the best answer is given.

    Raises
    ------
    SettingsError
        Fewer than two episodes.
    """
    if episodes < 2:
        raise SettingsError(
            f"episodes is {episodes}; give two or more, because a standard error needs them."
        )
    streams = rng.spawn(episodes)
    played = [_episode(momdp, policy, stream, max_steps) for stream in streams]
    return Rollouts(
        returns=np.array([episode.value for episode in played]),
        certainty=np.array([episode.certainty for episode in played]),
        success=np.array([episode.success for episode in played]),
        cost=np.array([episode.cost for episode in played]),
        abstained=np.array([episode.abstained for episode in played]),
        decisions=sum(episode.decisions for episode in played),
        simulations=sum(episode.simulations for episode in played),
        cpu_s=sum(episode.cpu_s for episode in played),
    )


class _Episode(NamedTuple):
    """What a policy came to in one episode; see `Rollouts`."""

    value: float
    certainty: float
    success: bool
    cost: float
    abstained: bool
    decisions: int
    simulations: int
    cpu_s: float


def _episode(world: MOMDP, policy: Policy, rng: np.random.Generator, max_steps: int) -> _Episode:
    """Simulate one episode."""
    world_rng, policy_rng = rng.spawn(2)
    true, rows = _object(world, world_rng)
    history = History(initial_belief(world))
    value = 0.0
    scale = 1.0
    report = None
    simulations = 0
    cpu_s = 0.0
    for step in range(max_steps + 1):
        belief = history.belief
        action = best_answer(world, belief)
        if step < max_steps:
            started = time.process_time()
            decision = decide(policy, history, policy_rng)
            cpu_s += time.process_time() - started
            action = decision.action
            simulations += decision.simulations
        if action >= world.n_behaviors:
            report = world.reported(action)
            break
        world.check_action(belief.x, action)
        x, percept = _execute(world, belief, action, rows, world_rng)
        cost = world.charged_for(action, belief.x, x, perceived=percept is not None)
        value -= scale * cost
        scale *= world.discount
        after = update_belief(belief, world, Transition(action, x, percept))
        history = history.after(after, action, percept is not None, cost)
        if x == world.terminal:
            break
    certainty = 0.0
    if report is not None:
        # E[R | percepts] in place of R (Rao-Blackwell): the same mean, less variance.
        value += scale * expected_reward(world, history.belief, report)
        certainty = report_certainty(world, history.belief, report)
    elif action == world.abstention:
        value += scale * ABSTAINED
    true_report = world.query.report_truth(true.astype(np.int8))
    return _Episode(
        value=value,
        certainty=certainty,
        success=report is not None and bool((report == true_report).all()),
        cost=history.cost,
        abstained=report is None,
        decisions=step + 1,
        simulations=simulations,
        cpu_s=cpu_s,
    )


def _object(world: MOMDP, rng: np.random.Generator) -> tuple[NDArray[np.bool_], Floats]:
    """Draw an object: its truth (N,), and the rows (N,E,K) that its percepts follow."""
    true = rng.random(len(world.query)) < world.prior
    for group in map(list, world.query.groups):
        # Of a group exactly one value is true.
        true[group] = np.arange(len(group)) == _draw(world.prior[group], rng)
    if world.joint is not None:
        true = world.query.values[_draw(world.joint, rng)]
    attributes = np.arange(len(true))
    latent = [_draw(world.latent_classes[i, v], rng) for i, v in enumerate(true.astype(int))]
    mean = world.confusion[attributes, :, latent]
    precision = world.precision[attributes, :, latent]
    return true, sample_rows(mean, precision, 0.0, rng)


def _execute(
    world: MOMDP, belief: Belief, action: int, rows: Floats, rng: np.random.Generator
) -> tuple[int, NDArray[np.int8] | None]:
    """Draw the next x and the percept (N,), None where nothing is perceived."""
    next_x = _draw(world.transition[action, belief.x], rng)
    comes = rng.random() < world.observation_probability[action, belief.x, next_x]
    if not comes or percepts_left(world, belief)[action] <= 0:
        return next_x, None
    # Inversion: the level is the number of cumulative probabilities at or below u.
    above = rows[:, action].cumsum(axis=1) <= rng.random(len(rows))[:, None]
    return next_x, np.minimum(above.sum(axis=1), world.levels - 1).astype(np.int8)


def _draw(probabilities: Floats, rng: np.random.Generator) -> int:
    index = int(np.searchsorted(probabilities.cumsum(), rng.random(), side="right"))
    return min(index, len(probabilities) - 1)
