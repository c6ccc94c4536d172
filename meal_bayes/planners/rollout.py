"""The value of any policy inside a MOMDP, with its interval, by simulated episodes."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Transition, best_answer, initial_belief, update_belief
from meal_bayes.momdp.observation import sample_rows
from meal_bayes.planners.solver import History, Policy


@dataclass(frozen=True, slots=True)
class Rollouts:
    """What a policy came to in simulated episodes; n of them."""

    returns: NDArray[np.float64]  # (n,) discounted; the report's reward as its expectation
    certainty: NDArray[np.float64]  # (n,) Pr(report right | all percepts), 0 where abstained
    success: NDArray[np.bool_]  # (n,) was the report right?
    cost: NDArray[np.float64]  # (n,) s
    abstained: NDArray[np.bool_]  # (n,)
    decisions: int
    simulations: int
    cpu_s: float  # of the process in `decide`, s

    def __post_init__(self) -> None:
        for name in ("returns", "certainty", "cost"):
            set_frozen(self, **{name: freeze(getattr(self, name))})
        for name in ("success", "abstained"):
            set_frozen(self, **{name: freeze(getattr(self, name), np.bool_)})

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
    believed: MOMDP | None = None,
    max_steps: int = 100,
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
        paired: at equal states they meet the same objects and the same luck.
    believed : MOMDP | None
        MOMDP whose belief the policy is shown, the world's by default: what it costs to believe in
        another observation model. Both need the same behaviors and attributes.
    max_steps : int
        After which the best answer is given.

    Raises
    ------
    SettingsError
        Fewer than two episodes, or a believed MOMDP of another problem.
    """
    believed = momdp if believed is None else believed
    if believed.query != momdp.query or believed.behavior_names != momdp.behavior_names:
        raise SettingsError("`believed` must have the attributes and behaviors of `momdp`.")
    if episodes < 2:
        raise SettingsError(f"episodes is {episodes}; a standard error needs two or more.")
    rows = []
    for luck in rng.spawn(episodes):
        world_rng, policy_rng = luck.spawn(2)
        rows.append(_episode(momdp, believed, policy, world_rng, policy_rng, max_steps))
    *measures, decisions, simulations, cpu = zip(*rows, strict=True)
    returns, certainty, success, cost, abstained = map(np.array, measures)
    return Rollouts(
        returns, certainty, success, cost, abstained, sum(decisions), sum(simulations), sum(cpu)
    )


def _episode(
    world: MOMDP,
    believed: MOMDP,
    policy: Policy,
    world_rng: np.random.Generator,
    policy_rng: np.random.Generator,
    max_steps: int,
) -> tuple[float, float, bool, float, bool, int, int, float]:
    """Simulate one episode; return its row of `Rollouts`."""
    true, rows = _object(world, world_rng)
    known, belief = initial_belief(world), initial_belief(believed)
    history, total, scale, paid, simulations, cpu = History(belief), 0.0, 1.0, 0.0, 0, 0.0
    report, certainty = None, 0.0
    for step in range(max_steps + 1):
        action = best_answer(believed, belief)
        if step < max_steps:
            before = time.process_time()
            decision = policy.decide(history, policy_rng)
            cpu += time.process_time() - before
            action, simulations = decision.action, simulations + decision.simulations
        if action >= world.n_behaviors:
            report = world.reported(action)
            break
        world.check_action(known.x, action)
        x, percept = _execute(world, known.x, action, rows, known.percept_counts[0], world_rng)
        cost = float(world.cost[action])
        total, paid = total - scale * cost, paid + cost
        scale *= world.discount
        if x == world.terminal:
            break
        transition = Transition(action, x, percept)
        known = belief = update_belief(known, world, transition)
        if believed is not world:
            belief = update_belief(history.belief, believed, transition)
        history = history.after(belief, action, percept is not None, cost)
    if report is not None:
        right = known.agreement(report)
        total += scale * float(world.report_reward(right))
        certainty = float(right.prod())
    success = report is not None and bool((report == true).all())
    return total, certainty, success, paid, report is None, step + 1, simulations, cpu


def _object(
    world: MOMDP, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Draw an object: its truth (N,), and the rows (N,E,K) that its percepts follow."""
    true = rng.random(len(world.query)) < world.prior
    for group in map(list, world.query.groups):
        true[group] = np.arange(len(group)) == _draw(world.prior[group], rng)
    each = np.arange(len(true))
    latent = [_draw(world.latent_classes[i, v], rng) for i, v in enumerate(true.astype(int))]
    mean, precision = world.confusion[each, :, latent], world.precision[each, :, latent]
    return true, sample_rows(mean, precision, 0.0, rng)


def _execute(
    world: MOMDP,
    x: int,
    action: int,
    rows: NDArray[np.float64],
    seen: NDArray[np.int64],
    rng: np.random.Generator,
) -> tuple[int, NDArray[np.int8] | None]:
    """Draw the next x and the percept (N,), None where nothing is perceived."""
    next_x = _draw(world.transition[action, x], rng)
    comes = rng.random() < world.observation_probability[action, x, next_x]
    if not comes or seen[action].sum() >= world.limit[action]:
        return next_x, None
    above = rows[:, action].cumsum(axis=1) <= rng.random(len(rows))[:, None]
    return next_x, np.minimum(above.sum(axis=1), world.levels - 1).astype(np.int8)


def _draw(probabilities: NDArray[np.float64], rng: np.random.Generator) -> int:
    index = int(np.searchsorted(probabilities.cumsum(), rng.random(), side="right"))
    return min(index, len(probabilities) - 1)
