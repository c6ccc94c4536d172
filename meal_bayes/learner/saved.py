"""A learner in one file: a zip archive of JSON and arrays, from which no code can be executed.

`learner.json` contains the settings. Each table of the experience is an array. The fits of agents
and the percept table are trees of dataclasses and named tuples with arrays. Each object is written
as its name and its fields, and only the classes that are listed here are read. A user's own
classifiers could only be pickled; instead, they are fitted again to the same data, with equal
results if they are deterministic.

A file has an id, and contains the id of the file that its learner read or wrote before. So `save`
can detect that another learner has saved the file since.
"""

import contextlib
import dataclasses
import functools
import hashlib
import inspect
import json
import secrets
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import count
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent, Knowledge, as_agent
from meal_bayes.agents.base_rates import BaseRates
from meal_bayes.agents.named import AGENTS
from meal_bayes.arrays import Rows
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Domain, Payoffs, domain_from_table, domain_table
from meal_bayes.errors import DataError, MealBayesError, OutputError, SettingsError
from meal_bayes.files import LEARNER, alone_in, draft_of
from meal_bayes.learner.experience import NONE, WITHDRAWN, Context, Experience
from meal_bayes.learner.fit import training_agent
from meal_bayes.learner.online import Online, chances, classify
from meal_bayes.learner.question import LOST, QuestionCounts
from meal_bayes.learner.settings import LearnerSettings, check_data, own_posterior
from meal_bayes.perception import Perception
from meal_bayes.perception.feature_spaces import FeatureSpace, Whitening
from meal_bayes.perception.kernel_ridge import KernelFit, Stacker
from meal_bayes.perception.perceiver import BehaviorClassifier
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.trait import SharedTrait
from meal_bayes.robots.robot import state_index
from meal_bayes.trial_log.feedback import Change, Feedback
from meal_bayes.untrusted import (
    UNREADABLE,
    check_unpacked,
    read_array,
    read_member,
    read_meta,
    write_array,
)

_DEEPEST = 12  # largest depth of nested fields


def agent_digest(agent: Agent) -> str:
    """Compute a digest of all fields of an agent, including its planner and its functions."""
    return hashlib.sha256("\0".join(_parts(agent, _DEEPEST)).encode()).hexdigest()[:16]


def _parts(value: Any, depth: int) -> Iterator[str]:
    """Yield texts that identify a value in all processes."""
    kind = f"{type(value).__module__}.{type(value).__qualname__}"
    if depth == 0:
        return
    if value is None or isinstance(value, str | bytes | bool | int | float | complex):
        yield repr(value)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    elif isinstance(value, tuple | list):
        yield f"{kind}{len(value)}"
        for entry in value:
            yield from _parts(entry, depth - 1)
    elif isinstance(value, dict | set | frozenset):
        entries = value.items() if isinstance(value, dict) else value
        yield kind
        yield from sorted("\0".join(_parts(entry, depth - 1)) for entry in entries)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield kind
        for field in dataclasses.fields(value):
            yield field.name
            yield from _parts(getattr(value, field.name), depth - 1)
    elif isinstance(value, functools.partial):
        yield from _parts((value.func, value.args, value.keywords), depth - 1)
    elif inspect.ismethod(value):
        yield from _parts((value.__func__, value.__self__), depth - 1)
    elif inspect.isfunction(value):
        cells = tuple(cell.cell_contents for cell in value.__closure__ or ())
        yield f"{value.__module__}.{value.__qualname__}"
        yield from _code(value.__code__)
        yield from _parts((value.__defaults__, value.__kwdefaults__, cells), depth - 1)
    elif isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__}"
    else:  # any other object: the parameters of its constructor that it stores
        yield kind
        for name in sorted(inspect.signature(type(value)).parameters):
            if hasattr(value, name):
                yield name
                yield from _parts(getattr(value, name), depth - 1)


def _code(code: CodeType) -> Iterator[str]:
    """Yield the instructions, names and constants of a function."""
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield repr(constant)


