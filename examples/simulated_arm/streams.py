"""Random generators with names: the same draws for a name, in whatever order they are made."""

import hashlib

import numpy as np


def stream(seed: int, *name: str | int) -> np.random.Generator:
    """Return the generator of a seed and a name."""
    words = list[int]()
    for part in name:
        text = f"{'text' if isinstance(part, str) else 'number'}:{part}"
        digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
        words += [int.from_bytes(digest[:4], "little"), int.from_bytes(digest[4:], "little")]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=words)))
