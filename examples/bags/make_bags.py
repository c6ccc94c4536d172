"""Write bags of a simulated lab: ``python examples/bags/make_bags.py FOLDER``.

Each object's bag holds five rounds of look, lift and shake: images, joint torques (with gravity and
noise), sound of what rattles in it, and markers that say what was executed. The signals are drawn
by NumPy from simple equations of a two-joint arm; no simulator is needed.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

NS = 1_000_000_000
START = 1_700_000_000 * NS
RATE = 8000  # Hz, of the sound
TOPICS = {
    "/camera/image": "sensor_msgs/msg/Image",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/audio": "audio_common_msgs/msg/AudioData",
    "/markers": "std_msgs/msg/String",
}


def type_store(ros1=False):
    """Return the types of messages, with the one of sound, which is no part of ROS itself."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    store.register(get_types_from_msg("uint8[] data", TOPICS["/audio"]))
    return store


def messages(store, name, labels, rng, rounds=5):
    """Yield (time, topic, message) of an object's rounds, in the order of time."""
    types = store.types
    heavy, full, red = labels

    def header(time):
        stamp = types["builtin_interfaces/msg/Time"](sec=time // NS, nanosec=time % NS)
        fields = {"stamp": stamp, "frame_id": "arm"}
        if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__:
            fields["seq"] = 0
        return types["std_msgs/msg/Header"](**fields)

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
                        header=header(now), height=16, width=16, encoding="rgb8", is_bigendian=0,
                        step=48, data=pixels.astype(np.uint8).ravel(),
                    )  # fmt: skip
                    yield now, "/camera/image", image
                # Torques: gravity of arm and object, by the angle while it lifts.
                angle = tick / count if behavior == "lift" else 0.0
                mass = 0.4 + 0.6 * heavy + 0.15 * full
                torque = 9.81 * mass * np.array([0.5, 0.3]) * np.cos(angle) + rng.normal(0, 0.3, 2)
                joints = types[TOPICS["/joint_states"]](
                    header=header(now), name=["elbow", "shoulder"],
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


def write_bag(path, name, labels, seed, rounds=5):
    """Write one bag: ROS 1 (.bag), MCAP (.mcap in its name) or sqlite, by the name of the path."""
    ros1 = path.suffix == ".bag"
    store = type_store(ros1)
    if ros1:
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        ways = {t: writer.add_connection(t, kind, typestore=store) for t, kind in TOPICS.items()}
        write = store.serialize_ros1 if ros1 else store.serialize_cdr
        rng = np.random.default_rng(seed)
        for time, topic, message in messages(store, name, labels, rng, rounds):
            writer.write(ways[topic], time, write(message, TOPICS[topic]))


def make_bags(folder, objects=16, rounds=5):
    """Write a bag for each object, of all formats in turn, and labels.csv beside them."""
    folder = Path(folder)
    folder.mkdir(parents=True)
    with (folder / "labels.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["object", "heavy", "full", "red"])
        for number in range(objects):
            labels = number & 1, number >> 1 & 1, number >> 2 & 1
            name = f"cup_{number}"
            rows.writerow([name, *labels])
            write_bag(folder / f"{name}{('.bag', '', '.mcap')[number % 3]}", name, labels, number,
                      rounds)  # fmt: skip


if __name__ == "__main__":
    make_bags(sys.argv[1])