_KINDS: tuple[type[Any], ...] = (
    Perception,
    BehaviorClassifier,
    KernelFit,
    FeatureSpace,
    Whitening,
    Stacker,
    Knowledge,
    BaseRates,
    ConfusionPosterior,
    SharedTrait,
    PerceptTable,
    Payoffs,
)
_CLASSES = {kind.__name__: kind for kind in _KINDS}

Json = Any


def pack(value: Any, keep: Callable[[NDArray[Any]], str]) -> Json:
    """Return an object as JSON values; `keep` stores an array and returns its name.

    The learner contains the domain, so only the learned probabilities of a domain are written (see
    `chances`).
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, Rows):
        value = value.values
    if isinstance(value, np.ndarray):
        return {"array": keep(value), "dtype": value.dtype.str, "axes": value.ndim}
    if isinstance(value, Domain):
        return {"domain": chances(value).tolist()}
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
        return _succeeding(domain, packed["domain"])
    if "array" in packed:
        return read(str(packed["array"]), packed["dtype"], int(packed["axes"]))
    entries = packed["table"] if "table" in packed else packed["fields"]
    values = {str(name): unpack(entry, read, domain) for name, entry in entries.items()}
    kind = None if "table" in packed else _CLASSES[packed["class"]]
    for name, value in values.items():
        if isinstance(value, np.ndarray) and value.dtype.kind == "f" and kind is not PerceptTable:
            if name == "edges":  # edges of scores may be infinite or NaN
                continue
            infinite = name == "dispersion" and np.isposinf(value)  # objects do not differ
            if not (np.isfinite(value) | infinite).all():
                raise ValueError(f"{name} is not finite")
    return values if kind is None else kind(**values)


def _succeeding(domain: Domain, probabilities: list[float]) -> Domain:
    """Return a domain with other `chances`."""
    left = iter(map(float, probabilities))
    effects = tuple(replace(effect, probability=next(left)) for effect in domain.diagram.effects)
    behaviors = tuple(
        replace(behavior, answer_accuracy=next(left)) if behavior.asks else behavior
        for behavior in domain.behaviors
    )
    return replace(domain, behaviors=behaviors, diagram=replace(domain.diagram, effects=effects))


_TABLES = (
    "instances",
    "levels",
    "detected",
    "scores",
    "labels",
    "executions",
    "feedback",
    "answers",
    "object_labels",
)
_NAMES = ("objects", "trials", "feedback_logs")  # one JSON value per line
_UNLOGGED = "unlogged"  # its folders are not written, as another machine may load the file
_ENTRIES: Mapping[str, type[Feedback | Change]] = {"Feedback": Feedback, "Change": Change}
_LARGE = 2**62
_MOST_LEVELS = 64

Limits = tuple[int, int]  # the smallest value, and the end of the range
Tables = Mapping[str, NDArray[Any]]
FeatureParts = list[Any]  # [number of the context, name of the rows' array, of the values']


class _Sizes(NamedTuple):
    """Numbers of rows to which the numbers in the record may refer."""

    instances: int
    objects: int
    trials: int
    behaviors: int
    attributes: int


def write_experience(archive: zipfile.ZipFile, experience: Experience) -> None:
    """Write the tables of the experience, and the names of its objects, trials and logs."""
    for name in _TABLES:
        write_array(archive, name, getattr(experience, name).values)
    for name in _NAMES:
        archive.writestr(name, "\n".join(map(json.dumps, getattr(experience, name))))
    unlogged = [[type(entry).__name__, entry.packed().decode()] for _, entry in experience.unlogged]
    archive.writestr(_UNLOGGED, "\n".join(map(json.dumps, unlogged)))


def read_experience(archive: zipfile.ZipFile, domain: Domain) -> Experience:
    """Read the experience, after checking all its numbers.

    Raises
    ------
    ValueError
        If the tables do not fit the domain or each other.
    """
    experience = Experience(domain)
    empty = {name: getattr(experience, name).values for name in _TABLES}
    tables = {
        name: read_array(archive, name, values.dtype, values.ndim) for name, values in empty.items()
    }
    objects = _read_lines(archive, "objects")
    trials = [tuple(key) for key in _read_lines(archive, "trials")]
    feedback_logs = _read_lines(archive, "feedback_logs")
    _check_tables(tables, _sizes_of(tables, domain, len(objects), len(trials)))
    if len(set(objects)) < len(objects) or len(set(trials)) < len(trials):
        raise ValueError("objects or trials are named twice")
    if not all(isinstance(name, str) for name in [*objects, *feedback_logs]):
        raise ValueError("objects or logs are not named by text")
    experience.feedback_logs = dict.fromkeys(feedback_logs)
    for kind, text in _read_lines(archive, _UNLOGGED) if _UNLOGGED in archive.namelist() else ():
        experience.unlogged.append((None, _ENTRIES[kind].unpacked(text.encode())))
    experience.objects = {name: number for number, name in enumerate(objects)}
    experience.trials = {key: number for number, key in enumerate(trials)}
    for name, values in tables.items():
        getattr(experience, name).extend(values)
    return experience


def _sizes_of(tables: Tables, domain: Domain, objects: int, trials: int) -> _Sizes:
    return _Sizes(
        instances=len(tables["instances"]),
        objects=objects,
        trials=trials,
        behaviors=len(domain.behaviors),
        attributes=len(domain.attributes),
    )


def _check_record(experience: Experience, path: Path) -> None:
    """Raise `OutputError` if a record is incomplete, as after Ctrl-C, and could not be loaded."""
    tables = {name: getattr(experience, name).values for name in _TABLES}
    objects, trials = len(experience.objects), len(experience.trials)
    try:
        _check_tables(tables, _sizes_of(tables, experience.domain, objects, trials))
    except ValueError as fault:
        raise OutputError(
            f"{path} is not written: the record of this learner is incomplete ({fault}), as after "
            "an interruption while a step was recorded. Load the file that was saved last, and "
            "recall() the logs of the trials since."
        ) from fault


def _column_limits(sizes: _Sizes) -> dict[str, dict[str, Limits]]:
    """Return the limits of each column of the tables of the experience."""
    n, o, t, e, p = sizes
    return {
        "instances": {
            "object": (0, o),
            "behavior": (0, e),
            "digest": (0, 2**63 - 1),
            "copy": (0, _LARGE),
            "recording": (NONE, _LARGE),
            "origin": (0, WITHDRAWN + 1),
            "scale": (0, _MOST_LEVELS),
        },
        "executions": {
            "trial": (0, t),
            "behavior": (0, e),
            "instance": (NONE, n),
            "success": (-1, WITHDRAWN + 1),
        },
        "answers": {
            "trial": (0, t),
            "behavior": (0, e),
            "object": (0, o),
            "attribute": (0, p),
            "value": (0, 2),
        },
        "feedback": {
            "trial": (0, t),
            "call": (0, _LARGE),
            "object": (0, o),
            "attribute": (0, p),
            "value": (-1, 2),
            "given": (0, 2),
        },
    }


def _check_tables(tables: Tables, sizes: _Sizes) -> None:
    """Raise `ValueError` if a number is out of range, or a table has the wrong length."""
    for name, limits in _column_limits(sizes).items():
        for column in tables[name].dtype.names or ():
            check_limits(name, tables[name][column], limits[column])
    for name in ("levels", "detected"):
        check_limits(name, tables[name], (-1, _MOST_LEVELS))
    for name in ("labels", "object_labels"):
        check_limits(name, tables[name], (-1, 2))
    if np.isinf(tables["scores"]).any():
        raise ValueError("scores are not finite")
    of_instances = ("levels", "detected", "scores", "labels")
    if any(len(tables[name]) != sizes.instances for name in of_instances):
        raise ValueError("percepts or labels do not fit the instances")
    if len(tables["object_labels"]) != sizes.objects:
        raise ValueError("labels do not fit the objects")


def check_limits(name: str, values: NDArray[Any], limits: Limits) -> None:
    """Raise `ValueError` if a value is outside of the limits."""
    least, end = limits
    if ((values < least) | (values >= end)).any():
        raise ValueError(f"{name} has an index out of range")


def write_features(experience: Experience, keep: Callable[[NDArray[Any]], str]) -> FeatureParts:
    """Write features, one array for each context and size; return the names of the arrays."""
    parts = []
    for number, context in enumerate(experience.domain.contexts):
        by_size: dict[int, list[int]] = {}
        for i, values in experience.features[context].items():
            by_size.setdefault(len(values), []).append(i)
        for rows in by_size.values():
            values = np.stack([experience.features[context][i] for i in rows])
            parts.append([number, keep(np.array(rows, np.int64)), keep(values)])
    return parts


def read_features(
    parts: FeatureParts, read: Callable[[str, str, int], NDArray[Any]], experience: Experience
) -> None:
    """Read features into the experience, in the order of instances.

    Raises
    ------
    ValueError
        If features are not finite, or do not belong to instances of their behavior.
    """
    contexts = experience.domain.contexts
    by_context: list[dict[int, NDArray[np.float32]]] = [{} for _ in contexts]
    behaviors = experience.instances.values["behavior"]
    for number, rows_name, values_name in parts:
        values = read(str(values_name), "<f4", 2)
        rows = read(str(rows_name), "<i8", 1)
        name = f"features of {contexts[number]}"
        if not np.isfinite(values).all() or values.shape[0] != len(rows) or not values.shape[1]:
            raise ValueError(f"{name} are not finite, or not of instances")
        check_limits(name, rows, (0, len(behaviors)))
        behavior = experience.domain.behavior_index(contexts[number][0])
        if (behaviors[rows] != behavior).any():
            raise ValueError(f"{name} are of another behavior's instances")
        by_context[number].update(zip(rows.tolist(), values, strict=True))
    for context, by_instance in zip(contexts, by_context, strict=True):
        experience.features[context] = dict(sorted(by_instance.items()))


def _read_lines(archive: zipfile.ZipFile, name: str) -> list[Any]:
    """Read JSON values, one per line."""
    return [json.loads(line) for line in read_member(archive, name).splitlines()]


State = dict[str, Any]  # by field

_ELSEWHERE = ("record", "agent", "settings", "policies", "plan_libraries", "values", "perceived")
_FIELDS = tuple(field.name for field in fields(Online) if field.name not in _ELSEWHERE)
_GROWING = ("levels", "counted_labels")


def state_of(fit: Online, *, with_perception: bool) -> State:
    """Return the fields of an agent's fit; a user's own classifiers cannot be written."""
    state = {name: getattr(fit, name) for name in _FIELDS}
    return state if with_perception else {**state, "perception": None}


def fit_of(experience: Experience, agent: Agent, settings: LearnerSettings, state: State) -> Online:
    """Return an agent's fit; raise `ValueError` if it does not belong to the experience."""
    _check_state(state, experience, agent)
    state = dict(state)
    for name in _GROWING:
        rows = Rows(np.int8, len(experience.domain.attributes))
        rows.extend(state[name])
        state[name] = rows
    if settings.classifier is not None:
        used = state["labels_at_refit"]
        state["perception"] = classify(experience, agent, settings, used, state["sizes"])[2]
    return Online(experience, agent, settings, **state)


