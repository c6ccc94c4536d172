"""A learner in one file: a zip of JSON and arrays, which nothing in it can make execute.

`learner.json` holds settings; the experience is an array a table of it; a percept table is the .npz
of `save_percepts`. What was fitted is stored (`fitted_state.py`), but classifiers of one's own
could only be pickled: `load` fits them again, with equal results where they are deterministic.
"""

import json
import zipfile
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.named import AGENTS
from meal_bayes.cache import temporary_folder
from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.percepts import save_percepts
from meal_bayes.domain import domain_from_table, domain_table
from meal_bayes.errors import DataError, MealBayesError, SettingsError
from meal_bayes.files import draft_of
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fitted_state import pack, unpack
from meal_bayes.learner.learner import Learner
from meal_bayes.learner.rows import Rows
from meal_bayes.learner.settings import own_posterior
from meal_bayes.untrusted import UNREADABLE, read_array, read_member, read_meta, write_array

_FORMAT = 5
_TEXT = "learner.json"
_TABLE = "table.npz"
_ROWS = {
    "instances": "<i8", "levels": "|i1", "labels": "|i1", "executions": "<i8", "feedback": "<i8",
    "known": "|i1",
}  # fmt: skip
_SETTINGS = ("seed", "reward", "horizon", "trust", "asked")


def save_learner(learner: Learner, path: Path) -> None:
    """Write a learner; the file is there whole or not at all.

    Raises
    ------
    OutputError
        The file cannot be written; one that was there stays.
    """
    settings, own = learner.fits.settings, learner.experience
    classifier = settings.classifier
    meta: dict[str, Any] = {
        "format": _FORMAT,
        "domain": domain_table(learner.domain),
        "agent": learner.agent.name,
        "classifier": None if classifier is None else type(classifier).__name__,
        "learn_success": settings.learn_success,
        "percepts": settings.percepts,
        "growth": learner.fits.growth,
        "refit_every": learner.fits.refit_every,
        **{name: getattr(learner, name) for name in _SETTINGS},
    }
    with (
        draft_of(path) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        numbers = count()

        def keep(values: NDArray[Any]) -> str:
            name = f"fitted/{next(numbers)}"
            write_array(archive, name, values)
            return name

        meta["posterior"] = pack(settings.posterior, keep)
        for name in _ROWS:
            write_array(archive, name, getattr(own, name).values)
        for name in ("objects", "trials"):
            archive.writestr(name, "\n".join(map(json.dumps, getattr(own, name))))
        for i, context in enumerate(_contexts(own)):
            if context in own.features:
                write_array(archive, f"features/{i}", own.features[context].values)
        meta["state"] = None
        if learner.table is not None:
            archive.writestr(_TABLE, _table_bytes(learner))
        elif classifier is None:
            meta["state"] = pack(learner.fitted(learner.agent).state, keep)
        archive.writestr(_TEXT, json.dumps(meta, allow_nan=False))


def load_learner(
    path: Path, *, agent: object, classifier: object, logs: str | Path | None
) -> Learner:
    """Read a learner; raises as `Learner.load` does."""
    if not path.is_file():
        raise DataError(f"No file {path}; give the path of a learner that save() wrote.")
    try:
        with zipfile.ZipFile(path) as archive:
            read = partial(read_array, archive)
            meta = read_meta(read_member(archive, _TEXT), _FORMAT)
            learner = _learner(meta, agent, classifier, logs)
            own = unpack(meta["posterior"], read, learner.domain)
            posterior = own_posterior(own, learner.domain, learner.agent)
            learner.fits.settings = replace(learner.fits.settings, posterior=posterior)
            _read_experience(archive, learner.experience)
            if _TABLE in archive.namelist():
                return learner.fit(_read_table(archive, learner))
            if meta["state"] is None:
                return learner.refit()
            state = unpack(meta["state"], read, learner.domain)
            learner.fits.restore(learner.agent, state, [int(count) for count in meta["growth"]])
    except SettingsError:
        raise
    except (*UNREADABLE, MealBayesError) as fault:
        raise DataError(
            f"{path} is not a whole learner ({fault}); save it again, or fit a new one."
        ) from fault
    except OSError as fault:
        raise DataError(f"{path} cannot be read: {fault}.") from fault
    return learner


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
        refit_every=None if meta["refit_every"] is None else float(meta["refit_every"]),
        learn_success=meta["learn_success"] is True,
        horizon=float(meta["horizon"]),
        trust=float(meta["trust"]),
        logs=logs,
    )
    learner.asked = int(meta["asked"])
    return learner


def _read_experience(archive: zipfile.ZipFile, experience: Experience) -> None:
    """Fill an empty record from a file, once every number in it is known to fit."""
    domain = experience.domain
    rows = {name: read_array(archive, name, dtype, 2) for name, dtype in _ROWS.items()}
    objects = _read_lines(archive, "objects")
    trials = [tuple(key) for key in _read_lines(archive, "trials")]
    sizes = np.zeros(len(domain.behaviors), int)
    for i, context in enumerate(_contexts(experience)):
        if f"features/{i}.npy" in archive.namelist():
            values = read_array(archive, f"features/{i}", "<f4", 2)
            if not np.isfinite(values).all():
                raise ValueError(f"features of {context} are not finite")
            sizes[domain.behavior_index(context[0])] = len(values)
            experience.features[context] = kept = Rows(np.float32, values.shape[1])
            kept.extend(values)
    n, o, t = len(rows["instances"]), len(objects), len(trials)
    p, e = len(domain.attributes), len(domain.behaviors)
    behaviors = rows["instances"][:, 1]
    limits = {
        "instances": ((0, o), (0, e), (0, 2**62), (-1, sizes[behaviors % e]), (0, 64)),
        "executions": ((0, t), (0, e), (-1, n), (-1, 2)),
        "feedback": ((0, t), (0, o), (0, p), (-1, 2)),
    }
    for name, columns in limits.items():
        for values, (least, end) in zip(rows[name].T, columns, strict=True):
            if ((values < least) | (values >= end)).any():
                raise ValueError(f"{name} names what there is not")
    for name, size, most in (("levels", n, 64), ("labels", n, 2), ("known", o, 2)):
        values = rows[name]
        if values.shape != (size, p) or ((values < -1) | (values >= most)).any():
            raise ValueError(f"{name} has shape {values.shape}, or values that are none")
    if (
        len(set(objects)) < o
        or len(set(trials)) < t
        or not all(isinstance(x, str) for x in objects)
    ):
        raise ValueError("objects or trials are named twice, or not by text")
    experience.restore(objects, trials, rows)


def _contexts(experience: Experience) -> list[tuple[str, str]]:
    return [(b.name, m) for b in experience.domain.behaviors for m in b.modalities]


def _read_lines(archive: zipfile.ZipFile, name: str) -> list[Any]:
    """Read JSON values, a line each."""
    text = read_member(archive, name).decode().replace("\n", ",")
    values: list[Any] = json.loads(f"[{text}]")
    return values


def _table_bytes(learner: Learner) -> bytes:
    with temporary_folder() as folder:
        path = folder / _TABLE
        assert learner.table is not None
        save_percepts(learner.table, path)
        return path.read_bytes()


def _read_table(archive: zipfile.ZipFile, learner: Learner) -> Any:
    with temporary_folder() as folder:
        path = folder / _TABLE
        path.write_bytes(read_member(archive, _TABLE))
        return load_percepts(path, domain=learner.domain)
