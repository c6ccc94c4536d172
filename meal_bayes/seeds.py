"""Named random streams, which do not depend on the order and place of work."""

import hashlib
from functools import lru_cache

import numpy as np


@lru_cache(maxsize=4096)
def _words(type_name: str, part: str) -> tuple[int, ...]:
    digest = hashlib.blake2b(f"{type_name}:{part}".encode(), digest_size=8).digest()
    return tuple(int(word) for word in np.frombuffer(digest, dtype="<u4"))


def stream(root: int, *path: str | int) -> np.random.Generator:
    """Return the generator of a named stream, such as ``stream(7, "robot", "roc36", 12)``.

    >>> stream(7, "robot", 3).random() == stream(7, "robot", 3).random()
    True
    >>> stream(7, "robot", 3).random() == stream(7, "planner", 3).random()
    False
    """
    # NumPy's integers are the same numbers as Python's.
    named = [("text" if isinstance(part, str) else "number", str(part)) for part in path]
    key = tuple(word for pair in named for word in _words(*pair))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(root, spawn_key=key)))
