"""Named random streams, which do not depend on the order and place of work."""

import hashlib
from functools import lru_cache

import numpy as np

_POOL = 4  # words of a seed, at least


@lru_cache(maxsize=64)
def _seed_words(root: int) -> tuple[int, ...]:
    np.random.SeedSequence(root)  # refuses what is no seed
    size = 4 * max(_POOL, -(-int(root).bit_length() // 32))
    return tuple(np.frombuffer(int(root).to_bytes(size, "little"), "<u4").tolist())


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
    # The words that SeedSequence(root, spawn_key=...) would put together, in an eighth of the time.
    words = [*_seed_words(root), *(word for pair in named for word in _words(*pair))]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(np.array(words, np.uint32))))
