"""Named random streams, which do not depend on the order and place of work."""

import hashlib

import numpy as np


def stream(root: int, *path: str | int) -> np.random.Generator:
    """Return the generator of a named stream, such as ``stream(7, "robot", "roc36", 12)``.

    >>> stream(7, "robot", 3).random() == stream(7, "robot", 3).random()
    True
    >>> stream(7, "robot", 3).random() == stream(7, "planner", 3).random()
    False
    """
    key = list[int]()
    for part in path:  # NumPy's integers are the same numbers as Python's
        name = f"{'text' if isinstance(part, str) else 'number'}:{part}"
        digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
        key += np.frombuffer(digest, "<u4").tolist()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(root, spawn_key=key)))
