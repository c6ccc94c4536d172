"""Which percept table a run works on: the embedded one, or the paper's method, computed once."""

import logging
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from meal_bayes.datasets import (
    Dataset,
    PerceptTable,
    cache_folder,
    load_dataset,
    load_percepts,
    save_percepts,
)
from meal_bayes.datasets.percepts import domain_of
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.domain import load_domain, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.store import digest_of, fingerprint
from meal_bayes.files import file_name
from meal_bayes.perception import build_percept_table
from meal_bayes.perception.settings import NAMED
from meal_bayes.version import package_version

log = logging.getLogger("meal_bayes.experiments")


def percepts_for(
    dataset: str,
    perception: str = "default",
    *,
    root: str | Path | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> PerceptTable:
    """Load the percept table of a data set; compute it once where none is at hand.

    The data set is a shipped domain, the path of a domain of one's own (TOML) with the folder of
    its recordings as root, or of a table (.npz). The method is "default", or "paper" for that of
    Sect. 4.2. While a table is computed, `on_progress` is called with behaviors done and in all.
    """
    if perception not in NAMED:
        raise SettingsError(unknown("perception", perception, NAMED))
    domain = domain_of(dataset)
    path = table_path(dataset, perception, root=root)
    if path is None:
        return load_percepts(dataset)
    if not path.is_file():
        recordings = load_dataset(dataset if dataset.endswith(".toml") else domain.data, root=root)
        (on_note or log.info)(
            f"computing the {perception} percepts of {domain.name} from its recordings, once; "
            f"kept in {path}"
        )
        table = build_percept_table(recordings, perception=perception, progress=on_progress)
        save_percepts(table, path)
    return load_percepts(path, domain=domain)


def kept_table(data: Dataset | PerceptTable) -> str:
    """Keep a table, or that of recordings, in the cache under its content; return its path."""
    table = data if isinstance(data, PerceptTable) else build_percept_table(data)
    folder = cache_folder() / "percepts"
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder) as draft:
        made = Path(draft) / "table.npz"
        save_percepts(table, made)
        path = folder / f"{file_name(table.domain.data)}-given-{fingerprint(str(made))[:12]}.npz"
        return str(made.replace(path))


def table_path(
    dataset: str, perception: str = "default", *, root: str | Path | None = None
) -> Path | None:
    """Return where the computed table of a data set is kept; None where one ships or is given.

    It is named by the recordings and the domain, by the package and its perception's code.
    """
    if dataset.endswith(".npz"):
        if root is not None:
            raise SettingsError(f"{dataset} is a percept table already; leave root out.")
        if perception != "default":  # the method comes first
            method = load_percepts(dataset).provenance.get("perception", "").split(" ")[0]
            if f"={perception}," not in method:
                raise SettingsError(
                    f"{dataset} is a percept table of another method; leave perception out, or "
                    "make another with `meal-bayes data percepts --dataset DOMAIN.toml --root "
                    f"FOLDER --perception {perception}`."
                )
        return None
    domain = load_domain(dataset)
    if root is not None and not dataset.endswith(".toml"):
        raise SettingsError(
            f"The percepts of {dataset!r} need no folder of recordings; leave root out, or give "
            "the path of a domain of your own (TOML)."
        )
    public = domain.data in SOURCES and root is None
    if public and perception == "default":
        return None
    if not public and root is None:
        raise SettingsError(
            f"{dataset} has no public recordings; give the path of its TOML and, as root, the "
            "folder of its CSV files, or a percept table (.npz)."
        )
    code = digest_of(Path(__file__).resolve().parents[1] / "perception")[:8]
    name = f"{file_name(domain.data)}-{perception}-{package_version()}-{code}"
    content = fingerprint(dataset, None if root is None else str(root))[:12]
    return cache_folder() / "percepts" / f"{'-'.join(filter(None, (name, content)))}.npz"
