"""A learner in one file: a zip of JSON and arrays, which nothing in it can make execute.

`learner.json` holds names, settings and labeled trials; recordings are one array of float32 a
context, features of labeled trials another; a percept table is the .npz of `save_percepts`. What
was fitted is stored (`fitted_state.py`), but classifiers of one's own could only be pickled: `load`
fits them again, with equal results where they are deterministic, and repeats the updates.
"""

import io
import json
import logging
import lzma
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.named import AGENTS
from meal_bayes.cache import temporary_folder
from meal_bayes.datasets import Dataset, load_percepts
from meal_bayes.datasets.percept_file import read_array, save_percepts
from meal_bayes.domain import Domain, domain_from_table, domain_table
from meal_bayes.errors import DataError, MealBayesError, SettingsError
from meal_bayes.files import draft_of
from meal_bayes.learner.fitted_state import pack, unpack
from meal_bayes.learner.labeled_trial import LabeledTrial, Percept, checked_values
from meal_bayes.learner.learner import Learner
from meal_bayes.learner.replayed import Replayed
from meal_bayes.learner.sources import own_posterior
from meal_bayes.untrusted import read_json

log = logging.getLogger("meal_bayes.learner")

_FORMAT = 3
_LARGEST = 2**30  # bytes that a member may unpack to
_TEXT = "learner.json"
_TABLE = "table.npz"
_UNREADABLE = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, KeyError, ValueError, TypeError,
    IndexError, AttributeError, EOFError, OverflowError, RecursionError, NotImplementedError,
    RuntimeError, SyntaxError, MealBayesError,
)  # fmt: skip


def save_learner(learner: Learner, path: Path) -> None:
    """Write a learner; the file is there whole or not at all.

    Raises
    ------
    OutputError : the file cannot be written; one that was there stays.
    """
    source = learner.source
    meta: dict[str, Any] = {
        "format": _FORMAT,
        "domain": domain_table(learner.domain),
        "agent": learner.agent.name,
        "classifier": None if learner.classifier is None else type(learner.classifier).__name__,
        "seed": learner.seed,
        "reward": learner.reward,
        "percepts": learner.percepts,
        "refit_every": learner.refit_every,
        "asked": learner.asked,
        "labeled_trials": [],
    }
    with draft_of(path) as draft, zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        rows, arrays = _Rows(learner.domain), _Kept(archive)
        for labeled in learner.labeled_trials:
            table = _labeled_table(labeled, rows, arrays)
            meta["labeled_trials"].append({**table, "refitted": learner.refitted(labeled)})
        meta["posterior"] = pack(learner.posterior, arrays.keep)
        if isinstance(source, Replayed):
            archive.writestr(_TABLE, _table_bytes(source))
        else:
            meta["objects"] = list(source.dataset.objects)
            _write(archive, "labels", source.dataset.labels)
            for i, context in enumerate(rows.contexts):
                _write(archive, f"features/{i}", source.dataset.features[context])
                _write(archive, f"met/{i}", rows.array(context, source.sizes[context]))
            meta["state"] = None
            if learner.classifier is None:
                meta["state"] = pack(source.state, arrays.keep)
        archive.writestr(_TEXT, _checked(json.dumps(meta, allow_nan=False)))


def _checked(text: str) -> str:
    try:
        read_json(text)  # a reader must take it
    except ValueError as fault:
        raise SettingsError(
            f"This learner has too many labeled trials for one file ({fault})."
        ) from fault
    return text


def load_learner(
    path: Path, *, agent: object, classifier: object, logs: str | Path | None
) -> Learner:
    """Read a learner; raises as `Learner.load` does."""
    if not path.is_file():
        raise DataError(f"No file {path}; give the path of a learner that save() wrote.")
    try:
        with zipfile.ZipFile(path) as archive:
            meta = read_json(_unpacked(archive, _TEXT))
            if not isinstance(meta, dict) or meta.get("format") != _FORMAT:
                found = meta.get("format") if isinstance(meta, dict) else type(meta).__name__
                raise DataError(f"it has format {found}; this version reads format {_FORMAT}")
            learner = _learner(meta, agent, classifier, logs)
            kept = _Kept(archive)
            own = unpack(meta["posterior"], kept.read, learner.domain)
            learner.posterior = own_posterior(own, learner.domain, learner.agent)
            state = None
            if _TABLE in archive.namelist():
                data: Any = _read_table(archive, learner.domain)
                arrays = None
            else:
                arrays = _Arrays(archive, learner.domain)
                data = Dataset(
                    learner.domain,
                    tuple(map(str, meta["objects"])),
                    arrays.features("features"),
                    arrays.read("labels", "|i1", 2),
                )
                state = unpack(meta["state"], kept.read, learner.domain)
            labeled_trials = [
                _labeled(table, learner, arrays, kept) for table in meta["labeled_trials"]
            ]
            refitted = [table["refitted"] is True for table in meta["labeled_trials"]]
            if state is not None:
                return learner.resume(data, labeled_trials, refitted, state)
    except SettingsError:
        raise
    except _UNREADABLE as fault:
        raise DataError(
            f"{path} is not a whole learner ({fault}); save it again, or fit a new one."
        ) from fault
    except OSError as fault:
        raise DataError(f"{path} cannot be read: {fault}.") from fault
    log.info("%s is fitted again", path)
    return learner.resume(data, labeled_trials, refitted)


