"""What people told a robot about objects: kept in the logs of the trials they spoke of.

A log whose header has `told` remembers; the folder of logs is the memory, and nothing else is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from meal_bayes.errors import LogError
from meal_bayes.trial_log.reader import read_header, read_trials
from meal_bayes.trial_log.writer import write_trials

_NAMES = "ask-*.mcap"


@dataclass(frozen=True, slots=True)
class Told:
    """What a person told of one object, in one trial."""

    number: int  # rises with every trial of the memory; of two words the later one holds
    object_name: str
    values: Mapping[str, bool]  # by attribute
    path: Path  # of the log


def write_told(told: Told) -> None:
    """Put what was told into the log of its trial."""
    words = {"number": told.number, "object": told.object_name, "values": dict(told.values)}
    _rewrite(told.path, {"told": words})


def read_memory(folder: str | Path, data: str) -> list[Told]:
    """Read what was told of a data set's objects, in the order it was said.

    Parameters
    ----------
    folder : of the logs; one that is not there remembers nothing.
    data : the data set's name.

    Raises
    ------
    LogError : a log that cannot be read; recover it, or take it away.
    """
    found = []
    for path in sorted(Path(folder).glob(_NAMES)):
        header = read_header(path)
        words = header.get("told")
        if isinstance(words, dict) and header.get("data") == data:
            found.append(_told(words, path))
    return sorted(found, key=lambda told: told.number)


def forget(memory: Sequence[Told]) -> int:
    """Forget what was told; the trials stay in their logs. Return how many logs that were."""
    for told in memory:
        _rewrite(told.path, {})
    return len(memory)


def _told(words: Mapping[str, object], path: Path) -> Told:
    number, name, values = (words.get(key) for key in ("number", "object", "values"))
    if (
        not isinstance(number, int)
        or not isinstance(name, str)
        or not isinstance(values, dict)
        or not all(isinstance(value, bool) for value in values.values())
    ):
        raise LogError(f"{path} says what was told in a way that cannot be read; remove it.")
    return Told(number, name, values, path)


def _rewrite(path: Path, words: Mapping[str, object]) -> None:
    """Write a log anew with other words in its header."""
    kept = {k: v for k, v in read_header(path).items() if k not in ("told", "versions")}
    write_trials(path, list(read_trials(path)), header={**kept, **words})
