"""Percept tables: the outputs of held-out classifiers on every recording, in levels.

As files they ship with the package by name, or are your own .npz.

A classifier's log-odds are rounded and cut into fine bins, which merge to K levels. A detector of
the robot's own gives percepts as such, in place of features.
"""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import (
    ByValue,
    as_float,
    freeze,
    freeze_arrays,
    label_values,
    lowest_yes,
    set_frozen,
    tiny_is_zero,
)
from meal_bayes.datasets.dataset import check_objects, complete_labels
from meal_bayes.digests import digest_of, digest_of_arrays
from meal_bayes.domain import (
    Domain,
    domain_from_table,
    domain_names,
    domain_table,
    load_domain,
    unknown,
)
from meal_bayes.errors import DataError, DomainError, SettingsError
from meal_bayes.files import checked_path, draft_of, path_text
from meal_bayes.look import facts_repr, listed
from meal_bayes.untrusted import UNREADABLE, check_unpacked, read_array, read_meta, write_array

THRESHOLD = float(np.log(0.501 / 0.499))  # yes/no at .501: .5 +- 1e-16 would leak by rounding
BIN_COUNT = np.dtype("|u1")  # of an object's recordings in a fine bin, in tables and files
STORED = np.dtype("<f2")  # log-odds, in tables and files,
LIMIT = 8.0  # and within +-8, where that is good to .004
BIN_EDGES = freeze(THRESHOLD + np.array([-3.0, -1.5, -0.5, 0.0, 0.5, 1.5, 3.0]))


