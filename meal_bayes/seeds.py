"""Named random streams: the path names the stream, so the order and place of work never matter."""

import hashlib

import numpy as np


def _words(part: object) -> tuple[int, ...]:
    kind = "text" if isinstance(part, str) else "number"  # NumPy's integers are the same numbers
    digest = hashlib.blake2b(f"{kind}:{part}".encode(), digest_size=8).digest()
    return tuple(int(word) for word in np.frombuffer(digest, dtype="<u4"))


def stream(root: int, *path: str | int) -> np.random.Generator:
    """Make the generator of a named stream, such as ``stream(7, "robot", "roc36", 12)``.

    >>> stream(7, "robot", 3).random() == stream(7, "robot", 3).random()
    True
    >>> stream(7, "robot", 3).random() == stream(7, "planner", 3).random()
    False
    """
    key = tuple(word for part in path for word in _words(part))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(root, spawn_key=key)))
