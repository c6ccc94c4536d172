"""An arm in physics (MuJoCo, extra `sim`): a robot that touches objects without limit.

In: a seed, which draws objects, where they lie, and the noise of the sensors. Out: `SimulatedArm`,
a `Robot` that executes behaviors by name, and data sets of its features. No behavior reads a
parameter or a label of its object: features come from the physics and the sensors' noise alone.

`objects` says what an object is, `model` builds its physics, `physics` steps it, `behaviors` holds
the motions, `sensors` and `camera` make features, `arm` is the robot, `record` repeats behaviors.
"""

from importlib.util import find_spec

from meal_bayes.errors import SettingsError

if find_spec("mujoco") is None:
    raise SettingsError(
        "The simulated robot needs MuJoCo: pip install '.[sim]' in a checkout of meal_bayes."
    )

from meal_bayes.robots.simulated_arm.arm import SimulatedArm
from meal_bayes.robots.simulated_arm.objects import ObjectParameters, attributes_of, draw_object
from meal_bayes.robots.simulated_arm.physics import OnFrame
from meal_bayes.robots.simulated_arm.record import Recorded, record_object, to_dataset

__all__ = [
    "ObjectParameters",
    "OnFrame",
    "Recorded",
    "SimulatedArm",
    "attributes_of",
    "draw_object",
    "record_object",
    "to_dataset",
]
