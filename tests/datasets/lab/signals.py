"""Signals of a lab that NumPy draws, for tests: images, torques, sound, and markers."""

import runpy
from pathlib import Path

import numpy as np

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "bags"
NS = 1_000_000_000
START = 1_700_000_000 * NS
RATE = 8000  # Hz, of the sound
TOPICS = {
    "/camera/image": "sensor_msgs/msg/Image",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/audio": "audio_common_msgs/msg/AudioData",
    "/markers": "std_msgs/msg/String",
}
MAKER = runpy.run_path(str(EXAMPLE / "make_bags.py"))
header = MAKER["header"]


def messages(store, name, labels, rng, rounds=5):
    """Yield (time, topic, message) of an object's rounds, in the order of time."""
    types = store.types
    heavy, full, red = labels

    time = START
    for _ in range(rounds):
        for behavior, seconds in (("look", 0.3), ("lift", 1.0), ("shake", 0.5)):
            yield time, "/markers", types[TOPICS["/markers"]](data=f"{behavior}: {name}")
            count = round(seconds * 20)
            for tick in range(count):
                now = time + round((tick + 0.5) / 20 * NS)
                if behavior == "look" and tick % 2 == 0:
                    color = np.array([200, 50, 40] if red else [40, 70, 190])
                    pixels = np.clip(color + rng.normal(0, 30, (16, 16, 3)), 0, 255)
                    image = types[TOPICS["/camera/image"]](
                        header=header(types, now), height=16, width=16, encoding="rgb8",
                        is_bigendian=0,
                        step=48, data=pixels.astype(np.uint8).ravel(),
                    )  # fmt: skip
                    yield now, "/camera/image", image
                # Torques: gravity of arm and object, by the angle while it lifts.
                angle = tick / count if behavior == "lift" else 0.0
                mass = 0.4 + 0.6 * heavy + 0.15 * full
                torque = 9.81 * mass * np.array([0.5, 0.3]) * np.cos(angle) + rng.normal(0, 0.3, 2)
                joints = types[TOPICS["/joint_states"]](
                    header=header(types, now), name=["elbow", "shoulder"],
                    position=np.array([angle, angle / 2]), velocity=np.zeros(2), effort=torque,
                )  # fmt: skip
                yield now, "/joint_states", joints
                # Sound: contents rattle at high frequencies, an empty hull hums at low ones.
                moments = np.arange(RATE // 20) / RATE
                loud = 0.3 if behavior == "shake" else 0.0
                hum = np.sin(2 * np.pi * (2500 if full else 400) * moments)
                sound = loud * hum + rng.normal(0, 0.05, len(moments))
                data = (np.clip(sound, -1, 1) * 32767).astype("<i2").tobytes()
                audio = types[TOPICS["/audio"]](data=np.frombuffer(data, np.uint8))
                yield now, "/audio", audio
            time += round(seconds * NS)
            yield time, "/markers", types[TOPICS["/markers"]](data="")
            time += NS // 5


def write_bag(path, made):
    """Write what `made(store)` yields."""
    MAKER["write_bag"](path, made, TOPICS)
