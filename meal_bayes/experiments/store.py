"""Where runs lie: logs/<experiment>/<agent>/<unit>.mcap; a unit is done when its file is whole."""

import hashlib
import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

UNIT = 100  # trials of one agent in a file


@dataclass(frozen=True, slots=True)
class Store:
    """The folder of one experiment, named by its settings and the code that ran it.

    The name changes with either, so a run that is called again finds its own units, whole, and
    nobody else's.
    """

    folder: Path

    @classmethod
    def of(cls, root: str | Path, name: str, config: Mapping[str, object]) -> "Store":
        """Name the folder of a configuration under `root`; `name` may be any text."""
        name = file_name(name)
        text = json.dumps({**config, "code": code_digest()}, sort_keys=True)
        return cls(Path(root) / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:8]}")

    def unit(self, agent: str, index: int) -> Path:
        """File of one unit."""
        return self.folder / file_name(agent) / f"unit-{index:04d}.mcap"

    def clear(self) -> None:
        """Remove what an earlier run of the same settings left."""
        shutil.rmtree(self.folder, ignore_errors=True)


def file_name(text: str) -> str:
    """Make a name of a file of any text."""
    return re.sub(r"[^\w.-]+", "_", text)


def fingerprint(dataset: str, root: str | None = None) -> str:
    """Digest of a table or domain of one's own and its recordings: others are another run."""
    path = Path(dataset)
    if path.suffix not in (".npz", ".toml") or not path.is_file():
        return ""
    files = [path, *(sorted(Path(root).glob("*.csv")) if root is not None else [])]
    digest = hashlib.sha256()
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Digest of the package's own code and tables."""
    package = Path(__file__).resolve().parents[1]
    files = (p for p in sorted(package.rglob("*")) if p.suffix in (".py", ".toml", ".npz", ".xz"))
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
