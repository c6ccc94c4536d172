"""Read Cassandra's .pomdp: any POMDP of the field, such as Tiger, as dense arrays."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import DataError, SettingsError
from meal_bayes.momdp.flat import FlatPOMDP

_LARGEST = 2**26  # bytes of a file
_LINE = 2**20  # characters of a line
_STATEMENT = 4_000_000  # words
_ENTRIES = 10_000_000  # (A,S,S,Z) of a dense table, 80 MB; there are four of them at the end
_NAMES = 10_000  # states, actions or observations: a dense table has no capacity for more
_ASSIGNED = 2_000_000_000  # entries set in all, as one short statement may set a whole table
_ROUNDED = 1e-4  # rows of published files add to 1 within this

_LISTS = ("states", "actions", "observations")
_INDICES = {  # of a statement, at most
    "T": ("actions", "states", "states"),
    "O": ("actions", "states", "observations"),
    "R": ("actions", "states", "states", "observations"),
}
_KEYWORDS = {"discount", "values", "start", *_LISTS, *_INDICES}

_Floats = NDArray[np.float64]
_Index = list[int | slice]


def read_pomdp(path: str | Path) -> FlatPOMDP:
    """Read a .pomdp file; rewards become their expectation over s' and z.

    Raises
    ------
    SettingsError : no such file.
    DataError : a file that is not well formed, or too large for dense arrays.
    """
    path = Path(path)
    if not path.is_file():
        raise SettingsError(f"No file {path}; give the path of a .pomdp file.")
    try:
        if path.stat().st_size > _LARGEST:
            raise _Fault(f"more than {_LARGEST // 2**20} MB; ask fewer attributes")  # noqa: TRY301
        with path.open(encoding="utf-8-sig") as file, np.errstate(over="ignore", invalid="ignore"):
            return _read(file)
    except (_Fault, UnicodeDecodeError, OSError) as fault:
        raise DataError(f"{path}: {fault}.") from fault


def _read(file: TextIO) -> FlatPOMDP:
    preamble, tables = _Preamble(), None
    for line, keyword, words in _statements(file):
        try:
            if keyword in _INDICES:
                tables = tables or _empty(preamble)
                tables.read(keyword, words)
            else:
                preamble.read(keyword, words)
        except _Fault as fault:
            raise _Fault(f"statement of line {line}: {fault}") from fault
    return _finish(preamble, tables or _empty(preamble))


class _Fault(ValueError):
    """What is wrong with a statement."""


def _statements(file: TextIO) -> Iterator[tuple[int, str, list[str]]]:
    """Split a file into (line, keyword, words); a statement ends where the next one begins."""
    begun, keyword, words = 1, "", list[str]()
    for number, line in enumerate(iter(lambda: file.readline(_LINE + 1), ""), 1):
        if len(line) > _LINE:
            raise _Fault(f"line {number} has more than {_LINE} characters")
        for word in re.findall(r":|[^\s:]+", line.partition("#")[0]):
            opener = _opener(words) if word == ":" else ""
            if opener:
                rest = words[: -len(opener.split())]
                if keyword or rest:
                    yield begun, keyword, rest
                begun, keyword, words = number, opener, []
            else:
                words.append(word)
        if len(words) > _STATEMENT:
            raise _Fault(f"a statement has more than {_STATEMENT} words")
    yield begun, keyword, words


def _opener(words: list[str]) -> str:
    """Return the keyword that a colon after these words completes, "" for none."""
    last = words[-1] if words else ""
    if last in ("include", "exclude") and words[-2:-1] == ["start"]:
        return f"start {last}"
    return last if last in _KEYWORDS else ""


@dataclass(slots=True)
class _Preamble:
    """What stands before the tables."""

    discount: float = float("nan")
    sign: float = 1.0  # -1 where values are costs
    start: tuple[str, list[str]] = ("start", ["uniform"])
    names: dict[str, tuple[str, ...]] = field(default_factory=dict)
    closed: bool = False  # have the tables begun?

    def read(self, keyword: str, words: list[str]) -> None:
        """Read one statement."""
        if self.closed:
            raise _Fault(f"{keyword} stands behind the first T, O or R; put it before")
        if keyword in _LISTS:
            self.names[keyword] = _names(keyword, words)
        elif keyword == "discount":
            self.discount = float(_numbers(words, 1)[0])
        elif keyword == "values":
            if words not in (["reward"], ["cost"]):
                raise _Fault(f"values: {' '.join(words[:5])}; expected reward or cost")
            self.sign = 1.0 if words == ["reward"] else -1.0
        elif keyword:
            self.start = (keyword, words)
        else:
            raise _Fault(f"found {' '.join(words[:5])!r}; expected one of {sorted(_KEYWORDS)}")


def _names(keyword: str, words: list[str]) -> tuple[str, ...]:
    if len(words) == 1 and _is_count(words[0]):
        count = int(words[0][:9])
        if not 0 < count <= _NAMES:
            raise _Fault(f"{words[0][:20]} {keyword}; expected 1 to {_NAMES}")
        return tuple(str(i) for i in range(count))
    if not 0 < len(words) <= _NAMES or len(set(words)) < len(words):
        raise _Fault(f"{keyword}: expected 1 to {_NAMES} names, each once, or how many there are")
    return tuple(words)


@dataclass(slots=True)
class _Tables:
    """The tables, filled statement by statement; later statements replace earlier ones."""

    places: dict[str, dict[str, int]]
    T: _Floats  # (A,S,S)
    O: _Floats  # (A,S,Z)  # noqa: E741
    R: _Floats  # (A,S,1,1) while rewards depend on neither s' nor z, then (A,S,S,Z)
    assigned: int = 0

    def read(self, keyword: str, words: list[str]) -> None:
        """Read one statement."""
        index, rest = self._index(keyword, words)
        if keyword == "R":
            index = self._reward_index(index)
        table: _Floats = getattr(self, keyword)
        block = table.shape[len(index) :]
        values: _Floats | float
        if rest == ["uniform"] and keyword != "R" and block:
            values = 1.0 / block[-1]
        elif rest == ["identity"] and keyword == "T" and len(index) == 1:
            values = np.eye(block[0])
        else:
            values = _numbers(rest, int(np.prod(block))).reshape(block)
        self.assigned += np.size(table[tuple(index)])
        if self.assigned > _ASSIGNED:
            raise _Fault(f"the statements so far set more than {_ASSIGNED:.0e} entries")
        table[tuple(index)] = values

    def _index(self, keyword: str, words: list[str]) -> tuple[_Index, list[str]]:
        """Split "a : s : s' 0.5" into its indices and the rest."""
        index, position = _Index(), 0
        for kind in _INDICES[keyword]:
            if index and words[position : position + 1] != [":"]:
                break
            position += bool(index)
            if position == len(words):
                raise _Fault(f"{keyword} lacks one of its {kind}")
            index.append(_place(self.places[kind], kind, words[position]))
            position += 1
        return index, words[position:]

    def _reward_index(self, index: _Index) -> _Index:
        """Keep rewards small while they depend on neither s' nor z, as most do."""
        if self.R.shape == (*self.T.shape, self.O.shape[2]):
            return index
        if index[2:] == [slice(None), slice(None)]:
            return index[:2]
        self.R = np.broadcast_to(self.R, (*self.T.shape, self.O.shape[2])).copy()
        return index


