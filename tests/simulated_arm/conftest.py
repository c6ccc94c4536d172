"""Objects with stated parameters, and arms that have met them."""

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import pytest

Make = Callable[..., Any]


@pytest.fixture(scope="session")
def make_object(sim: ModuleType) -> Make:
    """Return a function that makes an ordinary empty box, but for what is said of it."""

    def make(**said: object) -> Any:
        ordinary = replace(
            sim.draw_object(0, "ordinary"),
            half_width=0.032, half_depth=0.032, height=0.10, shell_mass=0.15, content_mass=0.0,
            stiffness=6000.0, friction=0.8, color="red", rgb=(0.8, 0.16, 0.14),
            content="nothing", n_balls=0,
        )  # fmt: skip
        return replace(ordinary, **said)

    return make


@pytest.fixture(scope="session")
def feel(sim: ModuleType) -> Make:
    """Return a function that executes behaviors on an object, and returns the last one's features.

    It must end in success.
    """

    def execute(parameters: Any, *behaviors: str, seed: int = 0) -> dict[str, Any]:
        arm = sim.SimulatedArm(parameters, seed)
        arm.start()
        for behavior in behaviors:
            outcome = arm.execute(behavior)
        assert outcome.features is not None, outcome
        return outcome.features

    return execute
