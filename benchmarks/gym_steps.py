"""Gymnasium: random legal steps a second of CPU, and a digest of what was observed."""

import hashlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from measuring import options_of, show

WAYS = ("any legal action", "behaviors alone")
MAX_STEPS = 20
REPEATS = 5
HERE = Path(__file__).resolve().parents[1]


class Episodes:
    """Random episodes of one environment, and a digest of all that it returned."""

    def __init__(self, name: str, way: str) -> None:
        import gymnasium  # noqa: PLC0415  of the package under test
        import numpy as np  # noqa: PLC0415

        import meal_bayes.gym  # noqa: F401, PLC0415  registers the environments

        self._env: Any = gymnasium.make(name, max_steps=MAX_STEPS, disable_env_checker=True)
        self._env = self._env.unwrapped
        self._behaviors = len(self._env.observation_space["percepts"].low[0])
        self._last = self._env.action_space.n if way == WAYS[0] else self._behaviors
        self._rng = np.random.default_rng(0)
        self._digest = hashlib.sha256()

    def run(self, episodes: int, *, digested: bool = False) -> int:
        """Run so many episodes, and return their steps."""
        steps = 0
        for seed in range(episodes):
            observation, info = self._env.reset(seed=seed)
            reward = 0.0
            over = False
            while True:
                if digested:
                    self._add(observation, reward, over, info)
                if over:
                    break
                legal = info["action_mask"][: self._last].nonzero()[0]
                action = legal[int(self._rng.integers(len(legal)))]
                observation, reward, ended, truncated, info = self._env.step(action)
                over = ended or truncated
                steps += 1
        return steps

    def _add(self, observation: dict[str, Any], *returned: object) -> None:
        seen = [
            (name, observation[name] if name == "state" else observation[name].tobytes())
            for name in sorted(observation)
        ]
        told = {name: str(value) for name, value in dict(returned[-1]).items()}  # type: ignore[call-overload]
        self._digest.update(repr((seen, returned[:-1], sorted(told.items()))).encode())

    @property
    def digest(self) -> str:
        """Digest of the episodes that were digested."""
        return self._digest.hexdigest()[:16]


def measured(name: str, way: str) -> dict[str, Any]:
    """Return steps a second of CPU, the best of some rounds, and the digest of 200 episodes."""
    episodes = Episodes(name, way)
    episodes.run(200, digested=True)
    episodes.run(1000)  # every task has come
    best = 0.0
    for _ in range(REPEATS):
        before = time.process_time()
        steps = episodes.run(200)
        best = max(best, steps / (time.process_time() - before))
    return {"steps/s": round(best), "digest": episodes.digest}


def elsewhere(package: Path, name: str, way: str) -> dict[str, Any]:
    """Measure in a process of its own, of the package in a folder."""
    done = subprocess.run(
        [sys.executable, __file__, "--only", way, "--environment", name],
        capture_output=True,
        check=True,
        cwd=package,
        env={**os.environ, "PYTHONPATH": str(package), "OMP_NUM_THREADS": "1"},
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def main() -> None:
    """Measure and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--before", type=Path, help="folder of another version, measured beside")
    parser.add_argument("--environment", default="meal_bayes/ROC36-v0")
    parser.add_argument("--only", choices=WAYS, help="this way alone, of the package as imported")
    options = parser.parse_args()
    if options.only:
        print(json.dumps(measured(options.environment, options.only)))
        return
    rows = []
    for way in WAYS:
        row = {"actions": way, **elsewhere(HERE, options.environment, way)}
        if options.before is not None:
            before = elsewhere(options.before.resolve(), options.environment, way)
            row["before"] = before["steps/s"]
            row["ratio"] = row["steps/s"] / before["steps/s"]
            row["same digest"] = before["digest"] == row["digest"]
        rows.append(row)
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
