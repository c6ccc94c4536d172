"""A learner in one file: a zip of JSON and arrays, which nothing in it can make execute.

`learner.json` holds settings; the experience is an array a table of it. What agents made of it, or
the percept table that is replayed, is a tree of dataclasses and named tuples over arrays: each is
written as its name and its fields, and only the classes that are listed here are read back.
Classifiers of one's own could only be pickled: they are fitted again to what they were fitted to,
with equal results where they are deterministic.

A file has an id, and that of the file which its learner read or wrote before: whoever saves does
not write over what somebody else has saved there.
"""

import json
import secrets
import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent, as_agent
from meal_bayes.agents.named import AGENTS
from meal_bayes.arrays import Rows
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import domain_from_table, domain_table
from meal_bayes.errors import DataError, MealBayesError, OutputError, SettingsError
from meal_bayes.files import alone_in, draft_of
from meal_bayes.learner.columns import NONE, WITHDRAWN
from meal_bayes.learner.digest import agent_digest
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fit import training_agent
from meal_bayes.learner.online import Online
from meal_bayes.learner.packing import pack, unpack
from meal_bayes.learner.refit import classify
from meal_bayes.learner.settings import LearnerSettings, check_data, own_posterior
from meal_bayes.learner.trial import Asked
from meal_bayes.untrusted import UNREADABLE, read_array, read_member, read_meta, write_array

_FORMAT = 15
_TEXT = "learner.json"
_ROWS = ("instances", "levels", "detected", "labels", "executions", "feedback", "object_labels")
_FITTED = tuple(
    field.name
    for field in fields(Online)
    if field.name not in ("record", "agent", "settings", "policies", "plan_libraries")
)


Json = Any


@dataclass(frozen=True, slots=True)
class SavedLearner:
    """All that a learner is: record, settings, and what agents in use made of the record."""

    agent: Agent
    settings: LearnerSettings
    experience: Experience
    table: PerceptTable | None
    fitted: list[Online]
    asked: Asked
    file: str  # id of the file