def _check_state(state: State, experience: Experience, agent: Agent) -> None:
    """Raise `ValueError` if arrays do not fit the experience or its domain."""
    domain = experience.domain
    p = len(domain.attributes)
    e = len(domain.behaviors)
    _check_shape("sizes", state["sizes"], (len(domain.contexts),))
    check_limits("sizes", state["sizes"], (NONE, _LARGE))
    for name in ("knowledge", "knowledge_at_refit"):
        _check_shape(name, state[name].posterior.counts, (p, e, 2, agent.levels))
        _check_knowledge(state[name], p)
    if state["perception"] is not None:
        sizes = dict(zip(domain.contexts, state["sizes"].tolist(), strict=True))
        _check_perception(state["perception"], domain, agent.levels, sizes)
    # These arrays may have fewer rows than the experience, which may have grown since.
    limits = {"labels_at_refit": 2, "levels": agent.levels, "counted_labels": 2}
    for name, end in limits.items():
        _check_shape(name, state[name], (min(len(state[name]), len(experience.instances)), p))
        check_limits(name, state[name], (-1, end))
    cells = state["trained_cells"]
    _check_shape("trained_cells", cells, (min(len(cells), len(experience.objects)), e, p))
    for name in ("percepts", "percepts_at_refit"):
        _check_shape(name, state[name], (p, e, 2, 2))
        if not (state[name] >= 0).all():
            raise ValueError(f"{name} are not all 0 or more")
    _check_shape("experience_at_refit", state["experience_at_refit"], (2, p, e))
    check_limits("experience_at_refit", state["experience_at_refit"], (0, _LARGE))
    _check_shape("n_labels_at_refit", state["n_labels_at_refit"], (p,))
    check_limits("n_labels_at_refit", state["n_labels_at_refit"], (0, _LARGE))
    _check_shape("edges", state["edges"], (p, e, agent.levels - 1))
    if (state["edges"][..., 1:] < state["edges"][..., :-1]).any():
        raise ValueError("edges do not rise")


