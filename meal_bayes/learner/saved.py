"""A learner in one file: a zip of JSON and arrays, which nothing in it can make execute.

`learner.json` holds settings; the experience is an array a table of it. What was fitted, or the
percept table that is replayed, is a tree of dataclasses and named tuples over arrays: each is
written as its name and its fields, and only the classes that are listed here are read back.
Classifiers of one's own could only be pickled: `load` fits them again, with equal results where
they are deterministic.
"""

import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent, Knowledge, as_agent
from meal_bayes.agents.named import AGENTS
from meal_bayes.arrays import Rows
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Domain, domain_from_table, domain_table
from meal_bayes.errors import DataError, MealBayesError, SettingsError
from meal_bayes.files import draft_of
from meal_bayes.learner.experience import GATHERED, GIVEN, NONE, Experience
from meal_bayes.learner.online import Online
from meal_bayes.learner.settings import LearnerSettings, check_data, own_posterior
from meal_bayes.perception import Perception
from meal_bayes.perception.perceiver import BehaviorClassifier
from meal_bayes.perception.recordings import FeatureSpace, Whitening
from meal_bayes.perception.stacked import KernelFit, Stacker
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.trait import SharedTrait
from meal_bayes.untrusted import UNREADABLE, read_array, read_member, read_meta, write_array

_FORMAT = 11
_TEXT = "learner.json"
_ROWS = ("instances", "levels", "labels", "executions", "feedback", "known")
_FITTED = ("perception", "knowledge", "refitted", "percepts", "seen", "levels", "counted")
_KINDS: tuple[type[Any], ...] = (
    Perception, BehaviorClassifier, KernelFit, FeatureSpace, Whitening, Stacker, Knowledge,
    ConfusionPosterior, SharedTrait, PerceptTable,
)  # fmt: skip
_CLASSES = {kind.__name__: kind for kind in _KINDS}

Json = Any


@dataclass(frozen=True, slots=True)
class SavedLearner:
    """All that a learner is."""

    agent: object  # its name where it is read back
    settings: LearnerSettings
    experience: Experience
    table: PerceptTable | None
    fitted: Online | None  # what its agent made of the record
    asked: int
    growth: list[int]


