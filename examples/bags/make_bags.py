"""Write bags of an arm in physics (MuJoCo): ``python examples/bags/make_bags.py FOLDER``.

Each object's bag holds three rounds of look, press, lift and shake by the arm of
examples/simulated_arm: camera images, joint states, the wrench at the wrist, the sound of a contact
microphone there, and markers that say what was executed.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from simulated_arm.arm import BEHAVIORS, LIFTED, READY, observe_state
from simulated_arm.objects import attributes_of, draw_object
from simulated_arm.physics import ArmPhysics
from simulated_arm.sensors import PIXEL_NOISE, sense, take_picture
from simulated_arm.streams import stream

NS = 1_000_000_000
START = 1_700_000_000 * NS
RATE = 500  # samples a second, of the physics and of the microphone
EVERY = 5  # samples, at which joints and wrench are read: 100 Hz
ATTRIBUTES = ("heavy", "rattles", "tall", "red", "green", "blue")
ROUND = {"look": ("look",), "press": ("press",), "lift": ("grasp", "lift"), "shake": ("shake",)}
AFTER = {"look": READY, "press": READY, "lift": LIFTED, "shake": LIFTED}  # of a success
TOPICS = {
    "/camera/image": "sensor_msgs/msg/Image",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/wrist/wrench": "geometry_msgs/msg/WrenchStamped",
    "/wrist/audio": "audio_common_msgs/msg/AudioData",
    "/markers": "std_msgs/msg/String",
}


def type_store(ros1=False):
    """Return the types of messages, with the one of sound, which is no part of ROS itself."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    store.register(get_types_from_msg("uint8[] data", "audio_common_msgs/msg/AudioData"))
    return store


def header(types, time):
    """Return a header with a stamp (ns), of ROS 1 or ROS 2."""
    stamp = types["builtin_interfaces/msg/Time"](sec=time // NS, nanosec=time % NS)
    kind = types["std_msgs/msg/Header"]
    numbered = {"seq": 0} if "seq" in kind.__dataclass_fields__ else {}
    return kind(stamp=stamp, frame_id="arm", **numbered)


def messages(store, parameters, name, seed, rounds=3):
    """Yield (time, topic, message) of an object's rounds, in the order of time."""
    types = store.types
    text = types["std_msgs/msg/String"]
    rng = stream(seed, "bags", name)
    arm = ArmPhysics(parameters, rng, None)
    time = START
    for _ in range(rounds):
        behaviors = list(ROUND)
        while behaviors:
            picture = take_picture(arm)
            parts = [arm.move(motion) for part in ROUND[behaviors[0]] for motion in BEHAVIORS[part]]
            if observe_state(arm) != AFTER[behaviors[0]]:  # it slipped: begin the round again
                arm.put_back()
                behaviors = list(ROUND)
                continue
            behavior = behaviors.pop(0)
            channels = np.concatenate(parts)
            yield time, "/markers", text(data=f"{behavior}: {name}")
            yield from sorted(
                sensed(types, time, picture, sense(channels, rng), rng), key=lambda one: one[0]
            )
            time += len(channels) * NS // RATE
            yield time, "/markers", text(data="")
            time += NS // 5
        arm.put_back()


def sensed(types, begin, picture, channels, rng):
    """Yield the messages of one behavior: what its sensors measured, by sample."""
    count = len(channels["force"])
    smooth = np.convolve(channels["force"], np.ones(15) / 15, "same")
    sound = np.clip((channels["force"] - smooth) / 20, -1, 1)  # 1 is 20 N
    vector = types["geometry_msgs/msg/Vector3"]
    for sample in range(count):
        time = begin + sample * NS // RATE
        if sample % EVERY == 0:
            joints = types["sensor_msgs/msg/JointState"](
                header=header(types, time), name=["height", "fingers"],
                position=np.array([channels["height"][sample], channels["fingers"][sample]]),
                velocity=np.empty(0), effort=np.empty(0),
            )  # fmt: skip
            yield time, "/joint_states", joints
            force = vector(x=0.0, y=channels["push"][sample], z=channels["force"][sample])
            wrench = types["geometry_msgs/msg/Wrench"](force=force, torque=vector(0.0, 0.0, 0.0))
            stamped = types["geometry_msgs/msg/WrenchStamped"]
            yield time, "/wrist/wrench", stamped(header=header(types, time), wrench=wrench)
        if sample % 25 == 0:
            data = (sound[sample : sample + 25] * 32767).astype("<i2").tobytes()
            audio = types["audio_common_msgs/msg/AudioData"](data=np.frombuffer(data, np.uint8))
            yield time, "/wrist/audio", audio
        if sample % 125 == 0:
            noisy = np.clip(picture + rng.normal(0, PIXEL_NOISE, picture.shape), 0, 1)
            image = types["sensor_msgs/msg/Image"](
                header=header(types, time), height=len(noisy), width=noisy.shape[1],
                encoding="rgb8", is_bigendian=0, step=3 * noisy.shape[1],
                data=(noisy * 255).astype(np.uint8).ravel(),
            )  # fmt: skip
            yield time, "/camera/image", image


def write_bag(path, made, topics=TOPICS):
    """Write what `made(store)` yields as ROS 1 (.bag), ROS 2 MCAP (.mcap), or ROS 2 sqlite."""
    ros1 = path.suffix == ".bag"
    store = type_store(ros1)
    if ros1:
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        ways = {t: writer.add_connection(t, kind, typestore=store) for t, kind in topics.items()}
        write = store.serialize_ros1 if ros1 else store.serialize_cdr
        for time, topic, message in made(store):
            writer.write(ways[topic], time, write(message, topics[topic]))


def make_bags(folder, objects=20, rounds=3, seed=0):
    """Write a bag for each object, of all formats in turn, and labels.csv beside them."""
    folder = Path(folder)
    folder.mkdir(parents=True)
    with (folder / "labels.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["object", *ATTRIBUTES])
        for number in range(objects):
            name = f"box_{number}"
            parameters = draw_object(seed, "bags", number)
            true = attributes_of(parameters)
            rows.writerow([name, *(int(true[attribute]) for attribute in ATTRIBUTES)])
            path = folder / f"{name}{('.bag', '', '.mcap')[number % 3]}"
            write_bag(path, lambda store: messages(store, parameters, name, seed, rounds))  # noqa: B023


if __name__ == "__main__":
    make_bags(sys.argv[1])
