"""Active inference by pymdp on the toy of `learning.py`, for `peers_learning.py`."""

import time
from functools import partial

import equinox
import jax.numpy as jnp
import numpy as np
from learning import COSTS, RATES
from pymdp.agent import Agent

MOST = 12  # executions of a trial
SENSES = len(COSTS)  # actions: look, tap, shake, then the reports no and yes


def make_agent(counts: np.ndarray, scale: float, *, informed: bool = True) -> Agent:
    """Build the agent of one trial from counts (2 percepts,2 truths,SENSES).

    Factors are the truth and the last action. Modalities are the percept (or none), the verdict
    (wrong, right or none) and the seconds. Not `informed`, information is not sought.
    """
    actions = SENSES + 2
    percept = np.zeros((3, 2, 1 + actions))
    percept[:2, :, 1 : 1 + SENSES] = counts
    percept[2, :, [0, *range(1 + SENSES, 1 + actions)]] = 1.0
    verdict = np.zeros((3, 2, 1 + actions))
    verdict[2, :, : 1 + SENSES] = 1.0
    for truth in range(2):
        for report in range(2):
            verdict[int(truth == report), truth, 1 + SENSES + report] = 1.0
    seconds = np.eye(1 + actions)[:, None].repeat(2, axis=1)
    costs = [0.0, *COSTS.values(), 0.0, 0.0]
    stays = np.eye(2)[:, :, None]
    moves = np.zeros((1 + actions, 1 + actions, actions))
    for action in range(actions):
        moves[1 + action, :, action] = 1.0
    known = [percept / percept.sum(axis=0), verdict, seconds]
    prior = [percept, 1e6 * verdict, 1e6 * seconds]  # what is known is not to be learned
    wanted = [np.zeros(3), scale * np.array([-100.0, 100.0, 0.0]), -scale * np.array(costs)]
    start = [np.full(2, 0.5), np.eye(1 + actions)[0]]
    batched = partial(map, lambda array: jnp.asarray(array, jnp.float32)[None])
    return Agent(
        A=list(batched(known)),
        B=list(batched([stays, moves])),
        C=list(batched(wanted)),
        D=list(batched(start)),
        pA=list(batched(prior)),
        A_dependencies=[[0, 1]] * 3,
        B_dependencies=[[0], [1]],
        num_controls=[1, actions],
        use_states_info_gain=informed,
        use_param_info_gain=informed,
        learn_A=False,
    )


@equinox.filter_jit
def free_energies(agent: Agent, belief: jnp.ndarray, last: jnp.ndarray) -> jnp.ndarray:
    """Return minus the expected free energy of each action, (SENSES+2,)."""
    states = [belief[None, None], last[None, None]]
    _, minus = agent.infer_policies(states)
    return minus[0]


def learned(seed: int, trials: int, scale: float) -> dict[str, float]:
    """Measure the first trials of one seed, as `learning.measure` does."""
    begin = time.process_time()
    rng = np.random.default_rng([seed, 1])
    counts = np.ones((2, 2, SENSES))
    rewards = []
    for full in np.random.default_rng([seed, 0]).integers(0, 2, trials).tolist():
        agent = make_agent(counts, scale)
        reporter = make_agent(counts, scale, informed=False)
        belief = np.full(2, 0.5)
        last = np.eye(3 + SENSES)[0]
        seen = []
        cost = 0.0
        report = None
        for _ in range(MOST):
            state = jnp.asarray(belief), jnp.asarray(last)
            senses = free_energies(agent, *state)[:SENSES]
            reports = free_energies(reporter, *state)[SENSES:]
            action = int(np.argmax(np.concatenate([senses, reports])))
            if action >= SENSES:
                report = action - SENSES
                break
            name = list(COSTS)[action]
            yes = int(rng.random() < RATES[name][full])
            cost += COSTS[name]
            seen.append((yes, action))
            belief = belief * (counts[yes, :, action] / counts[:, :, action].sum(axis=0))
            belief /= belief.sum()
            last = np.eye(3 + SENSES)[1 + action]
        if report is None:  # as our trials end, by the best report
            report = int(belief[1] > 0.5)
        for yes, action in seen:
            counts[yes, full, action] += 1
        rewards.append((100.0 if report == full else -100.0) - cost)
    cpu = time.process_time() - begin
    return {"reward": float(np.sum(rewards)), "cpu, s": cpu, "first 15": float(sum(rewards[:15]))}