def _check_knowledge(knowledge: Knowledge, p: int) -> None:
    """Raise `ValueError` if rates or labels of P attributes are invalid."""
    _check_shape("base_rates", knowledge.base_rates, (p,))
    _check_within("base_rates", knowledge.base_rates, 0, 1)
    _check_shape("labels", knowledge.labels, (len(knowledge.labels), p))
    check_limits("labels", knowledge.labels, (-1, 2))
    trait = knowledge.trait
    if trait is not None:
        _check_shape("points", trait.points, (len(trait.points),))
        _check_distributions("latent_classes", trait.latent_classes, (2, len(trait.points)))
    rates = knowledge.rates
    if rates is not None:
        for name in ("true", "labeled", "values"):
            _check_shape(name, getattr(rates, name), (p,))
        _check_within("true", rates.true, 0, rates.labeled)
        check_limits("values", rates.values, (0, p + 1))
        _check_distributions("weights", rates.weights, (len(rates.weights),))
        _check_within("rates", rates.mean, 0, 1)


def _check_perception(
    perception: Perception, domain: Domain, levels: int, sizes: Mapping[Context, int]
) -> None:
    """Raise `ValueError` if classifiers do not fit each other or the domain."""
    p = len(domain.attributes)
    if perception.levels != levels:
        raise ValueError(f"classifiers of {perception.levels} levels, expected {levels}")
    _check_shape("labels", perception.labels, (len(perception.labels), p))
    check_limits("labels", perception.labels, (-1, 2))
    for behavior, classifier in perception.classifiers.items():
        spaces = classifier.spaces
        if not {*spaces} <= {*domain.behaviors[domain.behavior_index(behavior)].modalities}:
            raise ValueError(f"{behavior} has other modalities")
        for modality, space in spaces.items():
            _check_space(space, sizes[behavior, modality])
        recordings = {len(space.rows) for space in spaces.values()}
        dual, weights = classifier.fit.dual, classifier.fit.pool.weights
        kernels = len(spaces), len(spaces) + 1  # without and with the joint kernel
        if len(dual) not in kernels or {dual.shape[2:]} != {(n,) for n in recordings}:
            raise ValueError(f"dual has shape {dual.shape}, which its recordings have not")
        _check_shape("dual", dual, (len(dual), p, *dual.shape[2:]))
        _check_shape("weights", weights, (p, 1 + len(dual)))
        _check_shape("used", classifier.used, (p,))


