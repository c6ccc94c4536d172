"""Pickled agents, with the folders that their modules are imported from."""

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass

from meal_bayes.agents import Agent, Origin, origin_of

_digests: dict[str, str] = {}  # module of an agent's -> digest of the source it was imported from


@dataclass(frozen=True, slots=True)
class _Way:
    """Makes an agent's modules importable where it is unpickled, before the agent itself is."""

    origin: Origin

    def __reduce__(self) -> tuple[Callable[[Origin], "_Way"], tuple[Origin]]:
        return _open, (self.origin,)


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """An agent that unpickles in a process that has not imported its modules."""

    way: _Way  # the first field: pickles keep the order
    agent: Agent

    @classmethod
    def of(cls, agent: Agent) -> "Carried":
        """Find the modules that the agent needs."""
        return cls(_Way(origin_of(agent)), agent)

    @property
    def digest(self) -> str:
        """Digest of the agent's own source; empty for the shipped agents."""
        return self.way.origin.digest


def _open(origin: Origin) -> _Way:
    for folder in origin.folders:
        if folder not in sys.path:
            sys.path.append(folder)
    for top in origin.modules:
        if _digests.setdefault(top, origin.digest) != origin.digest:  # an older text is loaded
            for name in [n for n in sys.modules if n == top or n.startswith(f"{top}.")]:
                del sys.modules[name]
            importlib.invalidate_caches()
            _digests[top] = origin.digest
    return _Way(origin)
