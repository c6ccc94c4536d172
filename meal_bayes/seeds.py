"""Named random streams: the path names the stream, so the order and place of work never matter."""

import hashlib
from functools import lru_cache

import numpy as np


@lru_cache(maxsize=4096)
def _words(kind: str, part: str) -> tuple[int, ...]:
    digest = hashlib.blake2b(f"{kind}:{part}".encode(), digest_size=8).digest()
    return tuple(int(word) for word in np.frombuffer(digest, dtype="<u4"))


def stream(root: int, *path: str | int) -> np.random.Generator:
    """Make the generator of a named stream, such as ``stream(7, "robot", "roc36", 12)``.

    >>> stream(7, "robot", 3).random() == stream(7, "robot", 3).random()
    True
    >>> stream(7, "robot", 3).random() == stream(7, "planner", 3).random()
    False
    """
    # NumPy's integers are the same numbers as Python's.
    named = [("text" if isinstance(part, str) else "number", str(part)) for part in path]
    key = tuple(word for kind, part in named for word in _words(kind, part))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(root, spawn_key=key)))