def _check_space(space: FeatureSpace, size: int) -> None:
    """Raise `ValueError` if the parts of a feature space do not fit each other."""
    d = len(space.varying)
    check_limits("varying", space.varying, (0, size))
    if (np.diff(space.varying) <= 0).any():
        raise ValueError("varying is not rising")
    _check_shape("center", space.center, (d,))
    _check_shape("scale", space.scale, (d,))
    _check_shape("rows", space.rows, (len(space.rows), d))
    if not (space.scale > 0).all() or not 0 < space.width < np.inf:
        raise ValueError("scale or width is not above 0")
    if space.whitening is not None:
        gain = space.whitening.gain
        _check_shape("gain", gain, (len(gain),))
        _check_shape("basis", space.whitening.basis, (len(gain), d))
        _check_within("gain", gain, -1, 0)


def _check_within(
    name: str, values: NDArray[Any], least: float, most: float | NDArray[Any]
) -> None:
    if ((values < least) | (values > most)).any():
        raise ValueError(f"{name} is out of range")


def _check_distributions(name: str, values: NDArray[Any], shape: tuple[int, ...]) -> None:
    """Raise `ValueError` if rows are not probability distributions."""
    _check_shape(name, values, shape)
    _check_within(name, values, 0, 1)
    if not np.allclose(values.sum(axis=-1), 1.0):
        raise ValueError(f"{name} does not sum to 1")