def _empty(preamble: _Preamble) -> _Tables:
    """Create the tables in the sizes of the preamble, and close it."""
    preamble.closed = True
    for keyword in _LISTS:
        if keyword not in preamble.names:
            raise _Fault(f"the file names no {keyword} before its first T, O or R")
    s, a, z = (len(preamble.names[keyword]) for keyword in _LISTS)
    if a * s * s * z > _ENTRIES:
        raise _Fault(
            f"{s} states, {a} actions and {z} observations make more than {_ENTRIES:.0e} "
            "entries of a dense table"
        )
    places = {key: {n: i for i, n in enumerate(names)} for key, names in preamble.names.items()}
    return _Tables(places, np.zeros((a, s, s)), np.zeros((a, s, z)), np.zeros((a, s, 1, 1)))


def _place(places: dict[str, int], kind: str, word: str) -> int | slice:
    if word == "*":
        return slice(None)
    if word in places:
        return places[word]
    if _is_count(word) and int(word[:9]) < len(places):
        return int(word[:9])
    raise _Fault(f"{word[:40]!r} is none of the {len(places)} {kind}")


def _is_count(word: str) -> bool:
    return word.isascii() and word.isdecimal()


def _numbers(words: list[str], count: int) -> _Floats:
    text = "".join(words)
    if "_" in text or not text.isascii():  # numbers to Python alone
        raise _Fault(f"expected {count} numbers (found {text[:40]!r})")
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise _Fault(f"expected {count} numbers ({error})") from error
    if len(values) != count or not np.isfinite(values).all():
        raise _Fault(f"found {len(values)} numbers; expected {count} finite ones")
    return values


def _finish(preamble: _Preamble, tables: _Tables) -> FlatPOMDP:
    if not 0 <= preamble.discount <= 1:
        raise _Fault("the file has no discount in [0, 1]")
    transition, observation = _rows("T", tables.T), _rows("O", tables.O)
    shape = (*transition.shape, observation.shape[-1])
    expected = tables.R[:, :, 0, 0].T
    if tables.R.shape == shape:  # (A,S,S,Z)
        expected = np.einsum("ast,atz,astz->sa", transition, observation, tables.R)
    if not np.isfinite(expected).all():
        raise _Fault("rewards are too large to add")
    return FlatPOMDP(
        state_names=preamble.names["states"],
        action_names=preamble.names["actions"],
        observation_names=preamble.names["observations"],
        transition=transition,
        observation=np.broadcast_to(observation[:, None], shape),
        reward=preamble.sign * expected,
        start=_start(*preamble.start, tables.places["states"]),
        discount=preamble.discount,
    )


def _rows(name: str, table: _Floats) -> _Floats:
    total = table.sum(axis=-1, keepdims=True)
    if (table < 0).any() or (np.abs(total - 1) > _ROUNDED).any():
        raise _Fault(f"rows of {name} must be probabilities that add to 1")
    table /= total
    return table


def _start(keyword: str, words: list[str], states: dict[str, int]) -> _Floats:
    """Read the belief before the first action: numbers, one state, or states alike."""
    if words == ["uniform"]:
        return np.full(len(states), 1 / len(states))
    if keyword == "start" and len(words) == len(states) and words[0] not in states:
        return _rows("start", _numbers(words, len(states)))
    if not words or (keyword == "start" and len(words) > 1):
        raise _Fault(f"start: expected a state, or {len(states)} numbers")
    chosen = np.zeros(len(states))
    for word in words:
        chosen[_place(states, "states", word)] = 1.0
    if keyword == "start exclude":
        chosen = 1 - chosen
    if not chosen.any():
        raise _Fault("start: no state is left to start in")
    return np.asarray(chosen / chosen.sum())