def lowest_bins(bins: int, levels: int) -> NDArray[np.intp]:
    """Return the lowest of the fine bins of each of K levels, (K,): how bins become levels.

    Each level merges L / K neighboring bins; K is even, so that yes and no are never merged.

    >>> lowest_bins(8, 4).tolist()
    [0, 2, 4, 6]
    """
    if levels < 2 or levels % 2 or bins % levels:
        fitting = [k for k in range(2, bins + 1, 2) if bins % k == 0]
        raise SettingsError(f"Percepts cannot have {levels} levels; expected one of {fitting}.")
    return np.arange(0, bins, bins // levels)


def level_edges(edges: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """Return the edges (K-1,) between K levels, of the fine bins' edges (L-1,)."""
    return edges[lowest_bins(len(edges) + 1, levels)[1:] - 1]


def merge_bins(counts: NDArray[np.integer], levels: int) -> NDArray[np.int64]:
    """Sum counts (...,L) in fine bins to counts (...,K) in levels."""
    lowest = lowest_bins(counts.shape[-1], levels)
    return np.add.reduceat(counts, lowest, axis=-1, dtype=np.int64)


def levels_of(log_odds: ArrayLike, edges: NDArray[np.float64], levels: int) -> NDArray[np.int8]:
    """Return the percept levels, 0 (no) to K-1 (yes), of log-odds of any shape."""
    return np.searchsorted(level_edges(edges, levels), log_odds).astype(np.int8)


def classifier_levels(log_odds: ArrayLike, levels: int) -> NDArray[np.int8]:
    """Return the percept levels 0 .. K-1 of what a classifier says, live as in a table.

    >>> classifier_levels([-5.0, -1.0, 0.0, 1.0, 5.0], 4).tolist()
    [0, 1, 1, 2, 3]
    """
    return levels_of(round_log_odds(log_odds), BIN_EDGES, levels)


@tiny_is_zero
def round_log_odds(log_odds: ArrayLike) -> NDArray[np.float16]:
    """Clip to +-LIMIT and round as tables store them: percepts do not change by saving."""
    return np.clip(np.asarray(log_odds, dtype=np.float64), -LIMIT, LIMIT).astype(STORED)


_FORMAT = 1
_MEMBERS = {  # name -> dtype, axes
    "meta": ("|u1", 1),  # JSON
    "labels": ("|i1", 2),  # (O,P)
    "log_odds": (STORED.str, 4),  # (O,R,E',P), E' the behaviors with modalities
    "edges": ("<f8", 1),  # (L-1,)
    "training_bins": (BIN_COUNT.str, 5),  # (O,P,E',G,L) [o', ..., held-out g]: neighbors are alike
    "recording_counts": ("<u2", 2),  # (O,E'), only where recordings are ragged
    "groups": ("<u2", 1),  # (O,), only where objects are left out by folds
}
_OPTIONAL = ("recording_counts", "groups")
_LARGEST = 64 << 20  # bytes that a member may unpack to
_IN_MEMORY = 2 * _LARGEST  # ... that its rows may take, with those of a larger domain
_HEADER = 256  # bytes of an array's header, at most


@dataclass(frozen=True, slots=True)
class PerceptTable(ByValue):
    """Percepts of each held-out object, with percept counts of the other objects.

    A percept is the output of a classifier for one attribute. The table stores it as the log-odds
    that the attribute is true, under a prior of 1/2. Positive log-odds favor "true". `edges` divide
    the log-odds into L bins, and the middle edge separates no from yes. The function `lowest_bins`
    determines how bins are merged to the K levels that agents use. If a behavior or an attribute
    has no percepts, log-odds are NaN and counts are zero.

    Attributes
    ----------
    domain : Domain
        Behaviors and attributes.
    objects : tuple[str, ...]
        (O,) names of the objects.
    labels : NDArray[np.int8]
        (O,P) label of each object and attribute: 1 true, 0 false, -1 unknown.
    log_odds : NDArray[np.float16]
        (O,R,E,P) log-odds of each attribute for each recording of an object, by classifiers that
        were trained without this object.
    edges : NDArray[np.float64]
        (L-1,) edges of the bins; the middle edge is the threshold between no and yes.
    training_bins : NDArray[np.uint8]
        (G,O,P,E,L) number of percepts in each bin. Entries [g, o] count percepts of object o by
        classifiers that were trained without o and without the objects of group g. These entries
        are zero if o belongs to group g.
    provenance : Mapping[str, str]
        Versions, settings, checksums and the command that made the table.
    recording_counts : NDArray[np.int64]
        (O,E) number of recordings of each object and behavior. By default it is R for all behaviors
        with modalities.
    groups : NDArray[np.int64]
        (O,) number of each object's group. Objects of one group are held out together. By default
        each object is a group of its own; if there are many objects, groups are folds.

    Raises
    ------
    DataError
        Shapes do not agree, or edges do not increase.

    Examples
    --------
    >>> import meal_bayes
    >>> table = meal_bayes.load_percepts("roc36")
    >>> len(table.objects)
    36
    """

    domain: Domain
    objects: tuple[str, ...]
    labels: NDArray[np.int8]
    log_odds: NDArray[np.float16]
    edges: NDArray[np.float64]
    training_bins: NDArray[np.uint8]
    provenance: Mapping[str, str]
    recording_counts: NDArray[np.int64] = None  # type: ignore[assignment]
    groups: NDArray[np.int64] = None  # type: ignore[assignment]

    __repr__ = facts_repr

    def __post_init__(self) -> None:
        set_frozen(self, labels=label_values(self.labels), log_odds=np.asarray(self.log_odds))
        check_objects(self.objects)
        o = len(self.objects)
        e = len(self.domain.behaviors)
        p = len(self.domain.attributes)
        r = self.recordings
        if self.groups is None:
            set_frozen(self, groups=np.arange(o))  # type: ignore[unreachable]
        if self.recording_counts is None:
            counts = np.zeros((o, e), np.int64)  # type: ignore[unreachable]
            counts[:, self.domain.recorded] = r
            set_frozen(self, recording_counts=counts)
        freeze_arrays(self)
        expected = {
            "labels": (o, p),
            "log_odds": (o, r, e, p),
            "groups": (o,),
            "training_bins": (int(self.groups.max(initial=-1)) + 1, o, p, e, len(self.edges) + 1),
            "recording_counts": (o, e),
        }
        for name, shape in expected.items():
            actual = getattr(self, name).shape
            if actual != shape:
                raise DataError(f"Percept table: {name} has shape {actual}; expected {shape}.")
        set_frozen(self, labels=complete_labels(self.domain, self.objects, self.labels))
        if not ((self.recording_counts >= 0) & (self.recording_counts <= r)).all():
            raise DataError(f"Percept table: expected recording_counts in 0 to {r}.")
        if self.training_bins[self.groups, np.arange(o)].any():
            raise DataError(
                "Percept table: the training bins of an object count its own recordings; they "
                "must be zero (build the table again)."
            )
        if len(self.edges) % 2 == 0 or not (np.diff(self.edges) > 0).all():
            raise DataError("Percept table: expected an odd number of edges, each above the last.")

    def _facts(self) -> tuple[str, dict[str, str]]:
        names = self.domain.attributes
        return f"PerceptTable {self.domain.name}", {
            "objects": f"{len(self.objects)}: {listed(self.objects, 3)}",
            "behaviors": listed(self.domain.behavior_names),
            "attributes": f"{len(names)}: {listed(names)}",
            "recordings": f"up to {self.recordings} of each object and behavior",
            "made by": self.provenance.get("package", "unknown"),
        }

    @property
    def recordings(self) -> int:
        """Largest number R of recordings that any object has of any behavior."""
        return int(self.log_odds.shape[1]) if self.log_odds.ndim > 1 else 0

    def digest(self) -> str:
        """Compute a digest of the table's numbers, domain and provenance."""
        names = ("labels", "log_odds", "edges", "training_bins", "recording_counts", "groups")
        arrays = {name: getattr(self, name) for name in names}
        facts = [domain_table(self.domain), self.objects, dict(self.provenance)]
        return digest_of(*facts, digest_of_arrays(arrays))

    def levels_of(self, log_odds: ArrayLike, levels: int) -> NDArray[np.int8]:
        """Return the percept levels, 0 (no) to K-1 (yes), of log-odds of any shape."""
        return levels_of(log_odds, self.edges, levels)

    def training_levels(self, held_out: int, levels: int) -> NDArray[np.int64]:
        """Return the counts (O,P,E,K) of percept levels that are used for one held-out object."""
        bins = self.training_bins[self.groups[held_out]]
        return freeze(merge_bins(bins, levels), np.int64)


def save_percepts(table: PerceptTable, path: str | Path) -> None:
    """Write a percept table as an .npz file, which `numpy.load` can open too.

    The file is compressed by LZMA. The file also contains the domain, unless the package contains
    this domain.

    Raises
    ------
    SettingsError
        The name does not end in .npz.
    DataError
        The table is larger than what `load_percepts` reads: 64 MB for each array.
    OutputError
        The file cannot be written. An existing file stays unchanged.

    Examples
    --------
    >>> import meal_bayes
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> table = meal_bayes.load_percepts("roc36")
    >>> with TemporaryDirectory() as folder:
    ...     meal_bayes.save_percepts(table, Path(folder, "table.npz"))
    ...     again = meal_bayes.load_percepts(Path(folder, "table.npz"))
    >>> again.objects == table.objects
    True
    """
    path = checked_path("The percept table", path)
    if path.suffix != ".npz":
        raise SettingsError(f"{path}: a percept table is an .npz; give a name that ends in .npz.")
    sensing = table.domain.recorded
    meta = {
        "format": _FORMAT,
        "domain": table.domain.name,
        "objects": table.objects,
        "attributes": table.domain.attributes,
        "behaviors": [table.domain.behavior_names[i] for i in sensing],
        "provenance": dict(table.provenance),
    }
    # A shipped domain may be corrected later; the user's own has no other home than this file.
    if table.domain.name not in domain_names() or load_domain(table.domain.name) != table.domain:
        meta["domain_table"] = domain_table(table.domain)
    # Behaviors without modalities have no percepts: the file leaves their empty rows out.
    arrays = {
        "meta": np.frombuffer(json.dumps(meta).encode(), np.uint8),
        "labels": table.labels,
        "log_odds": table.log_odds[:, :, sensing],
        "edges": table.edges,
        "training_bins": table.training_bins[:, :, :, sensing].transpose(1, 2, 3, 0, 4),
    }
    counts = table.recording_counts[:, sensing]
    if (counts < table.recordings).any():
        arrays["recording_counts"] = counts
    if (table.groups != np.arange(len(table.objects))).any():
        arrays["groups"] = table.groups
    typed = {name: np.asarray(values, _MEMBERS[name][0]) for name, values in arrays.items()}
    sizes = [(name, values.nbytes + _HEADER, _LARGEST) for name, values in typed.items()]
    # In memory, behaviors without modalities have rows, too.
    for name, size, most in [*sizes, ("training_bins", table.training_bins.nbytes, _IN_MEMORY)]:
        if size > most:
            raise DataError(
                f"{path}: {name} of {len(table.objects)} objects, {len(table.domain.attributes)} "
                f"attributes and {len(table.domain.behaviors)} behaviors has {size:,} bytes, more "
                f"than the {most:,} that a percept table may have; leave some of them out."
            )
    with draft_of(path) as draft, zipfile.ZipFile(draft, "w", zipfile.ZIP_LZMA) as archive:
        for name, values in typed.items():
            write_array(archive, name, values)


def load_percepts(
    name: str | Path, *, domain: str | Path | Mapping[str, Any] | Domain | None = None
) -> PerceptTable:
    """Load the shipped percept table of a domain, or your own table from an .npz file.

    Parameters
    ----------
    name : str | Path
        Name of a shipped domain, or a path that ends in .npz. Variants of a domain share the table
        of their data set.
    domain : str, path, mapping or Domain, optional
        Domain, as for `Learner`. The table gets the behaviors and attributes of this domain, in the
        domain's order. By default it is the shipped domain of this name, or the domain in the file.

    Raises
    ------
    SettingsError
        No shipped domain and no file has this name.
    DataError
        The file does not contain a percept table, or its table does not fit the domain.

    Examples
    --------
    >>> import meal_bayes
    >>> meal_bayes.load_percepts("roc36").domain.name
    'roc36'
    """
    domain = None if domain is None else load_domain(domain)
    path = checked_path("The percept table", name)
    if path.suffix == ".npz":
        if not path.is_file():
            raise SettingsError(f"No file {path}; give the path of a percept table (.npz).")
        return _read(path, str(path), domain)
    domain = load_domain(name) if domain is None else domain
    path = shipped_path(domain)
    if not path.is_file():
        raise SettingsError(
            f"No percept table ships for {str(name)!r}; expected a domain of "
            f"{', '.join(sorted(table.stem for table in path.parent.glob('*.npz')))}, or the path "
            "of an .npz made by save_percepts, or by `meal-bayes data percepts --dataset "
            "DOMAIN.toml --root FOLDER --out FILE.npz`."
        )
    return _read(path, str(name), domain)


def domain_of(name: str | Path) -> Domain:
    """Return the domain of a shipped name, of a TOML, or of a percept table (.npz)."""
    is_table = str(path_text(name)).endswith(".npz")
    return load_percepts(name).domain if is_table else load_domain(name)


def shipped_path(domain: Domain) -> Path:
    """Return where the table of a domain's data set lies in the package, if one ships."""
    return Path(__file__).parent / "tables" / f"{domain.data}.npz"


def _read(path: Path, where: str, domain: Domain | None) -> PerceptTable:
    """Read a table, with attributes and behaviors in the order of the domain (the file's own)."""
    try:
        with zipfile.ZipFile(path) as archive:
            check_unpacked(archive, path.stat().st_size)
            arrays = {
                name: read_array(archive, name, *spec, _LARGEST)
                for name, spec in _MEMBERS.items()
                if name not in _OPTIONAL or f"{name}.npy" in archive.namelist()
            }
        meta = read_meta(arrays["meta"].tobytes(), _FORMAT)
        if domain is None and "domain_table" in meta:
            domain = domain_from_table(meta["domain_table"])
        if domain is None and meta["domain"] not in domain_names():
            raise SettingsError(
                f"{where} belongs to the domain {meta['domain']!r}, which is not in the package; "
                f"pass "
                "domain=load_domain(<your table>.toml)."
            )
        return _in_domain_order(meta, arrays, domain or load_domain(meta["domain"]))
    except (DataError, DomainError) as error:
        raise DataError(f"{where}: {error}") from error
    except (*UNREADABLE, OSError) as error:
        raise DataError(
            f"{where} is not a complete percept table ({error}); make it again with "
            "`meal-bayes data percepts --dataset D`."
        ) from error


def _in_domain_order(
    meta: dict[str, Any], arrays: dict[str, NDArray[Any]], domain: Domain
) -> PerceptTable:
    """Return the table with attributes and behaviors in the order of the domain."""
    sensing = [domain.behavior_names[e] for e in domain.recorded]
    for key, names in (("attributes", domain.attributes), ("behaviors", sensing)):
        for name in names:
            if name not in meta[key]:
                raise DataError(unknown(key[:-1], name, meta[key]))
    objects = tuple(map(str, meta["objects"]))
    if len(set(objects)) < len(objects):
        raise DataError("An object is named twice; make the table again.")
    log_odds = arrays["log_odds"]
    bins = arrays["training_bins"]
    n_sensing = len(meta["behaviors"])
    every = np.full((len(objects), n_sensing), log_odds.shape[1])
    counts = arrays.get("recording_counts", every)
    columns = [meta["attributes"].index(name) for name in domain.attributes]
    # Behaviors without modalities take an empty row, which is appended behind the file's.
    rows = [
        meta["behaviors"].index(behavior.name) if behavior.modalities else n_sensing
        for behavior in domain.behaviors
    ]
    if bins.size // max(bins[0, :, :, 0, 0].size, 1) * len(columns) * len(rows) > _IN_MEMORY:
        raise DataError(
            f"{len(rows)} behaviors need a percept table that does not fit into memory."
        )
    padded_log_odds = np.insert(log_odds, n_sensing, np.nan, axis=2)  # (O,R,E'+1,P)
    padded_bins = np.insert(bins[:, columns], n_sensing, 0, axis=2)  # (O,P,E'+1,G,L)
    padded_counts = np.insert(counts, n_sensing, 0, axis=1)  # (O,E'+1)
    return PerceptTable(
        domain=domain,
        objects=objects,
        labels=arrays["labels"][:, columns],
        log_odds=padded_log_odds[:, :, rows][..., columns],
        edges=arrays["edges"],
        training_bins=padded_bins[:, :, rows].transpose(3, 0, 1, 2, 4),
        provenance={name: str(text) for name, text in meta["provenance"].items()},
        recording_counts=padded_counts[:, rows],
        groups=arrays.get("groups"),  # type: ignore[arg-type]
    )


# --- Detections

# How sure a detector is, from -1 (no) to 1 (yes).
_SURENESS = {
    "surely yes": 1.0, "yes": 0.5, "no": -0.5, "not": -0.5, "surely no": -1.0, "surely not": -1.0,
}  # fmt: skip


class Said(NamedTuple):
    """What a detector said in one outcome, by attribute; of an attribute in one of both ways.

    Attributes
    ----------
    sure : dict[str, float]
        In words: from -1 (surely no) to 1 (surely yes).
    scores : dict[str, float]
        In numbers, of a scale of the detector's own.
    """

    sure: dict[str, float]
    scores: dict[str, float]


def checked_percepts(values: object, domain: Domain) -> Said:
    """Return what a detector said of each attribute, in words and in numbers.

    True, False, "yes", "no", "surely yes" or "surely no" is a word; of a group, by its name, the
    value that is seen. Any other number is a score, 0 and 1 too. None says nothing.

    Parameters
    ----------
    values : object
        By attribute, or a group's name.
    domain : Domain
        Of the attributes.

    Raises
    ------
    DataError
        No mapping, a name that the domain does not have, a value that is none of these, or two
        different ones of an attribute, by its own name and by its group's.

    Examples
    --------
    >>> from meal_bayes.domain import load_domain
    >>> toy = load_domain("toy")
    >>> checked_percepts({toy.attributes[0]: True, toy.attributes[1]: 0.2}, toy)
    Said(sure={'red': 1.0}, scores={'heavy': 0.2})
    """
    if not isinstance(values, Mapping):
        raise DataError(f"percepts are {values!r:.60}; expected {{attribute: True or False}}")
    said = Said({}, {})
    for name, value in values.items():
        members = domain.groups.get(name, ()) if name not in domain.attributes else ()
        if members and value is not None:
            if value not in members:
                raise DataError(unknown(f"value of {name!r}", str(value), members))
            _add(said, Said({m: 1.0 if m == value else -1.0 for m in members}, {}))
        elif name in domain.attributes:
            _add(said, _said_of(name, value))
        elif not members:
            raise DataError(unknown("attribute", str(name), (*domain.attributes, *domain.groups)))
    return said


def _add(said: Said, more: Said) -> None:
    """Add what more is said; raise a `DataError` where the two contradict each other."""
    for ours, others, new in zip(said, said[::-1], more, strict=True):
        for name, value in new.items():
            if name in others or ours.get(name, value) != value:
                raise DataError(
                    f"percepts say two things of {name!r}, by its name and by its group's; give one"
                )
            ours[name] = value


def _said_of(name: str, value: Any) -> Said:
    """Return what is said of an attribute, if anything."""
    said = Said({}, {})
    if value is np.ma.masked:
        return said
    if getattr(value, "ndim", None) == 0:  # a number of numpy or of a tensor package
        value = value.item()
    if isinstance(value, str) and value in _SURENESS:
        said.sure[name] = _SURENESS[value]
    elif isinstance(value, bool):
        said.sure[name] = 1.0 if value else -1.0
    elif isinstance(value, Real | Decimal):
        score = as_float(value)
        if not np.isfinite(score):
            raise DataError(
                f"the score of {name!r} is {score}; expected a finite number, or None where there "
                "is none"
            )
        said.scores[name] = score
    elif value is not None and repr(value) != "<NA>":  # pandas'
        names = ", ".join(_SURENESS)
        raise DataError(
            f"the percept of {name!r} is {value!r:.60}; expected True or False, one of {names}, or "
            "a number, which is a score"
        )
    return said


def detected_levels(
    percepts: Mapping[str, float] | None, domain: Domain, levels: int
) -> NDArray[np.int8]:
    """Return what a detector gave as percept levels (P,), of 0 to K - 1; -1 none.

    A bare "yes" or "no" is one of the two middle levels, what is sure one of the extremes.
    """
    percept = np.full(len(domain.attributes), -1, np.int8)
    for name, sure in (percepts or {}).items():
        middle = lowest_yes(levels) - (sure < 0)
        extreme = levels - 1 if sure > 0 else 0
        percept[domain.attribute_index(name)] = extreme if abs(sure) == 1 else middle
    return percept


def scores_of(scores: Mapping[str, float] | None, domain: Domain) -> NDArray[np.float64]:
    """Return the scores (P,) that a detector gave by attribute; NaN where there is none."""
    values = np.full(len(domain.attributes), np.nan)
    for name, score in (scores or {}).items():
        values[domain.attribute_index(name)] = score
    return values
