"""An arm in physics (MuJoCo, extra `sim`): a robot of one's own, by public names alone.

A seed draws objects, where they lie, and the noise of the sensors. `SimulatedArm` executes
behaviors by name; a learner is fitted to recordings of it, and asks it about new objects. No
behavior reads a parameter or a label of its object: features come from the physics and the noise of
the sensors.

`objects` says what an object is and builds its physics, `physics` steps it, `sensors` makes
features and pictures, `arm` is the robot with its behaviors, `recordings` lets it record objects,
`questions` lets it meet new ones, `__main__` is the command.
"""

from importlib.util import find_spec

if find_spec("mujoco") is None:
    raise SystemExit("The simulated arm needs MuJoCo: pip install '.[sim]' in a checkout.")

from simulated_arm.arm import SimulatedArm
from simulated_arm.objects import attributes_of, draw_object
from simulated_arm.physics import OnFrame
from simulated_arm.questions import ask_new, learn_live
from simulated_arm.recordings import training_recordings

__all__ = [
    "OnFrame", "SimulatedArm", "ask_new", "attributes_of", "draw_object",
    "learn_live", "training_recordings",
]  # fmt: skip