def write_learner(learner: SavedLearner, path: Path, *, overwrite: bool) -> str:
    """Write a learner; the file is there whole or not at all. Return its new id.

    `learner.file` is the id of the file that it read or wrote last: only that is written over.
    """
    settings = learner.settings
    experience = learner.experience
    file = secrets.token_hex(8)
    with (
        alone_in(path.parent),
        draft_of(path, expected=True) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        if not overwrite:
            _refuse_what_others_saved(path, learner.file)
        numbers = count()

        def keep(values: NDArray[Any]) -> str:
            name = f"fitted/{next(numbers)}"
            write_array(archive, name, values)
            return name

        classifier = settings.classifier
        written = {field.name: getattr(settings, field.name) for field in fields(settings)}
        fitted = [
            {
                "agent": fit.agent.name,
                "digest": agent_digest(fit.agent),
                "state": pack(_state(fit, with_perception=classifier is None), keep),
            }
            for fit in learner.fitted
        ]
        meta: dict[str, Any] = {
            "format": _FORMAT,
            "file": file,
            "parent": learner.file,
            "domain": domain_table(experience.domain),
            "agent": learner.agent.name,
            "digest": agent_digest(learner.agent),
            "classifier": None if classifier is None else type(classifier).__name__,
            "settings": pack({**written, "classifier": None}, keep),
            "asked": asdict(learner.asked),
            "fitted": fitted,
            "table": pack(learner.table, keep),
            "features": _write_features(experience, keep),
        }
        for name in _ROWS:
            write_array(archive, name, getattr(experience, name).values)
        for name in ("objects", "trials", "feedback_logs"):
            archive.writestr(name, "\n".join(map(json.dumps, getattr(experience, name))))
        archive.writestr(_TEXT, json.dumps(meta, allow_nan=False))
    return file


def read_learner(path: Path, *, agent: object, classifier: object) -> SavedLearner:
    """Read a learner; raise as `Learner.load` does."""
    if not path.is_file():
        raise DataError(f"No file {path}; give the path of a learner that save() wrote.")
    try:
        with zipfile.ZipFile(path) as archive:
            read = partial(read_array, archive)
            meta = read_meta(read_member(archive, _TEXT), _FORMAT)
            domain = domain_from_table(meta["domain"])
            settings = unpack(meta["settings"], read, domain)
            table = unpack(meta["table"], read, domain)
            chosen = _agent(meta, agent, classifier)
            own_posterior(settings["posterior"], domain, chosen)
            settings = LearnerSettings(**{**settings, "classifier": classifier})
            experience = Experience(domain)
            _read_experience(archive, experience)
            _read_features(meta["features"], read, experience)
            if table is not None:
                check_data(table, domain)
            fitted = []
            for entry in meta["fitted"]:
                fit_agent = _known(entry, chosen)
                if fit_agent is not None:  # else it is made anew when it is asked
                    state = unpack(entry["state"], read, domain)
                    fitted.append(_fitted(experience, fit_agent, settings, state))
            return SavedLearner(
                agent=chosen,
                settings=settings,
                experience=experience,
                table=table,
                fitted=fitted,
                asked=Asked(**meta["asked"]),
                file=str(meta["file"]),
            )
    except SettingsError:
        raise
    except (*UNREADABLE, MealBayesError) as fault:
        raise DataError(
            f"{path} is not a whole learner ({fault}); save it again, or fit a new one."
        ) from fault
    except OSError as fault:
        raise DataError(f"{path} cannot be read: {fault}.") from fault


def _refuse_what_others_saved(path: Path, file: str) -> None:
    """Refuse to write over a file that this learner neither wrote nor read last."""
    if not path.exists():
        return
    content = "no learner"
    try:
        with zipfile.ZipFile(path) as archive:
            content = f"the learner {read_meta(read_member(archive, _TEXT), _FORMAT)['file']}"
    except (*UNREADABLE, OSError):
        pass
    if content != f"the learner {file}":
        history = f"read or wrote {file} last" if file else "has read and written no file"
        raise OutputError(
            f"{path} holds {content}, and this one {history}: somebody else has saved there. "
            "Load it and tell it what is missing, give another name, or save(path, overwrite=True)."
        )


def _agent(meta: dict[str, Any], agent: object, classifier: object) -> Agent:
    """Return who decides; raise where what the file does not hold was not given again."""
    if (classifier is None) != (meta["classifier"] is None):
        raise SettingsError(
            f"The learner perceives by {meta['classifier'] or 'our own classifiers'}; give the "
            "same as load(path, classifier=...)."
        )
    if agent is not None:
        return as_agent(agent)
    name = str(meta["agent"])
    if name not in AGENTS:
        raise SettingsError(
            f"The learner's agent {name!r} is not one of the shipped ones; give it as "
            "load(path, agent=...)."
        )
    if meta["digest"] != agent_digest(AGENTS[name]):
        raise SettingsError(
            f"The learner's agent {name!r} is not the shipped one of that name; give it as "
            "load(path, agent=...)."
        )
    return AGENTS[name]


def _known(entry: dict[str, Any], chosen: Agent) -> Agent | None:
    """Return the agent whose state an entry is, if it is known; it may be nobody's any more."""
    for agent in (chosen, training_agent(chosen), AGENTS.get(str(entry["agent"]))):
        if agent is not None and agent_digest(agent) == entry["digest"]:
            return agent
    return None


def _state(fit: Online, *, with_perception: bool) -> dict[str, Any]:
    """Return the fields of what an agent made of the record."""
    state = {name: getattr(fit, name) for name in _FITTED}
    return state if with_perception else {**state, "perception": None}


def _fitted(
    experience: Experience, agent: Agent, settings: LearnerSettings, state: dict[str, Any]
) -> Online:
    """Return what an agent made of the record; raise where it is another's."""
    domain = experience.domain
    p, e = len(domain.attributes), len(domain.behaviors)
    shape = p, e, 2, agent.levels
    if any(
        state[name].posterior.counts.shape != shape for name in ("knowledge", "knowledge_at_refit")
    ):
        raise ValueError("what was counted does not fit attributes, behaviors and levels")
    n = len(experience.instances)
    for name in ("levels", "counted_labels"):
        values = state[name]
        state[name] = Rows(np.int8, p)
        state[name].extend(values)
    arrays = (
        ("labels_at_refit", (-1, 2)),
        ("levels", (-1, agent.levels)),
        ("counted_labels", (-1, 2)),
    )
    for name, (least, end) in arrays:
        values = state[name].values if isinstance(state[name], Rows) else state[name]
        if (
            values.shape[1:] != (p,)
            or len(values) > n
            or ((values < least) | (values >= end)).any()
        ):
            raise ValueError(f"{name} does not fit the instances")
    if state["trained_cells"].shape[1:] != (e, p) or len(state["trained_cells"]) > len(
        experience.objects
    ):
        raise ValueError("trained_cells does not fit the objects")
    percepts = np.stack([state["percepts"], state["percepts_at_refit"]])
    if percepts.shape != (2, p, e, 2, 2) or not (percepts >= 0).all():
        raise ValueError("percepts of labeled objects do not fit attributes and behaviors")
    if state["experience_at_refit"].shape != (2, p, e) or state["sizes"].shape != (
        len(domain.contexts),
    ):
        raise ValueError("what was experienced does not fit attributes and behaviors")
    if settings.classifier is not None:
        used = state["labels_at_refit"]
        sizes = state["sizes"]
        state["perception"] = classify(experience, agent, settings, used, sizes)[2]
    return Online(experience, agent, settings, **state)


def _write_features(experience: Experience, keep: Callable[[NDArray[Any]], str]) -> Json:
    """Write features, an array of each context and size; return where they are."""
    parts = []
    for number, context in enumerate(experience.domain.contexts):
        by_size: dict[int, list[int]] = {}
        for i, values in experience.features[context].items():
            by_size.setdefault(len(values), []).append(i)
        for rows in by_size.values():
            values = np.stack([experience.features[context][i] for i in rows])
            parts.append([number, keep(np.array(rows, np.int64)), keep(values)])
    return parts


def _read_features(
    parts: Json, read: Callable[[str, str, int], NDArray[Any]], experience: Experience
) -> None:
    """Read features into the record, in the order of instances."""
    contexts = experience.domain.contexts
    held: list[dict[int, NDArray[np.float32]]] = [{} for _ in contexts]
    behaviors = experience.instances.values["behavior"]
    for number, rows_name, values_name in parts:
        values = read(str(values_name), "<f4", 2)
        rows = read(str(rows_name), "<i8", 1)
        if not np.isfinite(values).all() or values.shape[0] != len(rows) or not values.shape[1]:
            raise ValueError(f"features of {contexts[number]} are not finite, or not of instances")
        if ((rows < 0) | (rows >= len(behaviors))).any() or (
            behaviors[rows] != experience.domain.behavior_index(contexts[number][0])
        ).any():
            raise ValueError(f"features of {contexts[number]} are of what there is not")
        held[number].update(zip(rows.tolist(), values, strict=True))
    for context, by_instance in zip(contexts, held, strict=True):
        experience.features[context] = dict(sorted(by_instance.items()))


def _read_experience(archive: zipfile.ZipFile, experience: Experience) -> None:
    """Fill an empty record from a file, once every number in it is known to fit."""
    domain = experience.domain
    held = {name: getattr(experience, name) for name in _ROWS}
    rows = {
        name: read_array(archive, name, held[name].values.dtype, held[name].values.ndim)
        for name in _ROWS
    }
    objects, trials, feedback_logs = (
        _read_lines(archive, name) for name in ("objects", "trials", "feedback_logs")
    )
    trials = [tuple(key) for key in trials]
    n, o, t = len(rows["instances"]), len(objects), len(trials)
    p, e = len(domain.attributes), len(domain.behaviors)
    large = 2**62
    limits: dict[str, dict[str, tuple[int, int]]] = {  # of each column: the least, and the end
        "instances": {
            "object": (0, o), "behavior": (0, e), "digest": (0, 2**63 - 1), "copy": (0, large),
            "recording": (NONE, large), "origin": (0, WITHDRAWN + 1), "scale": (0, 64),
        },
        "executions": {
            "trial": (0, t), "behavior": (0, e), "instance": (NONE, n),
            "success": (-1, WITHDRAWN + 1),
        },
        "feedback": {
            "trial": (0, t), "call": (0, large), "object": (0, o), "attribute": (0, p),
            "value": (-1, 2), "given": (0, 2),
        },
    }  # fmt: skip
    columns = [
        (name, rows[name][column], limit)
        for name, of_table in limits.items()
        for column, limit in of_table.items()
    ]
    columns += [(name, rows[name], (-1, 64)) for name in ("levels", "detected")]
    columns += [(name, rows[name], (-1, 2)) for name in ("labels", "object_labels")]
    for name, values, (least, end) in columns:
        if ((values < least) | (values >= end)).any():
            raise ValueError(f"{name} names what there is not")
    lengths = [len(rows[name]) for name in ("levels", "detected", "labels", "object_labels")]
    if lengths != [n, n, n, o]:
        raise ValueError("percepts or labels do not fit instances and objects")
    unique = len(set(objects)) == o and len(set(trials)) == t
    if not unique or not all(isinstance(name, str) for name in [*objects, *feedback_logs]):
        raise ValueError("objects or trials are named twice, or not by text")
    experience.feedback_logs = dict.fromkeys(feedback_logs)
    experience.objects = {name: number for number, name in enumerate(objects)}
    experience.trials = {key: number for number, key in enumerate(trials)}
    for name, values in rows.items():
        held[name].extend(values)


def _read_lines(archive: zipfile.ZipFile, name: str) -> list[Any]:
    """Read JSON values, a line each."""
    return [json.loads(line) for line in read_member(archive, name).splitlines()]