def _learner(
    meta: dict[str, Any], agent: object, classifier: object, logs: str | Path | None
) -> Learner:
    name = meta["agent"]
    if (classifier is None) != (meta["classifier"] is None):
        raise SettingsError(
            f"The learner perceives by {meta['classifier'] or 'our own classifiers'}; give the "
            "same as load(path, classifier=...)."
        )
    if agent is None and name not in AGENTS:
        raise SettingsError(
            f"The learner's agent {str(name)!r} is not one of the shipped ones; give it as "
            "load(path, agent=...)."
        )
    learner = Learner(
        domain_from_table(meta["domain"]),
        agent=name if agent is None else agent,
        classifier=classifier,
        seed=int(meta["seed"]),
        reward=None if meta["reward"] is None else float(meta["reward"]),
        percepts=str(meta["percepts"]),
        refit_every=None if meta["refit_every"] is None else int(meta["refit_every"]),
        logs=logs,
    )
    learner.asked = int(meta["asked"])
    return learner


class _Kept:
    """Arrays of what was fitted, by number."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive, self._count = archive, 0

    def keep(self, values: NDArray[Any]) -> str:
        self._count += 1
        _write(self._archive, f"fitted/{self._count}", values)
        return str(self._count)

    def read(self, name: str, dtype: str, axes: int) -> NDArray[Any]:
        return _array(self._archive, f"fitted/{name}", dtype, axes)


class _Rows:
    """Features of labeled trials, a row each."""

    def __init__(self, domain: Domain) -> None:
        self.contexts = [(b.name, m) for b in domain.behaviors for m in b.modalities]
        self._rows: dict[tuple[str, str], list[NDArray[np.float32]]] = {}

    def add(self, percept: Percept) -> int:
        """Append the features of a percept; return their row, -1 where there are none."""
        if percept.features is None:
            return -1
        for modality, values in percept.features.items():
            rows = self._rows.setdefault((percept.behavior, modality), [])
            rows.append(values)
        return len(rows) - 1

    def array(self, context: tuple[str, str], size: int) -> NDArray[np.float32]:
        rows = self._rows.get(context, [])
        return np.array(rows, np.float32).reshape(len(rows), size)


class _Arrays:
    """Arrays of an archive, each checked before it is believed."""

    def __init__(self, archive: zipfile.ZipFile, domain: Domain) -> None:
        self._archive = archive
        self._contexts = _Rows(domain).contexts
        self.met: dict[tuple[str, str], NDArray[Any]] = {
            context: self.read(f"met/{i}", "<f4", 2) for i, context in enumerate(self._contexts)
        }

    def features(self, part: str) -> dict[tuple[str, str], NDArray[Any]]:
        return {c: self.read(f"{part}/{i}", "<f4", 3) for i, c in enumerate(self._contexts)}

    def read(self, name: str, dtype: str, axes: int) -> NDArray[Any]:
        return _array(self._archive, name, dtype, axes)


def _array(archive: zipfile.ZipFile, name: str, dtype: str, axes: int) -> NDArray[Any]:
    return read_array(_unpacked(archive, f"{name}.npy"), name, dtype, axes)


def _unpacked(archive: zipfile.ZipFile, name: str) -> bytes:
    info = archive.getinfo(name)
    if info.file_size > _LARGEST:
        raise ValueError(f"{name} claims {info.file_size} bytes, more than {_LARGEST}")
    return archive.read(info)


def _write(archive: zipfile.ZipFile, name: str, values: NDArray[Any]) -> None:
    buffer = io.BytesIO()
    np.lib.format.write_array(
        buffer, np.ascontiguousarray(values), version=(1, 0), allow_pickle=False
    )
    archive.writestr(f"{name}.npy", buffer.getvalue())


def _labeled_table(labeled: LabeledTrial, rows: _Rows, arrays: _Kept) -> dict[str, Any]:
    levels = [percept.levels for percept in labeled.percepts]
    return {
        "key": list(labeled.key),
        "object": labeled.object_name,
        "values": dict(labeled.values),
        "levels": arrays.keep(np.array(levels)) if levels else None,
        "percepts": [{"behavior": p.behavior, "row": rows.add(p)} for p in labeled.percepts],
    }


def _labeled(
    table: dict[str, Any], learner: Learner, arrays: _Arrays | None, kept: _Kept
) -> LabeledTrial:
    percepts, domain, most = list[Percept](), learner.domain, learner.agent.levels
    every = () if table["levels"] is None else kept.read(table["levels"], "|i1", 2)
    for entry, levels in zip(table["percepts"], every, strict=True):
        behavior = domain.behaviors[domain.behavior_index(entry["behavior"])]
        if (
            levels.shape != (len(domain.attributes),)
            or not -1 <= levels.min() <= levels.max() < most
        ):
            raise ValueError(f"a percept of {behavior.name} has levels {levels.tolist()}")
        features = None
        if arrays is not None and int(entry["row"]) >= 0:
            features = {
                m: arrays.met[behavior.name, m][int(entry["row"])] for m in behavior.modalities
            }
            if not all(np.isfinite(values).all() for values in features.values()):
                raise ValueError(f"features of a percept of {behavior.name} are not finite")
        percepts.append(Percept(behavior.name, levels, features))
    key = tuple(part if isinstance(part, str) else int(part) for part in table["key"])
    values = checked_values(table["values"], domain)
    return LabeledTrial(key, str(table["object"]), values, tuple(percepts))


def _table_bytes(source: Replayed) -> bytes:
    with temporary_folder() as folder:
        path = folder / _TABLE
        save_percepts(source.table, path)
        return path.read_bytes()


def _read_table(archive: zipfile.ZipFile, domain: Domain) -> Any:
    with temporary_folder() as folder:
        path = folder / _TABLE
        path.write_bytes(_unpacked(archive, _TABLE))
        return load_percepts(path, domain=domain)
