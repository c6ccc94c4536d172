"""Labels that people gave between programs: a file beside the logs, a line of JSON a trial.

A learner that goes on keeps labels in its `Experience`, and `Learner.save` keeps that. Where every
question is a program of its own (`meal-bayes ask --learn`), this file is what is left in between.
"""

import json
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from meal_bayes.files import add_line, file_name, write_whole
from meal_bayes.learner.learner import Learner
from meal_bayes.untrusted import read_json

log = logging.getLogger("meal_bayes.learner")

_BYTES = "surrogateescape"  # bytes that are no UTF-8 stay as they are


class Remembered(NamedTuple):
    """What a person said of an object after one trial, and the path of its log."""

    object: str
    labels: dict[str, bool]
    log: str


class LabelMemory:
    """The labels that were given of one data set, the latest last."""

    def __init__(self, folder: Path, data: str) -> None:
        self.path = folder / f"labels-{file_name(data)}.jsonl"

    def read(self) -> list[Remembered]:
        """Read the labels in the order they were given; a line that holds none is left out."""
        entries = []
        for line, entry in self._lines():
            if entry is None:
                log.warning("left out of the memory: %.40s in %s", line, self.path)
            else:
                entries.append(entry)
        return entries

    def add(self, entry: Remembered) -> None:
        """Append the labels of one more trial."""
        add_line(self.path, json.dumps(entry._asdict()))

    def forget(self, name: str | None = None) -> int:
        """Remove the labels of an object, or all; return of how many trials they were.

        A line that holds no labels stays as it is.
        """
        lines = []
        forgotten = 0
        for line, entry in self._lines():
            if entry is not None and name in (None, entry.object):
                forgotten += 1
            else:
                lines.append(f"{line}\n")
        if forgotten:
            write_whole(self.path, "".join(lines).encode(errors=_BYTES))
        return forgotten

    def _lines(self) -> Iterator[tuple[str, Remembered | None]]:
        """Yield the lines of the file, with what each tells; None where it holds no labels."""
        content = self.path.read_bytes() if self.path.is_file() else b""
        text = content.decode("utf-8-sig", errors=_BYTES)
        for line in filter(str.strip, text.split("\n")):
            try:
                entry: Any = read_json(line)
                labels = dict(entry["labels"])
                told = Remembered(str(entry["object"]), labels, str(entry["log"]))
                yield line, told if all(isinstance(v, bool) for v in labels.values()) else None
            except (ValueError, TypeError, LookupError, AttributeError):
                yield line, None


def tell_remembered(learner: Learner, entries: list[Remembered]) -> None:
    """Tell a learner that replays a table what was said of its objects."""
    objects = () if learner.table is None else learner.table.objects
    for entry in entries:
        if entry.object in objects:
            learner.tell(entry.object, _of_domain(learner, entry.labels))


def _of_domain(learner: Learner, labels: Mapping[str, bool]) -> dict[str, bool]:
    """Return the labels that the learner's domain has attributes for: variants share a memory."""
    return {name: value for name, value in labels.items() if name in learner.domain.attributes}
