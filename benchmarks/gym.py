"""What an agent scores in the Gymnasium environments, beside the same agent's offline run.

python benchmarks/gym.py [--agent NAME] [--trials N] [--attributes N] [--json]

`paired` plays the tasks of the run with their own luck: the rewards must be equal. `fresh` draws
tasks and luck anew, as training does: its mean must be within two standard errors of the run's.
"""

import argparse
import json
import tempfile
import time
from typing import Any

import numpy as np

from meal_bayes.evaluation import summarize
from meal_bayes.experiments import OfflineConfig, run_offline
from meal_bayes.gym import ENVIRONMENTS, MealEnv


def episode(env: MealEnv, options: dict[str, Any] | None = None) -> float:
    """Play one episode as the agent decides, and return its reward."""
    env.reset(options=options)
    total, done = 0.0, False
    while not done:
        _, reward, terminated, truncated, _ = env.step(env.decide())
        total, done = total + reward, terminated or truncated
    return total


def steps_a_second(env: MealEnv, episodes: int) -> float:
    """Play episodes of random legal actions, without plans; return steps a second of CPU."""
    rng, steps, start = np.random.default_rng(0), 0, time.process_time()
    for _ in range(episodes):
        env.reset()
        done = False
        while not done:
            _, _, terminated, truncated, _ = env.step(
                rng.choice(np.flatnonzero(env.action_masks()))
            )
            steps, done = steps + 1, terminated or truncated
    return steps / (time.process_time() - start)


def measure(dataset: str, agent: str, trials: int, attributes: int) -> dict[str, Any]:
    """Score an agent in one environment and offline."""
    config = OfflineConfig(dataset, attributes=attributes, trials=trials, agents=(agent,))
    with tempfile.TemporaryDirectory() as logs:
        (offline,) = summarize(run_offline(config, logs=logs).trials())
    env = MealEnv(dataset, attributes=attributes, agent=agent, trials=trials)
    start = time.process_time()
    paired = [episode(env, {"task": index}) for index in range(trials)]
    seconds = time.process_time() - start
    env.reset(seed=1)
    fresh = [episode(env) for _ in range(trials)]
    return {
        "dataset": dataset,
        "agent": agent,
        "offline_reward": offline.reward,
        "offline_se": offline.reward_se,
        "paired_reward": float(np.mean(paired)),
        "fresh_reward": float(np.mean(fresh)),
        "fresh_se": float(np.std(fresh, ddof=1) / np.sqrt(trials)),
        "seconds_an_episode": seconds / trials,
        "random_steps_a_second": steps_a_second(env, 1000),
    }


def main() -> None:
    """Measure all shipped environments and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--agent", default="bayes")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--attributes", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    names = [settings["dataset"] for settings in ENVIRONMENTS.values() if settings]
    rows = [measure(name, options.agent, options.trials, options.attributes) for name in names]
    if options.json:
        print(json.dumps(rows, indent=2))
        return
    for key in rows[0]:
        cells = [f"{row[key]:.2f}" if isinstance(row[key], float) else row[key] for row in rows]
        print(f"{key:20s}", *(f"{cell!s:>10s}" for cell in cells))


if __name__ == "__main__":
    main()
