"""A masked policy gradient, trained on 27 objects and tested on 9: [EPISODES]; beside `bayes`."""

import sys

import gymnasium
import numpy as np

BATCH = 50
RATE = 0.05


def features(seen, n_x):
    """Return state x (1, log-odds, their size, cost), on which the worth of an answer depends."""
    odds = np.log((seen["belief"] + 1e-3) / (1 - seen["belief"] + 1e-3)) / 3
    return np.kron(np.eye(n_x)[seen["state"]], [1, *odds, *abs(odds), *(seen["cost"] / 50)])


def play(env, choose):
    """Play one episode; return its reward."""
    (seen, info) = env.reset()
    total = 0.0
    ended = False
    while not ended:
        seen, reward, terminated, truncated, info = env.step(choose(seen, info["action_mask"]))
        total = total + reward
        ended = terminated or truncated
    return total


def train(env, episodes, rng):
    """Maximize the reward by Adam on batches, each reward against the mean of its batch."""
    n_x = env.observation_space["state"].n
    n_a = env.action_space.n
    weights, mean, square, slope = np.zeros((4, len(features(env.reset(seed=0)[0], n_x)), n_a))

    def choose(seen, mask, *, best=False):
        row = features(seen, n_x)
        logits = np.where(mask, row @ weights, -np.inf)
        prob = np.exp(logits - np.logaddexp.reduce(logits))
        action = int(prob.argmax() if best else rng.choice(n_a, p=prob))
        slope[:] += np.outer(row, np.eye(n_a)[action] - prob)  # of ln Pr(action)
        return action

    for step in range(1, episodes // BATCH + 1):
        rewards = np.zeros(BATCH)
        slopes = np.zeros((BATCH, *weights.shape))
        for i in range(BATCH):
            slope[:] = 0.0
            rewards[i] = play(env, choose)
            slopes[i] = slope
        up = np.tensordot((rewards - rewards.mean()) / (rewards.std() + 1e-9), slopes, 1) / BATCH
        mean = 0.9 * mean + 0.1 * up
        square = 0.99 * square + 0.01 * up**2
        weights += RATE * mean / (1 - 0.9**step) / np.sqrt(square / (1 - 0.99**step) + 1e-9)
    return lambda seen, mask: choose(seen, mask, best=True)


ROC36 = "meal_bayes.gym:meal_bayes/ROC36-v0"  # the module registers it
learning = gymnasium.make(ROC36, attributes=1, agent="bayes", objects="train", scale=1 / 500)
learned = train(learning, int((sys.argv[1:] or ["6000"])[0]), np.random.default_rng(0))
env = gymnasium.make(ROC36, attributes=1, agent="bayes", objects="test")
env.reset(seed=0)
agent = env.get_wrapper_attr("decide")
for name, policy in (("policy gradient", learned), ("bayes", lambda *_: agent())):
    rewards = [play(env, policy) for _ in range(100)]
    print(f"{name}: reward {np.mean(rewards):.0f} ± {np.std(rewards) / 10:.0f} on held-out objects")
