"""Columns of the record of a robot: of what kinds its rows are, and what stands in each."""

import hashlib
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.seeds import Key

Labels = NDArray[np.int8]
Objects = tuple[int, ...]  # by their rows in a percept table
Context = tuple[str, str]  # (behavior, modality)

FROM_DATASET = 0  # an instance's origin: a data set that was fitted
FROM_TRIAL = 1  # or a trial of the robot
WITHDRAWN = 2  # or nothing any more: it was forgotten; so is what an execution's success was
NONE = -1  # in place of a row's number

_NAME_KEY = "told"  # begins the key of labels that are told of an object by its name


class InstanceRow(NamedTuple):
    """What stands in the record of an instance."""

    object: int
    behavior: int
    digest: int  # of its features; 0: there are none
    copy: int  # how many with this digest came before it
    recording: int  # its number in the data set that is replayed; NONE
    origin: int
    scale: int  # K, of its percepts in the trial; 0 where it is of a data set


class ExecutionRow(NamedTuple):
    """What stands in the record of an execution."""

    trial: int
    behavior: int
    instance: int  # NONE: nothing was perceived
    success: int  # 1, 0, -1 where failing and succeeding look the same; WITHDRAWN


class FeedbackRow(NamedTuple):
    """What stands in the record of one label that was told."""

    trial: int
    call: int  # labels that were told together
    object: int
    attribute: int
    value: int  # 1, 0, or -1 where those of the trial before it were withdrawn
    given: int  # 1: by a data set, 0: by a person


INSTANCE = np.dtype([(name, np.int64) for name in InstanceRow._fields])
EXECUTION = np.dtype([(name, np.int64) for name in ExecutionRow._fields])
FEEDBACK = np.dtype([(name, np.int64) for name in FeedbackRow._fields])


def features_digest(features: Mapping[str, NDArray[np.float32]] | None) -> int:
    """Compute the digest of a recording's features by modality; 0 where there are none."""
    if not features:
        return 0
    digest = hashlib.blake2b(digest_size=8)
    for modality in sorted(features):
        values = np.ascontiguousarray(features[modality], "<f4")
        digest.update(f"{modality}\0{len(values)}\0".encode())
        digest.update(values.tobytes())
    return int.from_bytes(digest.digest()) >> 1 or 1


def unnamed(identity: str) -> str:
    """Return what an object is called that nobody has named, by 16 hexadecimal digits.

    `trial.task_of` draws them, as names of two programs must differ; `nobody_named` tells such a
    name from a person's, and `views.in_order` lets no order come of it.
    """
    return f"object {identity}"


def nobody_named(name: str) -> bool:
    """Return whether an object's name was drawn.

    >>> nobody_named(unnamed("30a0d9a3fcdbb969")), nobody_named("object 3")
    (True, False)
    """
    return re.fullmatch("object [0-9a-f]{16}", name) is not None


def key_of_name(name: str) -> Key:
    """Return what stands for a trial's key where labels are told of an object by its name."""
    return (_NAME_KEY, name)


def is_key_of_name(key: Key) -> bool:
    """Return whether a key stands for an object's name, and not for a trial.

    >>> is_key_of_name(key_of_name("cup")), is_key_of_name(("toy", "ask", "cup", "heavy"))
    (True, False)
    """
    return key == key_of_name(str(key[-1]))
