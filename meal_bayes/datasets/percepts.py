"""Percept tables: what held-out classifiers said of every recording, shipped with the package."""

import io
import json
import lzma
import struct
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.domain import (
    Domain,
    domain_from_table,
    domain_names,
    domain_table,
    load_domain,
    unknown,
)
from meal_bayes.errors import DataError, DomainError, SettingsError
from meal_bayes.untrusted import read_json

THRESHOLD = float(np.log(0.501 / 0.499))  # yes/no at .501: .5 +- 1e-16 would leak by rounding
LIMIT = 8.0  # log-odds are kept within +-8, where float16 is good to .004
BIN_EDGES = freeze(THRESHOLD + np.array([-3.0, -1.5, -0.5, 0.0, 0.5, 1.5, 3.0]))


def level_edges(edges: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """Edges between K levels, (K-1,), among the fine bins' edges; K = 2, 4, ... must divide L."""
    bins = len(edges) + 1
    if levels < 2 or levels % 2 or bins % levels:  # noqa: PLR2004
        fitting = [k for k in range(2, bins + 1, 2) if bins % k == 0]
        raise SettingsError(f"Percepts of {levels} levels; expected one of {fitting}.")
    step = bins // levels
    return edges[step - 1 :: step]


def levels_of(log_odds: ArrayLike, edges: NDArray[np.float64], levels: int) -> NDArray[np.int8]:
    """Cut log-odds into percept levels 0 .. K-1.

    >>> levels_of([-5.0, -1.0, 0.0, 1.0, 5.0], BIN_EDGES, 4).tolist()
    [0, 1, 1, 2, 3]
    """
    return np.searchsorted(level_edges(edges, levels), log_odds).astype(np.int8)


def round_log_odds(log_odds: ArrayLike) -> NDArray[np.float16]:
    """Clip to +-8 and round as tables keep them, so that a percept is the same before and after."""
    return np.clip(np.asarray(log_odds, dtype=np.float64), -LIMIT, LIMIT).astype(np.float16)


@dataclass(frozen=True, slots=True)
class PerceptTable:
    """Held-out percepts of a data set, and the training-side counts for each held-out object.

    Log-odds are class-balanced (prior 1/2): positive speaks for "true". They are cut into L fine
    bins by `edges`; a percept of K levels merges neighboring bins, the middle edge divides yes/no.
    Where nothing was computed (reinit, ask, an attribute left out) they are NaN and bins zero.

    Raises
    ------
    DataError : shapes that do not agree, edges that do not rise.
    """

    domain: Domain
    objects: tuple[str, ...]  # (O,)
    labels: NDArray[np.int8]  # (O,P) 1 true, 0 false, -1 unknown
    log_odds: NDArray[np.float16]  # (O,R,E,P) of o's recordings, by classifiers that never saw o
    edges: NDArray[np.float64]  # (L-1,) the middle one is the yes/no threshold
    training_bins: NDArray[np.uint8]  # (O,O,P,E,L) [o, o']: how often o' fell in each bin, by
    # classifiers that saw neither o nor o'; the diagonal is zero
    provenance: Mapping[str, str]  # versions, settings, checksums and the command that made it

    def __post_init__(self) -> None:
        set_frozen(
            self,
            labels=freeze(self.labels, np.int8),
            log_odds=freeze(self.log_odds, np.float16),
            edges=freeze(self.edges),
            training_bins=freeze(self.training_bins, np.uint8),
        )
        o, e, p = len(self.objects), len(self.domain.behaviors), len(self.domain.attributes)
        expected = {
            "labels": (o, p),
            "log_odds": (o, self.log_odds.shape[1] if self.log_odds.ndim > 1 else 0, e, p),
            "training_bins": (o, o, p, e, len(self.edges) + 1),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if found != shape:
                raise DataError(f"Percept table: {name} has shape {found}; expected {shape}.")
        if self.training_bins[np.arange(o), np.arange(o)].any():
            raise DataError(
                "Percept table: an object's own recordings stand among what is learned without it; "
                "its training bins must be zero (build the table again)."
            )
        if len(self.edges) % 2 == 0 or not (np.diff(self.edges) > 0).all():
            raise DataError("Percept table: expected an odd number of edges, each above the last.")

    @property
    def recordings(self) -> int:
        """R, recordings per object and behavior."""
        return int(self.log_odds.shape[1])

    def level_edges(self, levels: int) -> NDArray[np.float64]:
        """Edges between the levels of a K-level percept, (K-1,)."""
        return level_edges(self.edges, levels)

    def levels_of(self, log_odds: ArrayLike, levels: int) -> NDArray[np.int8]:
        """Percept levels 0 .. K-1 of log-odds of any shape."""
        return levels_of(log_odds, self.edges, levels)

    def training_levels(self, held_out: int, levels: int) -> NDArray[np.int64]:
        """How often each other object showed each level, (O,P,E,K), without the held-out one."""
        level_edges(self.edges, levels)
        bins = self.training_bins[held_out]
        merged = bins.reshape(*bins.shape[:-1], levels, -1).sum(axis=-1)
        return freeze(merged, np.int64)


_FORMAT = 1
_MEMBERS = {  # name -> dtype, axes
    "meta": ("|u1", 1),  # JSON
    "labels": ("|i1", 2),  # (O,P)
    "log_odds": ("<f2", 4),  # (O,R,E',P), E' the behaviors with modalities
    "edges": ("<f8", 1),  # (L-1,)
    "training_bins": ("|u1", 5),  # (O,P,E',O,L) [o', ..., held-out o]: neighbors are alike
}
_TEXTS = {"domain": str, "objects": list, "attributes": list, "behaviors": list, "provenance": dict}
_LARGEST = 2 << 24  # bytes that the training bins may unpack to
_REST = 1 << 24  # and each other member
_FILE = 2**27  # bytes of a file
_HEADER = 2**16 + 10  # bytes of the longest header of an array
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the same table gives the same bytes
_UNREADABLE = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, KeyError, ValueError, EOFError, OSError,
    NotImplementedError, RuntimeError, struct.error, SyntaxError, TypeError,
)  # fmt: skip


def save_percepts(table: PerceptTable, path: str | Path) -> None:
    """Write a percept table: an .npz that `numpy.load` opens too, packed with LZMA.

    A domain of one's own is written along; of a shipped one the name is enough.
    """
    sensing = [i for i, behavior in enumerate(table.domain.behaviors) if behavior.modalities]
    meta = {
        "format": _FORMAT,
        "domain": table.domain.name,
        "objects": table.objects,
        "attributes": table.domain.attributes,
        "behaviors": [table.domain.behavior_names[i] for i in sensing],
        "provenance": dict(table.provenance),
    }
    if not _ships(table.domain):
        meta["domain_table"] = domain_table(table.domain)
    arrays = {
        "meta": np.frombuffer(json.dumps(meta).encode(), np.uint8),
        "labels": table.labels,
        "log_odds": table.log_odds[:, :, sensing],
        "edges": table.edges,
        "training_bins": table.training_bins[:, :, :, sensing].transpose(1, 2, 3, 0, 4),
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        for name, (dtype, _) in _MEMBERS.items():
            buffer = io.BytesIO()
            values = np.ascontiguousarray(arrays[name], dtype=dtype)
            np.lib.format.write_array(buffer, values, version=(1, 0), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", _EPOCH)
            archive.writestr(info, buffer.getvalue(), zipfile.ZIP_LZMA)


def load_percepts(name: str | Path, *, domain: Domain | None = None) -> PerceptTable:
    """Load the shipped table of a domain, or a table of one's own from the path of an .npz.

    Parameters
    ----------
    name : a shipped domain (variants share their data set's table), or a path ending in .npz.
    domain : whose behaviors and attributes the table is laid out for; the one the name or the file
        holds by default.

    Raises
    ------
    SettingsError : no shipped table and no file of that name.
    DataError : a file that is not a percept table, or not one of this domain.
    """
    if str(name).endswith(".npz"):
        path = Path(name)
        if not path.is_file():
            raise SettingsError(f"No file {path}; give the path of a percept table (.npz).")
        with path.open("rb") as file:
            meta, arrays = _read(file, str(path))
        domain = _domain_of(meta, str(path)) if domain is None else domain
        return _lay_out(meta, arrays, domain, str(path))
    domain = load_domain(name) if domain is None else domain
    resource = resources.files("meal_bayes.datasets") / "tables" / f"{domain.data}.npz"
    if not resource.is_file():
        raise SettingsError(
            f"No percept table ships for {str(name)!r}; expected a domain of roc36, ispy32 or "
            "cy101, or the path of an .npz made by save_percepts, or by `meal-bayes data percepts "
            "--dataset DOMAIN.toml --root FOLDER --out FILE.npz`."
        )
    with resource.open("rb") as file:
        meta, arrays = _read(file, str(name))
    return _lay_out(meta, arrays, domain, str(name))


def _ships(domain: Domain) -> bool:
    return domain.name in domain_names() and load_domain(domain.name) == domain


def _domain_of(meta: dict[str, Any], where: str) -> Domain:
    """Build the domain that a file holds, or find the shipped one that it names."""
    if "domain_table" not in meta:
        if meta["domain"] not in domain_names():
            raise SettingsError(
                f"{where} is laid out for the domain {meta['domain']!r}, which does not ship; "
                "pass domain=load_domain(<your table>.toml)."
            )
        return load_domain(meta["domain"])
    try:
        return domain_from_table(meta["domain_table"])
    except DomainError as error:
        raise DataError(f"{where} holds a domain that is not well formed: {error}") from error


def _read(file: Any, where: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read and check all members; whatever is wrong with the bytes becomes a `DataError`."""
    size = file.seek(0, io.SEEK_END)
    if size > _FILE:
        raise DataError(f"{where} has {size:,} bytes; a percept table has at most {_FILE:,}.")
    try:
        with zipfile.ZipFile(file) as archive:
            arrays = {name: _member(archive, name, *kind) for name, kind in _MEMBERS.items()}
        meta = read_json(arrays.pop("meta").tobytes())
    except _UNREADABLE as error:
        raise DataError(
            f"{where} is not a whole percept table ({error}); make it again with "
            "`meal-bayes data percepts --dataset D`."
        ) from error
    if not isinstance(meta, dict) or meta.get("format") != _FORMAT:
        found = meta.get("format") if isinstance(meta, dict) else type(meta).__name__
        raise DataError(f"{where} has format {found}; this version reads format {_FORMAT}.")
    for key, kind in _TEXTS.items():
        texts = meta.get(key)
        inside = texts.values() if isinstance(texts, dict) else texts
        if not isinstance(texts, kind) or not all(isinstance(text, str) for text in inside or ()):
            raise DataError(f"{where} does not tell its {key}; make the table again.")
    if len(set(meta["objects"])) < len(meta["objects"]):
        raise DataError(f"{where} names an object twice; make the table again.")
    log_odds, bins = arrays["log_odds"], arrays["training_bins"]
    sound = (
        np.isfinite(arrays["edges"]).all()
        and not (np.abs(log_odds) > LIMIT).any()
        and np.isin(arrays["labels"], (-1, 0, 1)).all()
    )
    if not sound or (bins.sum(axis=-1, dtype=np.uint32) > log_odds.shape[1]).any():
        raise DataError(
            f"{where}: expected log-odds within +-{LIMIT:g}, labels of 1, 0 and -1, and no more "
            "counts than recordings; make the table again."
        )
    return meta, arrays


def _member(archive: zipfile.ZipFile, name: str, dtype: str, axes: int) -> NDArray[Any]:
    info = archive.getinfo(f"{name}.npy")
    limit = _LARGEST if name == "training_bins" else min(_LARGEST, _REST)
    if info.file_size > limit:
        raise ValueError(f"{name} claims {info.file_size} bytes, more than {limit}")
    data = archive.read(info)
    buffer: BinaryIO = io.BytesIO(data[:_HEADER])
    if np.lib.format.read_magic(buffer) != (1, 0):
        raise ValueError(f"{name} is of another array format than 1.0")
    shape, fortran, found = np.lib.format.read_array_header_1_0(buffer)
    if found != np.dtype(dtype) or len(shape) != axes or fortran or min(shape) < 0:
        raise ValueError(f"{name} is {found} {shape}, expected {dtype} with {axes} axes")
    return np.frombuffer(data, dtype, offset=buffer.tell()).reshape(shape)


def _lay_out(
    meta: dict[str, Any], arrays: dict[str, NDArray[Any]], domain: Domain, where: str
) -> PerceptTable:
    """Put the file's attributes and behaviors in the order of the domain, by their names."""
    senses = [i for i, behavior in enumerate(domain.behaviors) if behavior.modalities]
    wanted = {
        "attributes": domain.attributes,
        "behaviors": tuple(domain.behavior_names[i] for i in senses),
    }
    for key, names in wanted.items():
        for name in names:
            if name not in meta[key]:
                raise DataError(f"{where}: {unknown(key[:-1], name, meta[key])}")
    columns = [meta["attributes"].index(name) for name in wanted["attributes"]]
    rows = [meta["behaviors"].index(name) for name in wanted["behaviors"]]
    labels, log_odds, bins = (arrays[key] for key in ("labels", "log_odds", "training_bins"))
    objects, p, e = len(meta["objects"]), len(meta["attributes"]), len(meta["behaviors"])
    expected = ((objects, p), (objects, log_odds.shape[1], e, p))
    if (labels.shape, log_odds.shape) != expected or bins.shape[:4] != (objects, p, e, objects):
        raise DataError(f"{where}: names and arrays differ in number; make the table again.")
    n_behaviors = len(domain.behaviors)
    if bins.size // max(p * e, 1) * len(columns) * n_behaviors > 2 * _LARGEST:
        raise DataError(f"{where}: {n_behaviors} behaviors make a table that fits in no memory.")
    all_odds = np.full((*log_odds.shape[:2], n_behaviors, len(columns)), np.nan, np.float16)
    all_odds[:, :, senses] = log_odds[:, :, rows][..., columns]
    all_bins = np.zeros((objects, objects, len(columns), n_behaviors, bins.shape[4]), np.uint8)
    all_bins[:, :, :, senses] = bins[:, columns][:, :, rows].transpose(3, 0, 1, 2, 4)
    return PerceptTable(
        domain,
        tuple(meta["objects"]),
        labels[:, columns],
        all_odds,
        arrays["edges"],
        all_bins,
        meta["provenance"],
    )
