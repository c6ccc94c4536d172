"""Read the .policy of SARSOP (APPL's `pomdpsol`): alpha vectors in XML."""

import io
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import DataError, SettingsError
from meal_bayes.planners.point_based.alpha_vectors import AlphaVectors
from meal_bayes.untrusted import read_bytes

_NUMBERS = 2**25  # of all vectors, 256 MB
_INSIDE = {
    "Policy": "", "AlphaVector": "Policy", "Vector": "AlphaVector", "SparseVector": "AlphaVector",
    "Entry": "SparseVector",
}  # fmt: skip


def read_policy(path: str | Path) -> AlphaVectors:
    """Read a .policy file; vectors run over the hidden states, x over the observed ones.

    The file is hostile input: a document type (and with it every entity) is refused.

    Parameters
    ----------
    path : str | Path
        The file, of at most 256 MB.

    Raises
    ------
    SettingsError
        No such file.
    DataError
        A file that is not well formed, or too large.
    """
    path = Path(path)
    if not path.is_file():
        raise SettingsError(f"No file {path}; give the path of a .policy file.")
    try:
        text = read_bytes(path).decode("ascii")
        if "<!" in text:
            raise ValueError("it declares a document type; none is taken")  # noqa: TRY301
        return _vectors(text)
    except (ElementTree.ParseError, ValueError, LookupError, OSError) as fault:
        raise DataError(f"{path} is no policy of SARSOP ({fault}).") from fault


def _vectors(text: str) -> AlphaVectors:
    """Read the vectors one by one, so that no more than one is held as XML."""
    vectors, x, action = [], list[int](), list[int]()
    count = length = n_x = 0
    path: list[ElementTree.Element] = []
    for event, element in ElementTree.iterparse(io.StringIO(text), events=("start", "end")):
        tag = element.tag
        if event == "start":
            if _INSIDE.get(tag) != (path[-1].tag if path else ""):
                raise ValueError(f"<{tag[:40]}> stands where it does not belong")
            path.append(element)
            if tag == "Policy" and element.get("type", "value") != "value":
                raise ValueError("expected a policy of the type 'value'")
            if tag == "AlphaVector":
                if count:
                    raise ValueError("there is more than one <AlphaVector>")
                count, length, n_x = (
                    _whole(element.get(key, ""), key)
                    for key in ("numVectors", "vectorLength", "numObsValue")
                )
                if not 0 < count * length <= _NUMBERS:
                    raise ValueError(
                        f"{count} vectors of {length}; at most {_NUMBERS} numbers are read"
                    )
            continue
        path.pop()
        if tag in ("Vector", "SparseVector"):
            x.append(_whole(element.get("obsValue", ""), "obsValue"))
            action.append(_whole(element.get("action", ""), "action"))
            if len(x) > count or x[-1] >= n_x:
                raise ValueError("more vectors, or observed values, than it promises")
            vectors.append(_values(element, length, len(x)))
            path[-1].clear()  # what has been read
    if len(x) != count or not count:
        raise ValueError(f"found {len(x)} vectors; it promises {count}")
    return AlphaVectors(np.array(vectors), np.array(x), np.array(action))


def _values(element: ElementTree.Element, length: int, index: int) -> NDArray[np.float64]:
    """Read the values of a vector: all of them, or those that are not 0 with their places."""
    if element.tag == "Vector":
        values = np.array((element.text or "").split(), dtype=np.float64)
    else:
        values = np.zeros(length)
        for entry in element:
            place, value = (entry.text or "").split()
            values[_whole(place, "the place of a value")] = float(value)
    if values.shape != (length,) or not np.isfinite(values).all():
        raise ValueError(f"vector {index} has {len(values)} values; expected {length} finite ones")
    return values


def _whole(text: str, key: str) -> int:
    if not text.isdecimal() or len(text) > 9:  # digits
        raise ValueError(f"{key} is {text[:40]!r}; expected a number, 0 or more")
    return int(text)
