"""An arm in physics (MuJoCo, extra `sim`): a robot that touches objects without limit.

In: a seed, which draws objects, where they lie, and the noise of the sensors. Out: `SimulatedArm`,
a `Robot` that executes behaviors by name; recordings of it, on which a learner is fitted; and
answers about objects that it meets. No behavior reads a parameter or a label of its object:
features come from the physics and the sensors' noise alone.

`objects` says what an object is and builds its physics, `physics` steps it, `sensors` makes
features and pictures, `arm` is the robot with its behaviors, `recordings` lets it record objects,
`questions` lets it meet new ones.
"""

from importlib.util import find_spec

from meal_bayes.errors import SettingsError

if find_spec("mujoco") is None:
    raise SettingsError(
        "The simulated robot needs MuJoCo: pip install '.[sim]' in a checkout of meal_bayes."
    )

from meal_bayes.simulated_arm.arm import SimulatedArm
from meal_bayes.simulated_arm.objects import attributes_of, draw_object
from meal_bayes.simulated_arm.physics import OnFrame
from meal_bayes.simulated_arm.questions import ask_new, learn_live
from meal_bayes.simulated_arm.recordings import training_recordings

__all__ = [
    "OnFrame", "SimulatedArm", "ask_new", "attributes_of", "draw_object",
    "learn_live", "training_recordings",
]  # fmt: skip
