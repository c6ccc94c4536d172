"""The ROS 2 node's logic, against stand-ins of rclpy's classes that publish during a behavior."""

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import meal_bayes as mb

ROOT = Path(__file__).resolve().parents[2]
LAB = ROOT / "examples" / "bags" / "lab.toml"


@pytest.fixture
def explorer(monkeypatch):
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "stand_ins"))
    import rclpy.node  # noqa: PLC0415  the stand-in
    from lab_interfaces.action import Explore  # noqa: PLC0415

    def subscribe(self, kind, topic, callback, depth):
        self.__dict__.setdefault("callbacks", {})[topic] = callback

    clock = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1))
    monkeypatch.setattr(rclpy.node.Node, "create_subscription", subscribe, raising=False)
    monkeypatch.setattr(rclpy.node.Node, "get_clock", lambda self: clock, raising=False)
    monkeypatch.setattr(Explore, "execute", classmethod(execute))
    yield runpy.run_path(str(ROOT / "examples" / "ros2" / "explorer.py"))
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in {"rclpy", "action_msgs", "lab_interfaces"}:
            del sys.modules[name]


def execute(cls, goal, fails):
    state = "hand" if goal.behavior == "shake" or (goal.behavior == "lift" and not fails) else ""
    cls.state = state or getattr(cls, "now", "table")
    cls.now = cls.state
    return SimpleNamespace(state=cls.state)


@pytest.mark.parametrize("start", ["table", "hand"])
def test_the_node_makes_features_of_what_came_during_a_behavior(explorer, start, monkeypatch):
    """It begins where the robot is: it may hold an object already."""
    import rclpy  # noqa: PLC0415  the stand-in
    from lab_interfaces.action import Explore  # noqa: PLC0415  as above

    monkeypatch.setattr(Explore, "now", start, raising=False)

    learner = mb.Learner(LAB, logs=None)
    topics = dict.fromkeys(explorer["TOPICS"])
    node = explorer["Explorer"](learner, "Is it heavy?", topics)

    def message(kind, **fields):
        return type(kind, (SimpleNamespace,), {})(**fields)

    pixels = np.zeros(3, np.uint8)
    image = {"height": 1, "width": 1, "step": 3, "encoding": "rgb8", "data": pixels}
    while not node.done.done():
        if node.recorder is not None:
            node.callbacks["/joint_states"](
                message("JointState", name=["fingers", "height"], position=[2, 1])
            )
            force = SimpleNamespace(x=0.0, y=3.0, z=4.0)
            wrench = SimpleNamespace(force=force, torque=force)
            node.callbacks["/wrist/wrench"](message("WrenchStamped", wrench=wrench))
            node.callbacks["/camera/image"](message("Image", is_bigendian=0, **image))
            node.callbacks["/wrist/audio"](message("AudioData", data=np.zeros(800, np.uint8)))
        rclpy.QUEUE.popleft()()
    trial = node.done.result()
    assert node.session.over
    assert trial.ended == ""
    assert trial.momdp.x_names[trial.steps[0].x] == start
    sensed = [step.sensed.features for step in trial.steps if step.sensed is not None]
    assert sensed
    made = {
        "color": [1] + [0] * 26, "joints": [1] * 10 + [2] * 10, "wrench": [3] * 10 + [4] * 10,
        "audio": [-10] * 10,
    }  # fmt: skip
    for features in sensed:
        for name, vector in features.items():
            assert vector.tolist() == made[name]
