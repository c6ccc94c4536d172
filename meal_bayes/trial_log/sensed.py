"""What a robot sensed in a step: fields of the step's message, and back."""

from dataclasses import replace
from typing import Any

import numpy as np

from meal_bayes.arrays import freeze
from meal_bayes.datasets import Instance
from meal_bayes.errors import LogCorruptError
from meal_bayes.trial_log import schema


def within_limits(sensed: Instance | None, before: int) -> tuple[Instance | None, int]:
    """Return what of an instance is logged, and how many features of the trial are then.

    Features beyond the limits are left out, as a step without them is worth more than none.
    """
    features = {} if sensed is None else sensed.features or {}
    count = sum(map(len, features.values()))
    if sensed is None or count <= min(schema.FEATURE_LIMIT, schema.TRIAL_FEATURES - before):
        return sensed, before + count
    return (replace(sensed, features=None) if sensed.percepts else None), before


def sensed_fields(sensed: Instance | None) -> dict[str, Any]:
    """Return the fields of what a robot sensed; none of a replay."""
    if sensed is None:
        return {}
    features = sensed.features or {}
    percepts = sensed.percepts or {}
    return {
        "recording": [sensed.recording],
        "modality": list(features),
        "feature_count": [len(values) for values in features.values()],
        "features": [x for values in features.values() for x in values.tolist()],
        "detected": list(percepts),
        "detection": list(percepts.values()),
    }


def read_sensed(message: Any, behavior: str) -> Instance | None:
    """Read what a robot sensed by a behavior; None of a replay."""
    if not message.recording:
        return None
    values = np.array(message.features, np.float32)
    counts = np.array(message.feature_count, np.int64)
    percepts = dict(zip(message.detected, message.detection, strict=True))
    if (
        (counts < 1).any()
        or sum(counts.tolist()) != len(values)
        or not np.isfinite(values).all()
        or not all(-1 <= sure <= 1 for sure in percepts.values())
    ):
        raise LogCorruptError(f"what {behavior} sensed is not finite, or of other sizes")
    parts = np.split(values, np.cumsum(counts)[:-1]) if len(counts) else []
    frozen = (freeze(part, np.float32) for part in parts)
    features = dict(zip(message.modality, frozen, strict=True))
    return Instance(-1, behavior, message.recording[0], features or None, percepts or None)
