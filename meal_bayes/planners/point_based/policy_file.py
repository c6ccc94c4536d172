"""Read the .policy of SARSOP (APPL's `pomdpsol`): alpha vectors in XML."""

from pathlib import Path
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import DataError, SettingsError
from meal_bayes.planners.point_based.alpha_vectors import AlphaVectors

_LARGEST = 2**28  # bytes of a file
_NUMBERS = 2**25  # of all vectors, 256 MB
_DIGITS = 64  # characters of a number, at most
_DEPTH = {"Policy": 0, "AlphaVector": 1, "Vector": 2, "SparseVector": 2, "Entry": 3}


def read_policy(path: str | Path) -> AlphaVectors:
    """Read a .policy file; vectors run over the hidden states, x over the observed ones.

    The file is hostile input: a document type (and with it every entity) is refused.

    Raises
    ------
    SettingsError : no such file.
    DataError : a file that is not well formed, or too large.
    """
    path = Path(path)
    if not path.is_file():
        raise SettingsError(f"No file {path}; give the path of a .policy file.")
    if path.stat().st_size > _LARGEST:
        raise DataError(f"{path} has more than {_LARGEST // 2**20} MB; stop the solver earlier.")
    reader = _Reader()
    try:
        with path.open("rb") as file:
            reader.parser.ParseFile(file)
        return reader.finish()
    except (expat.ExpatError, ValueError, LookupError) as fault:
        line = reader.parser.CurrentLineNumber
        raise DataError(f"{path} is no policy of SARSOP (line {line}: {fault}).") from fault


class _Reader:
    """Handlers of expat that collect the vectors of a file."""

    def __init__(self) -> None:
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartDoctypeDeclHandler = self._refuse
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._append
        self.open: list[str] = []
        self.shape = (0, 0, 0)  # vectors, values of each, x
        self.text: list[str] = []
        self.capacity = 0  # characters left of the text
        self.vectors: list[NDArray[np.float64]] = []
        self.x: list[int] = []
        self.action: list[int] = []

    def finish(self) -> AlphaVectors:
        """Check the count."""
        if len(self.vectors) != self.shape[0] or not self.vectors:
            raise ValueError(f"found {len(self.vectors)} vectors; it promises {self.shape[0]}")
        return AlphaVectors(np.array(self.vectors), np.array(self.x), np.array(self.action))

    def _refuse(self, *_: object) -> None:
        raise ValueError("it declares a document type; none is taken")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if _DEPTH.get(name) != len(self.open):
            raise ValueError(f"<{name[:40]}> stands where it does not belong")
        self.open.append(name)
        if name == "Policy" and attributes.get("type", "value") != "value":
            raise ValueError("expected a policy of the type 'value'")
        if name == "AlphaVector":
            count, length, n_x = (
                _count(attributes, key) for key in ("numVectors", "vectorLength", "numObsValue")
            )
            if self.shape[0] or not 0 < count * length <= _NUMBERS:
                raise ValueError(
                    f"{count} vectors of {length}; at most {_NUMBERS} numbers are read"
                )
            self.shape = (count, length, n_x)
        elif name in ("Vector", "SparseVector"):
            x = _count(attributes, "obsValue")
            if len(self.vectors) == self.shape[0] or x >= self.shape[2]:
                raise ValueError("more vectors, or observed values, than it promises")
            self.vectors.append(np.zeros(self.shape[1]))
            self.x.append(x)
            self.action.append(_count(attributes, "action"))
        if name in ("Vector", "Entry"):
            self.text, self.capacity = [], _DIGITS * (1 + self.shape[1])

    def _append(self, text: str) -> None:
        if self.open[-1:] in (["Vector"], ["Entry"]):
            self.text.append(text)
            self.capacity -= len(text)
            if self.capacity < 0:
                raise ValueError(f"a vector is longer than {self.shape[1]} numbers can be")
        elif text.strip():
            raise ValueError(f"text {text.strip()[:40]!r} stands where none belongs")

    def _end(self, name: str) -> None:
        self.open.pop()
        if name == "Vector":
            values = np.array("".join(self.text).split(), dtype=np.float64)
            if values.shape != (self.shape[1],) or not np.isfinite(values).all():
                raise ValueError(
                    f"found {len(values)} values; expected {self.shape[1]} finite ones"
                )
            self.vectors[-1][:] = values
        elif name == "Entry":
            place, value = "".join(self.text).split()
            self.vectors[-1][_place(place, self.shape[1])] = _finite(value)


def _count(attributes: dict[str, str], key: str) -> int:
    text = attributes.get(key, "")
    if not text.isdecimal() or len(text) > 9:  # digits
        raise ValueError(f"{key} is {text[:40]!r}; expected a number, 0 or more")
    return int(text)


def _place(text: str, length: int) -> int:
    if not text.isdecimal() or int(text[:9]) >= length:
        raise ValueError(f"a value of state {text[:40]!r}; there are {length}")
    return int(text[:9])


def _finite(text: str) -> float:
    value = float(text)
    if not np.isfinite(value):
        raise ValueError(f"the value {text[:40]!r} is not finite")
    return value
