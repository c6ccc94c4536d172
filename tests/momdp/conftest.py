"""What the tests of beliefs and of written problems share."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import (
    MOMDP,
    Belief,
    Transition,
    build_momdp,
    initial_belief,
    update_belief,
)


@pytest.fixture(scope="session")
def follow() -> Callable[..., list[Belief]]:
    """Filter the percept levels, or None, of named behaviors; return the belief after each."""

    def beliefs(momdp: MOMDP, steps: Iterable[tuple[str, list[int] | None]]) -> list[Belief]:
        belief = initial_belief(momdp)
        after = []
        for behavior, levels in steps:
            observation = None if levels is None else np.array(levels, dtype=np.int8)
            action = momdp.behavior_names.index(behavior)
            belief = update_belief(belief, momdp, Transition(action, belief.x, observation))
            after.append(belief)
        return after

    return beliefs


@pytest.fixture(scope="session")
def momdp_of() -> Callable[..., MOMDP]:
    """Build a problem of a domain's first attributes with random rows and priors."""

    def build(name: str, n: int, levels: int = 2, **options: object) -> MOMDP:
        domain = load_domain(name)
        rng = np.random.default_rng(0)
        confusion = rng.dirichlet(np.ones(levels), (n, len(domain.behaviors), 2))
        prior = rng.uniform(0.2, 0.8, n)
        return build_momdp(domain, Query(domain.attributes[:n]), confusion, prior=prior, **options)

    return build