def write_learner(learner: SavedLearner, path: Path) -> None:
    """Write a learner; the file is there whole or not at all, and one that was there stays."""
    settings = learner.settings
    experience = learner.experience
    with (
        draft_of(path) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        numbers = count()

        def keep(values: NDArray[Any]) -> str:
            name = f"fitted/{next(numbers)}"
            write_array(archive, name, values)
            return name

        fitted = None
        if learner.fitted is not None:
            fitted = {name: getattr(learner.fitted, name) for name in _FITTED}
        classifier = settings.classifier
        written = {field.name: getattr(settings, field.name) for field in fields(settings)}
        meta: dict[str, Any] = {
            "format": _FORMAT,
            "domain": domain_table(experience.domain),
            "agent": learner.agent,
            "classifier": None if classifier is None else type(classifier).__name__,
            "settings": pack({**written, "classifier": None}, keep),
            "growth": learner.growth,
            "asked": learner.asked,
            "state": pack(fitted, keep),
            "table": pack(learner.table, keep),
        }
        for name in _ROWS:
            write_array(archive, name, getattr(experience, name).values)
        for name in ("objects", "trials"):
            archive.writestr(name, "\n".join(map(json.dumps, getattr(experience, name))))
        for i, context in enumerate(experience.domain.contexts):
            if context in experience.features:
                write_array(archive, f"features/{i}", experience.features[context].values)
        archive.writestr(_TEXT, json.dumps(meta, allow_nan=False))


def read_learner(path: Path, *, agent: object, classifier: object) -> SavedLearner:
    """Read a learner; raise as `Learner.load` does."""
    if not path.is_file():
        raise DataError(f"No file {path}; give the path of a learner that save() wrote.")
    try:
        with zipfile.ZipFile(path) as archive:
            read = partial(read_array, archive)
            meta = read_meta(read_member(archive, _TEXT), _FORMAT)
            domain = domain_from_table(meta["domain"])
            settings, state, table = (
                unpack(meta[name], read, domain) for name in ("settings", "state", "table")
            )
            chosen = as_agent(_agent(meta, agent, classifier))
            own_posterior(settings["posterior"], domain, chosen)
            settings = LearnerSettings(**{**settings, "classifier": classifier})
            experience = Experience(domain)
            _read_experience(archive, experience)
            if table is not None:
                check_data(table, domain)
            fitted = None
            if state is not None and table is None:
                fitted = _fitted(experience, chosen, settings, state)
            before, grown = map(int, meta["growth"])
            return SavedLearner(
                chosen, settings, experience, table, fitted,
                asked=int(meta["asked"]), growth=[before, grown],
            )  # fmt: skip
    except SettingsError:
        raise
    except (*UNREADABLE, MealBayesError) as fault:
        raise DataError(
            f"{path} is not a whole learner ({fault}); save it again, or fit a new one."
        ) from fault
    except OSError as fault:
        raise DataError(f"{path} cannot be read: {fault}.") from fault


def _agent(meta: dict[str, Any], agent: object, classifier: object) -> object:
    """Return who decides; raise where what the file does not hold was not given again."""
    if (classifier is None) != (meta["classifier"] is None):
        raise SettingsError(
            f"The learner perceives by {meta['classifier'] or 'our own classifiers'}; give the "
            "same as load(path, classifier=...)."
        )
    name = meta["agent"]
    if agent is None and name not in AGENTS:
        raise SettingsError(
            f"The learner's agent {str(name)!r} is not one of the shipped ones; give it as "
            "load(path, agent=...)."
        )
    return name if agent is None else agent


def _fitted(
    experience: Experience, agent: Agent, settings: LearnerSettings, state: dict[str, Any]
) -> Online:
    """Return what the agent made of the record; raise where it is another's."""
    domain = experience.domain
    shape = len(domain.attributes), len(domain.behaviors), 2, agent.levels
    if any(state[name].posterior.counts.shape != shape for name in ("knowledge", "refitted")):
        raise ValueError("what was counted does not fit attributes, behaviors and levels")
    if state["percepts"].shape != (*shape[:3], 2) or not (state["percepts"] >= 0).all():
        raise ValueError("percepts of labeled objects do not fit attributes and behaviors")
    for name in ("levels", "counted"):
        state[name], values = Rows(np.int8, len(domain.attributes)), state[name]
        state[name].extend(values)
    return Online(experience, agent, settings, **state)


def _read_experience(archive: zipfile.ZipFile, experience: Experience) -> None:
    """Fill an empty record from a file, once every number in it is known to fit."""
    domain = experience.domain
    held = {name: getattr(experience, name) for name in _ROWS}
    rows = {
        name: read_array(archive, name, held[name].values.dtype, held[name].values.ndim)
        for name in _ROWS
    }
    objects, trials = (_read_lines(archive, name) for name in ("objects", "trials"))
    trials = [tuple(key) for key in trials]
    sizes = np.zeros(len(domain.behaviors), int)
    for i, context in enumerate(domain.contexts):
        if f"features/{i}.npy" in archive.namelist():
            values = read_array(archive, f"features/{i}", "<f4", 2)
            if not np.isfinite(values).all():
                raise ValueError(f"features of {context} are not finite")
            sizes[domain.behavior_index(context[0])] = len(values)
            experience.features[context] = Rows(np.float32, values.shape[1])
            experience.features[context].extend(values)
    n, o, t = len(rows["instances"]), len(objects), len(trials)
    p, e = len(domain.attributes), len(domain.behaviors)
    features = sizes[rows["instances"]["behavior"] % e]  # of each instance's behavior
    limits: dict[str, dict[str, tuple[Any, Any]]] = {  # of each column: the least, and the end
        "instances": {
            "object": (0, o), "behavior": (0, e), "recording": (0, 2**62),
            "features": (NONE, features), "origin": (GIVEN, GATHERED + 1), "scale": (0, 64),
        },
        "executions": {
            "trial": (0, t), "behavior": (0, e), "instance": (NONE, n), "success": (-1, 2)
        },
        "feedback": {"trial": (0, t), "object": (0, o), "attribute": (0, p), "value": (-1, 2)},
    }  # fmt: skip
    columns = [
        (name, rows[name][column], limit)
        for name, of_table in limits.items()
        for column, limit in of_table.items()
    ]
    columns += [("levels", rows["levels"], (-1, 64))]
    columns += [(name, rows[name], (-1, 2)) for name in ("labels", "known")]
    for name, values, (least, end) in columns:
        if ((values < least) | (values >= end)).any():
            raise ValueError(f"{name} names what there is not")
    if [len(rows[name]) for name in ("levels", "labels", "known")] != [n, n, o]:
        raise ValueError("percepts or labels do not fit instances and objects")
    unique = len(set(objects)) == o and len(set(trials)) == t
    if not unique or not all(isinstance(name, str) for name in objects):
        raise ValueError("objects or trials are named twice, or not by text")
    experience.objects = {name: o for o, name in enumerate(objects)}
    experience.trials = {key: t for t, key in enumerate(trials)}
    for name, values in rows.items():
        held[name].extend(values)


def _read_lines(archive: zipfile.ZipFile, name: str) -> list[Any]:
    """Read JSON values, a line each."""
    return [json.loads(line) for line in read_member(archive, name).splitlines()]


def pack(value: Any, keep: Callable[[NDArray[Any]], str]) -> Json:
    """Return an object as JSON values; `keep` stores an array and returns its name.

    A domain is not written, as a learner has one.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, Rows):
        value = value.values
    if isinstance(value, np.ndarray):
        return {"array": keep(value), "dtype": value.dtype.str, "axes": value.ndim}
    if isinstance(value, Domain):
        return {"domain": True}
    if isinstance(value, Mapping):
        return {"table": {str(name): pack(entry, keep) for name, entry in value.items()}}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return [pack(entry, keep) for entry in value]
    name = type(value).__name__
    if _CLASSES.get(name) is not type(value):
        raise TypeError(f"{name} cannot be saved")
    names = getattr(value, "_fields", None)  # of a named tuple
    names = names or [field.name for field in fields(value)]
    return {"class": name, "fields": {n: pack(getattr(value, n), keep) for n in names}}


def unpack(packed: Json, read: Callable[[str, str, int], NDArray[Any]], domain: Domain) -> Any:
    """Return the object that `pack` wrote; `read` reads an array by name, dtype and axes."""
    if isinstance(packed, list):
        return tuple(unpack(entry, read, domain) for entry in packed)
    if not isinstance(packed, dict):
        return packed
    if "domain" in packed:
        return domain
    if "array" in packed:
        return read(str(packed["array"]), packed["dtype"], int(packed["axes"]))
    entries = packed["table"] if "table" in packed else packed["fields"]
    made = {str(name): unpack(entry, read, domain) for name, entry in entries.items()}
    return made if "table" in packed else _CLASSES[packed["class"]](**made)
