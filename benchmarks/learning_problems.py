"""Tiny learning problems, whose Bayes-adaptive optimum `bayes_adaptive.py` computes."""

from typing import NamedTuple

import numpy as np


class Problem(NamedTuple):
    """A learning problem of B behaviors.

    Attributes
    ----------
    name : str
        Of the problem.
    trials : int
        T.
    costs : tuple of float
        (B,) s.
    prior : float
        Pr(the attribute is true).
    reward : float
        r of a report, s.
    known : tuple of float | None
        Pr(yes | false) and Pr(yes | true) of the first behavior, if these are known.
    weight : float
        w of all other rows.
    """

    name: str
    trials: int
    costs: tuple[float, ...]
    prior: float = 0.5
    reward: float = 100.0
    known: tuple[float, float] | None = None
    weight: float = 1.0

    @property
    def unknown(self) -> list[int]:
        """Behaviors whose rows are not known, (U,)."""
        return list(range(self.known is not None, len(self.costs)))


PROBLEMS = (
    Problem("two cheap", 8, (2.0, 2.0)),
    Problem("cheap and dear", 8, (2.0, 20.0)),
    Problem("two dear", 8, (30.0, 30.0)),
    Problem("rare attribute", 8, (5.0, 5.0), prior=0.2),
    Problem("three", 4, (2.0, 5.0, 15.0)),
    Problem("beside a weak known one", 12, (2.0, 5.0), known=(0.35, 0.65)),
    Problem("beside a weak known one", 24, (2.0, 5.0), known=(0.35, 0.65)),
    Problem("beside a good known one", 24, (5.0, 2.0), known=(0.1, 0.9)),
    Problem("dear, beside a good known one", 24, (5.0, 20.0), known=(0.2, 0.8)),
    Problem("doubted, beside a known one", 24, (2.0, 5.0), known=(0.3, 0.7), weight=4.0),
    Problem("much doubted, beside a known one", 24, (2.0, 5.0), known=(0.25, 0.75), weight=10.0),
)


def drawn_problem(number: int, seed: int) -> Problem:
    """Draw a problem: two unknown behaviors, or one beside a known one."""
    rng = np.random.default_rng([seed, number])
    costs = np.exp(rng.uniform(0.0, np.log(40.0), 2)).round(1)
    prior = 0.5 if rng.random() < 0.4 else round(float(rng.uniform(0.1, 0.9)), 2)
    problem = Problem(f"drawn {number}", int(rng.integers(4, 8)), tuple(costs.tolist()), prior)
    if number % 3 == 0:
        return problem
    low = round(float(rng.uniform(0.05, 0.45)), 2)
    high = round(1 - low * float(rng.uniform(0.5, 1.5)), 2)
    trials = int(rng.integers(6, 25))
    weight = float(rng.choice([1.0, 2.0, 4.0]))
    return problem._replace(trials=trials, known=(low, high), weight=weight)
