"""A masked policy gradient, trained on 27 objects and tested on 9: [EPISODES]; beside `bayes`."""

import sys
from functools import partial

import gymnasium
import numpy as np


def features(seen, n_x):
    """Return state x (1, log-odds, their size, cost), on which the worth of an answer depends."""
    odds = np.log((seen["belief"] + 1e-3) / (1 - seen["belief"] + 1e-3)) / 3
    return np.kron(np.eye(n_x)[seen["state"]], [1, *odds, *abs(odds), *(seen["cost"] / 50)])


def play(env, choose):
    """Play one episode; return its reward."""
    seen, info = env.reset()
    total = 0.0
    while True:
        seen, reward, terminated, truncated, info = env.step(choose(seen, info["action_mask"]))
        total += reward
        if terminated or truncated:
            return total


def train(env, episodes, rng, *, batch=50, rate=0.05):
    """Maximize the reward by Adam on batches, each reward against the mean of its batch."""
    n_x = env.observation_space["state"].n
    shape = (len(features(env.reset(seed=0)[0], n_x)), env.action_space.n)
    weights, mean, square = np.zeros((3, *shape))  # and Adam's two moments of their gradient

    def choose(slope, seen, mask, *, best=False):
        row = features(seen, n_x)
        logits = np.where(mask, row @ weights, -np.inf)  # what is illegal has probability zero
        prob = np.exp(logits - np.logaddexp.reduce(logits))
        action = int(prob.argmax() if best else rng.choice(len(prob), p=prob))
        slope += np.outer(row, np.eye(len(prob))[action] - prob)  # of ln Pr(action), summed
        return action

    for step in range(1, episodes // batch + 1):
        slopes = np.zeros((batch, *shape))
        rewards = np.array([play(env, partial(choose, slope)) for slope in slopes])
        up = np.tensordot((rewards - rewards.mean()) / (rewards.std() + 1e-9), slopes, 1) / batch
        mean = 0.9 * mean + 0.1 * up
        square = 0.99 * square + 0.01 * up**2
        weights += rate * mean / (1 - 0.9**step) / np.sqrt(square / (1 - 0.99**step) + 1e-9)
    return partial(choose, np.zeros(shape), best=True)


ROC36 = "meal_bayes.gym:meal_bayes/ROC36-v0"  # the module registers it
learning = gymnasium.make(ROC36, attributes=1, agent="bayes", objects="train", scale=1 / 500)
learned = train(learning, int((sys.argv[1:] or ["6000"])[0]), np.random.default_rng(0))
env = gymnasium.make(ROC36, attributes=1, agent="bayes", objects="test")
env.reset(seed=0)
agent = env.get_wrapper_attr("decide")
for name, policy in (("policy gradient", learned), ("bayes", lambda *_: agent())):
    rewards = [play(env, policy) for _ in range(100)]
    print(f"{name}: reward {np.mean(rewards):.0f} ± {np.std(rewards) / 10:.0f} on held-out objects")
