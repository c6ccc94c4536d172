"""Which percept table a run works on: the embedded one, or the paper's recipe, computed once."""

import hashlib
import logging
import os
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

from meal_bayes.datasets import PerceptTable, cache_folder, load_dataset, load_percepts
from meal_bayes.datasets.percept_file import save_percepts
from meal_bayes.datasets.sources import source
from meal_bayes.domain import Domain, load_domain, unknown
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.perception import build_percept_table

log = logging.getLogger("meal_bayes.experiments")

_PERCEPTIONS = ("default", "paper")


def percepts_for(
    dataset: str,
    perception: str = "default",
    *,
    on_progress: Callable[[int, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> PerceptTable:
    """Load the percept table of a data set; with ``"paper"`` compute it once into the cache.

    Parameters
    ----------
    dataset : a shipped domain, or the path of a table of one's own (.npz).
    perception : "default", or "paper" for the recipe of Sect. 4.2 on the recordings.
    on_progress : called with (behaviors done, behaviors in all) while a table is computed.
    on_note : called with a line of text before a table is computed; logged otherwise.

    Raises
    ------
    SettingsError : an unknown data set or perception, or the paper's for a table of one's own.
    DownloadError : recordings that cannot be had.
    """
    if perception not in _PERCEPTIONS:
        raise SettingsError(unknown("perception", perception, _PERCEPTIONS))
    if perception == "default":
        return load_percepts(dataset)
    if str(dataset).endswith(".npz"):
        raise SettingsError(
            f"{dataset} is a percept table already; leave perception out, or make another with "
            "`meal-bayes data percepts --dataset DOMAIN.toml --root FOLDER --perception paper`."
        )
    domain = load_domain(dataset)
    source(domain.data)
    path = cached_table(domain.data, perception)
    if not _readable(path, domain):
        recordings = load_dataset(domain.data)
        (on_note or log.info)(
            f"computing the {perception} percepts of {domain.data} from its recordings, once; "
            f"kept in {path}"
        )
        table = build_percept_table(recordings, perception=perception, progress=on_progress)
        _keep(table, path)
    return load_percepts(path, domain=domain)


def cached_table(data: str, perception: str) -> Path:
    """Where a computed table is kept: named by data set, package version and perception's code."""
    return cache_folder() / "percepts" / f"{data}-{perception}-{_version()}-{_code_digest()}.npz"


def _readable(path: Path, domain: Domain) -> bool:
    if not path.is_file():
        return False
    try:
        load_percepts(path, domain=domain)
    except DataError as fault:
        log.warning("%s; it is computed again", fault)
        return False
    return True


def _keep(table: PerceptTable, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f"{path.stem}.{os.getpid()}.part")
    save_percepts(table, draft)
    draft.replace(path)  # a table is there whole or not at all


def _code_digest() -> str:
    """Digest of the room that computes tables, so that another recipe never reads an old one."""
    room = Path(__file__).resolve().parents[1] / "perception"
    digest = hashlib.sha256()
    for path in sorted(room.glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:8]


def _version() -> str:
    try:
        return metadata.version("meal-bayes")
    except metadata.PackageNotFoundError:  # run from a checkout
        return "unreleased"
