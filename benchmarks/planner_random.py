"""Random query problems that nobody tuned for: `random7-3` is seed 7 with three attributes.

Each seed draws five problems (one to five attributes), each with a diagram, costs, success
probabilities and rates of its own: a chain of x, loops that perceive, ways back. Percepts of
`noisy7-3` say little, so that good plans are long.
"""

import re
from functools import lru_cache
from typing import Any

import numpy as np
from planner_reference import build_model

from meal_bayes.momdp import MOMDP

ATTRIBUTES = 5
_NAME = re.compile(r"(random|noisy)(\d+)-([1-5])")


def names_of(seed: int, *, noisy: bool) -> list[str]:
    """Return the names of a seed's problems."""
    return [f"{'noisy' if noisy else 'random'}{seed}-{n}" for n in range(1, ATTRIBUTES + 1)]


def attributes_of(model: str) -> int | None:
    """Return how many attributes a random problem has; None for the name of any other."""
    match = _NAME.fullmatch(model)
    return None if match is None else int(match[3])


def random_momdp(model: str) -> MOMDP:
    """Build a random problem by name."""
    match = _NAME.fullmatch(model)
    if match is None:
        raise SystemExit(f"{model!r} names no random problem; write random7-3 or noisy7-3")
    return _drawn(int(match[2]), match[1] == "noisy")[int(match[3]) - 1]


@lru_cache(maxsize=1)
def _drawn(seed: int, noisy: bool) -> list[MOMDP]:
    rng = np.random.default_rng([seed, noisy])
    return [build_model(_problem(n, noisy, rng)) for n in range(1, ATTRIBUTES + 1)]


def _rates(n: int, noisy: bool, rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """Draw true and false positive rates (n,) of one behavior."""
    true, false = [], []
    for _ in range(n):
        if rng.random() < 0.55:  # it says something of the attribute
            apart = rng.beta(1.2, 4.0 if noisy else 1.5)
            middle = rng.uniform(0.15, 0.85)
            true.append(min(0.97, middle + apart * (1 - middle)))
            false.append(max(0.03, middle - apart * middle))
        else:
            rate = rng.uniform(0.05, 0.3)
            true.append(min(0.97, rate * rng.uniform(0.9, 1.1)))
            false.append(rate)
    return true, false


def _problem(n: int, noisy: bool, rng: np.random.Generator) -> dict[str, Any]:
    """Draw one problem, in the words of the reference models."""
    size, behaviors = int(rng.integers(4, 8)), list[dict[str, Any]]()

    def add(source: int, target: int, cost: float, success: float, senses: bool) -> None:
        true, false = _rates(n, noisy, rng) if senses else ([0.5] * n, [0.5] * n)
        behaviors.append(
            {
                "behavior": f"b{len(behaviors)}",
                "source": f"x{source}",
                "target": f"x{target}",
                "success": float(success),
                "cost_s": round(float(cost), 2),
                "informative": bool(senses),
                "true_positive_rate": true,
                "false_positive_rate": false,
            }
        )

    for i in range(size - 1):
        cost, success = rng.lognormal(1.0, 0.8), rng.choice([1.0, 0.95, 0.9, 0.8])
        add(i, i + 1, cost, success, rng.random() < 0.8)
    for i in range(size):
        for _ in range(int(rng.integers(0, 3))):
            add(i, i, rng.lognormal(1.2, 0.9), rng.choice([1.0, 0.95]), True)
    for i in range(2, size):
        if rng.random() < 0.5:
            target, cost = int(rng.integers(0, i)), rng.lognormal(1.3, 0.8)
            add(i, target, cost, rng.choice([1.0, 0.95]), rng.random() < 0.5)
    add(size - 1, 0, rng.lognormal(1.3, 0.8), 1.0, False)
    return {
        "model": f"A{n}",
        "attributes": [f"q{i}" for i in range(n)],
        "discount": 0.99,
        "correct": 500,
        "incorrect": -500,
        "behaviors": behaviors,
    }
