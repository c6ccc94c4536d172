"""Labels of objects from people: kept in the headers of the logs of the trials they belong to.

The folder of logs is the memory: its logs whose headers have `labels`.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log.reader import read_header
from meal_bayes.trial_log.recovery import salvage
from meal_bayes.trial_log.writer import read_seconds, write_trials

log = logging.getLogger("meal_bayes.trial_log")
_NAMES = "ask-*.mcap"


@dataclass(frozen=True, slots=True)
class ObjectLabels:
    """Labels of one object, from a person, in one trial."""

    number: int  # rises with every trial of the memory; of two labels the later one holds
    object_name: str
    values: Mapping[str, bool]  # by attribute
    path: Path  # of the log


def write_labels(labels: ObjectLabels) -> None:
    """Write labels into the log of their trial."""
    facts = {"number": labels.number, "object": labels.object_name, "values": dict(labels.values)}
    _rewrite(labels.path, {"labels": facts})


def read_memory(folder: str | Path, data: str) -> list[ObjectLabels]:
    """Read the labels of a data set's objects, in the order they were given.

    A log that is empty, torn or of another format is left out with a warning.

    Parameters
    ----------
    folder : str | Path
        Of the logs; one that is not there remembers nothing.
    data : str
        The data set's name.
    """
    memory = []
    for path in sorted(Path(folder).glob(_NAMES)):
        try:
            header = read_header(path)
            facts = header.get("labels")
            if isinstance(facts, dict) and header.get("data") == data:
                number, name, values = (facts[key] for key in ("number", "object", "values"))
                memory.append(ObjectLabels(number, name, values, path))
        except LogError as fault:
            log.warning("left out of the memory: %s (move the file away to silence this)", fault)
    return sorted(memory, key=lambda labels: labels.number)


def forget(memory: Sequence[ObjectLabels]) -> int:
    """Remove labels; the trials stay in their logs. Return how many logs that were.

    Of a torn log the whole trials stay. One that holds none is left as it is, with a warning.
    """
    forgotten = 0
    for labels in memory:
        try:
            _rewrite(labels.path, {})
            forgotten += 1
        except LogCorruptError:
            log.warning("%s holds no whole trial; remove it to forget its labels", labels.path)
    return forgotten


def _rewrite(path: Path, facts: Mapping[str, object]) -> None:
    """Write a log anew with other labels in its header; of a torn one its whole trials."""
    header = {k: v for k, v in read_header(path).items() if k not in ("labels", "versions")}
    trials = list(salvage(path))
    if not trials:
        raise LogCorruptError(f"{path} holds no whole trial")
    write_trials(path, trials, header={**header, **facts}, seconds=read_seconds(path))
