"""What people told a robot about objects: kept in the logs of the trials they spoke of.

A log whose header has `told` remembers; the folder of logs is the memory, and nothing else is.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log.reader import read_header
from meal_bayes.trial_log.salvage import salvage
from meal_bayes.trial_log.writer import read_seconds, write_trials

log = logging.getLogger("meal_bayes.trial_log")
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

    A log that is empty, torn or of another format is left out with a warning.

    Parameters
    ----------
    folder : of the logs; one that is not there remembers nothing.
    data : the data set's name.
    """
    found = []
    for path in sorted(Path(folder).glob(_NAMES)):
        try:
            header = read_header(path)
            words = header.get("told")
            if isinstance(words, dict) and header.get("data") == data:
                found.append(_told(words, path))
        except LogError as fault:
            log.warning("left out of the memory: %s (move the file away to silence this)", fault)
    return sorted(found, key=lambda told: told.number)


def forget(memory: Sequence[Told]) -> int:
    """Forget what was told; the trials stay in their logs. Return how many logs that were.

    Of a torn log the whole trials stay. One that holds none is left as it is, with a warning.
    """
    forgotten = 0
    for told in memory:
        try:
            _rewrite(told.path, {})
            forgotten += 1
        except LogCorruptError:
            log.warning("%s holds no whole trial; remove it to forget what it was told", told.path)
    return forgotten


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
    """Write a log anew with other words in its header; of a torn one its whole trials."""
    kept = {k: v for k, v in read_header(path).items() if k not in ("told", "versions")}
    trials = list(salvage(path))
    if not trials:
        raise LogCorruptError(f"{path} holds no whole trial")
    write_trials(path, trials, header={**kept, **words}, seconds=read_seconds(path))
