"""Percept tables as files: shipped with the package by name, or your own .npz."""

import io
import json
import lzma
import struct
import zipfile
import zlib
from importlib import resources
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.percepts import LIMIT, PerceptTable
from meal_bayes.domain import (
    Domain,
    domain_from_table,
    domain_names,
    domain_table,
    load_domain,
    unknown,
)
from meal_bayes.errors import DataError, DomainError, SettingsError
from meal_bayes.files import draft_of
from meal_bayes.untrusted import read_json

_FORMAT = 1
_MEMBERS = {  # name -> dtype, axes
    "meta": ("|u1", 1),  # JSON
    "labels": ("|i1", 2),  # (O,P)
    "log_odds": ("<f2", 4),  # (O,R,E',P), E' the behaviors with modalities
    "edges": ("<f8", 1),  # (L-1,)
    "training_bins": ("|u1", 5),  # (O,P,E',G,L) [o', ..., held-out g]: neighbors are alike
}
_OPTIONAL = {  # members more
    "recording_counts": ("<u2", 2),  # (O,E'), where recordings are ragged
    "groups": ("<u2", 1),  # (O,), where objects are left out by folds
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

    The file holds the domain too, unless it is a shipped one.

    Raises
    ------
    OutputError
        The file cannot be written; one that was there stays.
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
    members = {name: dtype for name, (dtype, _) in _MEMBERS.items()}
    if table.ragged:
        arrays["recording_counts"] = table.recording_counts[:, sensing]
    if (table.groups != np.arange(len(table.objects))).any():
        arrays["groups"] = table.groups
    members |= {name: dtype for name, (dtype, _) in _OPTIONAL.items() if name in arrays}
    with draft_of(path) as draft, zipfile.ZipFile(draft, "w", zipfile.ZIP_LZMA) as archive:
        for name, dtype in members.items():
            buffer = io.BytesIO()
            values = np.ascontiguousarray(arrays[name], dtype=dtype)
            np.lib.format.write_array(buffer, values, version=(1, 0), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", _EPOCH)
            archive.writestr(info, buffer.getvalue(), zipfile.ZIP_LZMA)


def load_percepts(name: str | Path, *, domain: Domain | None = None) -> PerceptTable:
    """Load the shipped table of a domain, or your own table from the path of an .npz.

    Parameters
    ----------
    name : str | Path
        A shipped domain (variants share their data set's table), or a path ending in .npz.
    domain : Domain | None
        Whose behaviors and attributes the table gets, in their order; by default that of the name
        or the file.

    Raises
    ------
    SettingsError
        No shipped table and no file of that name.
    DataError
        A file that is not a percept table, or not one of this domain.
    """
    if str(name).endswith(".npz"):
        path = Path(name)
        if not path.is_file():
            raise SettingsError(f"No file {path}; give the path of a percept table (.npz).")
        with path.open("rb") as file:
            meta, arrays = _read(file, str(path))
        domain = _domain_of(meta, str(path)) if domain is None else domain
        return _in_domain_order(meta, arrays, domain, str(path))
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
    return _in_domain_order(meta, arrays, domain, str(name))


def domain_of(name: str | Path) -> Domain:
    """Return the domain of a shipped name, of a TOML, or of a percept table (.npz)."""
    return load_percepts(name).domain if str(name).endswith(".npz") else load_domain(name)


def _ships(domain: Domain) -> bool:
    return domain.name in domain_names() and load_domain(domain.name) == domain


def _domain_of(meta: dict[str, Any], where: str) -> Domain:
    """Return the domain that a file holds, or the shipped one that it names."""
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
    """Read and check all members; `DataError` where the bytes are wrong."""
    size = file.seek(0, io.SEEK_END)
    if size > _FILE:
        raise DataError(f"{where} has {size:,} bytes; a percept table has at most {_FILE:,}.")
    try:
        with zipfile.ZipFile(file) as archive:
            arrays = {name: _member(archive, name, *spec) for name, spec in _MEMBERS.items()}
            there = [name for name in _OPTIONAL if f"{name}.npy" in archive.namelist()]
            arrays |= {name: _member(archive, name, *_OPTIONAL[name]) for name in there}
        meta = read_json(arrays.pop("meta").tobytes())
    except _UNREADABLE as error:
        raise DataError(
            f"{where} is not a whole percept table ({error}); make it again with "
            "`meal-bayes data percepts --dataset D`."
        ) from error
    if not isinstance(meta, dict) or meta.get("format") != _FORMAT:
        found = meta.get("format") if isinstance(meta, dict) else type(meta).__name__
        raise DataError(f"{where} has format {found}; this version reads format {_FORMAT}.")
    for key, wanted in _TEXTS.items():
        texts = meta.get(key)
        inside = texts.values() if isinstance(texts, dict) else texts
        if not isinstance(texts, wanted) or not all(isinstance(text, str) for text in inside or ()):
            raise DataError(f"{where} does not hold its {key}; make the table again.")
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
    return read_array(archive.read(info), name, dtype, axes)


def read_array(content: bytes, name: str, dtype: str, axes: int) -> NDArray[Any]:
    """Read an array in NumPy's format, of this dtype and number of axes.

    Raises
    ------
    ValueError
        Bytes of another format, dtype or number of axes.
    """
    buffer: BinaryIO = io.BytesIO(content[:_HEADER])
    if np.lib.format.read_magic(buffer) != (1, 0):
        raise ValueError(f"{name} is of another array format than 1.0")
    shape, fortran, found = np.lib.format.read_array_header_1_0(buffer)
    if found != np.dtype(dtype) or len(shape) != axes or fortran or min(shape) < 0:
        raise ValueError(f"{name} is {found} {shape}, expected {dtype} with {axes} axes")
    return np.frombuffer(content, dtype, offset=buffer.tell()).reshape(shape)


def _in_domain_order(
    meta: dict[str, Any], arrays: dict[str, NDArray[Any]], domain: Domain, where: str
) -> PerceptTable:
    """Return the table with attributes and behaviors in the order of the domain."""
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
    counts = arrays.get("recording_counts", np.full((objects, e), log_odds.shape[1], np.uint16))
    groups = arrays.get("groups", np.arange(objects)).astype(np.int64)
    found = (labels.shape, log_odds.shape, counts.shape, groups.shape)
    n_groups = int(groups.max(initial=-1)) + 1
    if (
        found != (*expected, (objects, e), (objects,))
        or bins.shape[:4] != (objects, p, e, n_groups)
        or n_groups > objects
    ):
        raise DataError(f"{where}: names and arrays differ in number; make the table again.")
    n_behaviors = len(domain.behaviors)
    if bins.size // max(p * e, 1) * len(columns) * n_behaviors > 2 * _LARGEST:
        raise DataError(f"{where}: {n_behaviors} behaviors make a table that fits in no memory.")
    all_odds = np.full((*log_odds.shape[:2], n_behaviors, len(columns)), np.nan, np.float16)
    all_odds[:, :, senses] = log_odds[:, :, rows][..., columns]
    all_bins = np.zeros((n_groups, objects, len(columns), n_behaviors, bins.shape[4]), np.uint8)
    all_bins[:, :, :, senses] = bins[:, columns][:, :, rows].transpose(3, 0, 1, 2, 4)
    all_counts = np.zeros((objects, n_behaviors), np.int64)
    all_counts[:, senses] = counts[:, rows]
    return PerceptTable(
        domain,
        tuple(meta["objects"]),
        labels[:, columns],
        all_odds,
        arrays["edges"],
        all_bins,
        meta["provenance"],
        all_counts,
        groups,
    )