def _check_shape(name: str, values: Any, expected: tuple[int, ...]) -> None:
    if values.shape != expected:
        raise ValueError(f"{name} has shape {values.shape}, expected {expected}")


_FORMAT = 19
_TEXT = LEARNER


@dataclass(frozen=True, slots=True)
class SavedLearner:
    """The complete state of a learner: experience, settings, and fits of agents."""

    agent: Agent
    settings: LearnerSettings
    experience: Experience
    table: PerceptTable | None
    fitted: list[Online]
    questions: QuestionCounts
    file: str  # id of the file
    robot_state: str | None  # state of the robot after the last trial
    robot_seen: str  # time of that trial


def write_learner(learner: SavedLearner, path: Path, *, overwrite: bool) -> str:
    """Write a learner and return the new id of the file; a failure leaves no partial file.

    `learner.file` is the id of the file that the learner read or wrote last. Only this file is
    overwritten, unless `overwrite` is true.
    """
    settings = learner.settings
    experience = learner.experience
    _check_record(experience, path)
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
                "state": pack(state_of(fit, with_perception=classifier is None), keep),
            }
            for fit in learner.fitted
        ]
        meta: dict[str, Any] = {
            "format": _FORMAT,
            "file": file,
            "parent": learner.file,
            "domain": domain_table(experience.domain),
            "first_attributes": experience.first_attributes,
            "agent": learner.agent.name,
            "digest": agent_digest(learner.agent),
            "classifier": None if classifier is None else type(classifier).__name__,
            "settings": pack({**written, "classifier": None}, keep),
            "questions": asdict(learner.questions),
            "robot_state": learner.robot_state,
            "robot_seen": learner.robot_seen,
            "fitted": fitted,
            "table": pack(learner.table, keep),
            "features": write_features(experience, keep),
        }
        write_experience(archive, experience)
        # Written last, because it names the arrays that were written.
        meta["checksums"] = {info.filename: info.CRC for info in archive.infolist()}
        text = json.dumps(meta, allow_nan=False).encode()
        archive.writestr(_TEXT, text)
        archive.comment = checksum(text)
    return file


def checksum(text: bytes) -> bytes:
    """Return the checksum of `learner.json`, which contains the checksums of the other members."""
    return hashlib.sha256(text).hexdigest().encode()


def _check_unchanged(archive: zipfile.ZipFile, text: bytes, meta: dict[str, Any]) -> None:
    """Raise `ValueError` if a member of the archive was changed."""
    if checksum(text) != archive.comment:
        raise ValueError(f"{_TEXT} was changed since it was written")
    written = meta["checksums"]
    found = {info.filename: info.CRC for info in archive.infolist() if info.filename != _TEXT}
    changed = [name for name in {**written, **found} if written.get(name) != found.get(name)]
    if changed:
        raise ValueError(f"{changed[0]} was changed since it was written")


