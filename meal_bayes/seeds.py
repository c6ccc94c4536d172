"""Named random streams, which do not depend on the order and place of work."""

import hashlib
from functools import lru_cache

import numpy as np

Key = tuple[str | int, ...]  # names a trial, and its random streams


def stream(root: int, *path: str | int) -> np.random.Generator:
    """Return the generator of a named stream, such as ``stream(7, "robot", "roc36", 12)``.

    >>> stream(7, "robot", 3).random() == stream(7, "robot", 3).random()
    True
    >>> stream(7, "robot", 3).random() == stream(7, "planner", 3).random()
    False
    """
    key = [word for part in path for word in _words(part)]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(root, spawn_key=key)))


class Streams:
    """The named streams of a trial; each is made when it is first asked for."""

    def __init__(self, root: int, key: Key) -> None:
        self._root = root
        self._key = key
        self._made: dict[Key, np.random.Generator] = {}

    def of(self, *name: str) -> np.random.Generator:
        """Return the stream of a name; always the same one, which goes on where it was."""
        if name not in self._made:
            self._made[name] = stream(self._root, *name, *self._key)
        return self._made[name]


@lru_cache(maxsize=4096, typed=True)  # a text comes again and again, and True is not 1
def _words(part: str | int) -> tuple[int, int]:
    """Return two words of 32 bits of a name's part; NumPy's integers are as Python's."""
    name = f"{'text' if isinstance(part, str) else 'number'}:{part}"
    digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
    return int.from_bytes(digest[:4], "little"), int.from_bytes(digest[4:], "little")
