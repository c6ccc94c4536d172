"""The sensors: their noise, and features of ten bins a channel."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from meal_bayes.robots.simulated_arm.physics import CHANNELS, Floats

BINS = 10


class Noise(NamedTuple):
    """Standard deviations of a error: of each sample (500 a second), and of a whole behavior."""

    white: float
    bias: float


NOISE: dict[str, Noise] = {
    "force": Noise(0.25, 0.10),  # N, wrist
    "push": Noise(1.0, 0.10),  # N, wrist
    "fingers": Noise(0.002, 0.0005),  # m, opening
    "height": Noise(0.0005, 0.0005),  # m, of the hand
    "object_y": Noise(0.04, 0.001),  # m, the camera's tracker: 6 mm in .1 s
    "object_z": Noise(0.04, 0.001),  # m, the same
    "load": Noise(2.0, 0.15),  # N, load cell under the table
}
_CONTACT = 1.5  # N, at which the robot notes a contact
_SMOOTH = 15  # samples of the moving average that vibration is taken against

Channels = Mapping[str, Floats]


def sense(channels: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    """Return noisy measurements (T,) of the true channels (T, channels), by name."""
    shown = {}
    for name, values in zip(CHANNELS, channels.T, strict=True):
        noise = NOISE[name]
        error = noise.bias * rng.standard_normal() + noise.white * rng.standard_normal(len(values))
        shown[name] = values + error
    return shown


def _in_bins(values: Floats, statistic: Callable[[Floats], float] = np.mean) -> Floats:
    return np.array([statistic(part) for part in np.array_split(values, BINS)])


def _from_first(values: Floats) -> Floats:
    change: Floats = _in_bins(values) - _in_bins(values)[0]
    return change


def _force(sensed: Channels) -> Floats:
    return _in_bins(sensed["force"])


def _slip(sensed: Channels) -> Floats:
    """Compute how far the object slid in the fingers since the behavior began, (10,) m."""
    return _from_first(sensed["object_z"] - sensed["height"])


def _depth(sensed: Channels) -> Floats:
    """Compute how far the hand moved since the first contact, (10,) m."""
    smooth = np.convolve(sensed["force"], np.ones(_SMOOTH) / _SMOOTH, "same")
    touched = int(np.argmax(smooth < -_CONTACT))
    height = sensed["height"]
    return _in_bins(np.maximum(height[touched] - height, 0.0) * (np.arange(len(height)) > touched))


def _vibration(sensed: Channels) -> Floats:
    """Compute the standard deviation of the force about its moving average, (10,) N."""
    force = sensed["force"]
    smooth = np.convolve(force, np.ones(_SMOOTH) / _SMOOTH, "same")
    return _in_bins((force - smooth)[_SMOOTH:-_SMOOTH], np.std)


MODALITIES: dict[str, dict[str, Callable[[Channels], Floats]]] = {
    "press": {
        "depth": _depth,
        "height": lambda sensed: _in_bins(sensed["height"]),
        "force": _force,
    },
    "push": {
        "force": lambda sensed: _in_bins(sensed["push"]),
        "flow": lambda sensed: _from_first(sensed["object_y"]),
    },
    "grasp": {"fingers": lambda sensed: _in_bins(sensed["fingers"])},
    "lift": {"force": _force, "slip": _slip},
    "hold": {"force": _force, "slip": _slip},
    "shake": {"force": _force, "vibro": _vibration, "slip": _slip},
    "lower": {"force": _force},
    "drop": {"load": lambda sensed: _in_bins(sensed["load"])},
}


def features_of(behavior: str, channels: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    """Return the features of recorded channels, modality -> (10,); empty for `reinit`."""
    if behavior not in MODALITIES:
        return {}
    sensed = sense(channels, rng)
    return {name: make(sensed) for name, make in MODALITIES[behavior].items()}
