"""Columns of the record of a robot: of what kinds its rows are, and what stands in each."""

import re

import numpy as np
from numpy.typing import NDArray

from meal_bayes.seeds import Key

Labels = NDArray[np.int8]
Objects = tuple[int, ...]  # by their rows in a percept table
Context = tuple[str, str]  # (behavior, modality)

GIVEN = 0  # an instance's origin: recordings that were given
GATHERED = 1  # or a trial of the robot
WITHDRAWN = 2  # or nothing any more: it was forgotten; so is what an execution's success was
NONE = -1  # in place of a row's number

INSTANCE = np.dtype([
    ("object", np.int64),
    ("behavior", np.int64),
    ("digest", np.int64),  # of its features; 0: there are none
    ("copy", np.int64),  # how many with this digest came before it
    ("recording", np.int64),  # its number in the data set that is replayed; NONE
    ("origin", np.int64),
    ("scale", np.int64),  # K, of its percepts in the trial; 0 where it was given
])  # fmt: skip
EXECUTION = np.dtype([
    ("trial", np.int64),
    ("behavior", np.int64),
    ("instance", np.int64),  # NONE: nothing was perceived
    ("success", np.int64),  # 1, 0, -1 where failing and succeeding look the same; WITHDRAWN
])  # fmt: skip
FEEDBACK = np.dtype([
    ("trial", np.int64),
    ("call", np.int64),  # labels that were told together
    ("object", np.int64),
    ("attribute", np.int64),
    ("value", np.int64),  # 1, 0, or -1 where those of the trial before it were withdrawn
    ("given", np.int64),  # 1: by a data set, 0: by a person
])  # fmt: skip


def unnamed(identity: str) -> str:
    """Return what an object is called that nobody has named, by 16 hexadecimal digits, drawn."""
    return f"object {identity}"


def nobody_named(name: str) -> bool:
    """Return whether an object's name was drawn.

    >>> nobody_named(unnamed("30a0d9a3fcdbb969")), nobody_named("object 3")
    (True, False)
    """
    return re.fullmatch("object [0-9a-f]{16}", name) is not None


def told(name: str) -> Key:
    """Return what stands for a trial where labels are told of an object by its name."""
    return ("told", name)