def read_learner(path: Path, *, agent: object, classifier: object) -> SavedLearner:
    """Read a learner; raise as `Learner.load` does."""
    if not path.is_file():
        raise DataError(f"No file {path}; give the path of a learner that save() wrote.")
    with _refusing(path), zipfile.ZipFile(path) as archive:
        check_unpacked(archive, path.stat().st_size)
        text = read_member(archive, _TEXT)
        meta = read_meta(text, _FORMAT)
        _check_unchanged(archive, text, meta)
        domain = domain_from_table(meta["domain"])
    chosen = _agent(meta, agent, classifier)
    with _refusing(path), zipfile.ZipFile(path) as archive:
        read = partial(read_array, archive)
        table = unpack(meta["table"], read, domain)
        settings = unpack(meta["settings"], read, domain)
        settings = LearnerSettings(**{**settings, "classifier": classifier})
        experience = read_experience(archive, domain)
        first = int(meta["first_attributes"])
        check_limits("first_attributes", np.array(first), (1, len(domain.attributes) + 1))
        experience.first_attributes = first
        read_features(meta["features"], read, experience)
        if table is not None:
            check_data(table, domain)
        fitted = []
        for entry in meta["fitted"]:
            fit_agent = _known(entry, chosen)
            if fit_agent is not None:  # otherwise the agent is fitted again when it is used
                state = unpack(entry["state"], read, domain)
                fitted.append(fit_of(experience, fit_agent, settings, state))
        saved = SavedLearner(
            agent=chosen,
            settings=settings,
            experience=experience,
            table=table,
            fitted=fitted,
            questions=QuestionCounts(**meta["questions"]),
            file=str(meta["file"]),
            robot_state=_state_of(meta["robot_state"], domain),
            robot_seen=str(meta.get("robot_seen", "")),
        )
    own_posterior(settings.posterior, domain, chosen)
    return saved


@contextlib.contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Turn errors of reading a file into a `DataError` that names the file."""
    try:
        yield
    except (*UNREADABLE, MealBayesError) as fault:
        raise DataError(
            f"{path} does not contain a valid learner ({fault}); save the learner again, or fit a "
            "new one."
        ) from fault
    except OSError as fault:
        raise DataError(f"{path} cannot be read: {fault}.") from fault


def _state_of(name: object, domain: Domain) -> str | None:
    """Return the state of the robot that a file contains, after a check."""
    if name is None or name == LOST:
        return name
    return domain.diagram.states[state_index(domain.diagram.states, name, "robot_state")]


def _refuse_what_others_saved(path: Path, file: str) -> None:
    """Raise `OutputError` for an existing file that this learner did not write or read last."""
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
            f"{path} contains {content}, and this learner {history}: another learner was saved "
            "there. Load that file and add the missing labels, give another name, or call "
            "save(path, overwrite=True)."
        )


def _agent(meta: dict[str, Any], agent: object, classifier: object) -> Agent:
    """Return the agent; raise an error if the user's own agent or classifier is missing."""
    if (classifier is None) != (meta["classifier"] is None):
        raise SettingsError(
            f"The learner uses {meta['classifier'] or 'the default classifiers'}; pass the same "
            "classifier by load(path, classifier=...)."
        )
    if agent is not None:
        return as_agent(agent)
    name = str(meta["agent"])
    if name not in AGENTS:
        raise SettingsError(
            f"The learner's agent {name!r} is not one of the package; pass it by load(path, "
            "agent=...)."
        )
    if meta["digest"] != agent_digest(AGENTS[name]):
        raise SettingsError(
            f"The learner's agent {name!r} is not the agent of the package with this name; pass "
            "it by load(path, agent=...)."
        )
    return AGENTS[name]


def _known(entry: dict[str, Any], chosen: Agent) -> Agent | None:
    """Return the agent to which a saved fit belongs, or None if the agent is not known."""
    for agent in (chosen, training_agent(chosen), AGENTS.get(str(entry["agent"]))):
        if agent is not None and agent_digest(agent) == entry["digest"]:
            return agent
    return None
