"""Labels that people gave between programs: logs of feedback in a folder of their own.

A learner that goes on has labels in its `Experience`, logs them, and `Learner.save` keeps them.
Where every question is a program of its own (`meal-bayes ask --learn`), these logs are what is left
in between.
"""

import logging
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

from meal_bayes.files import file_name
from meal_bayes.learner.learner import Learner
from meal_bayes.trial_log import Feedback
from meal_bayes.trial_log.folder import feedback_files, readable_feedback, write_feedback

log = logging.getLogger("meal_bayes.learner")


class Remembered(NamedTuple):
    """What a person said of an object after one trial."""

    object: str
    labels: dict[str, bool]

    @property
    def text(self) -> str:
        """The labels in words, such as "heavy, not beans"."""
        return Feedback(self.object, self.labels).text


class LabelMemory:
    """The labels that were given of one data set, the latest last."""

    def __init__(self, folder: Path, data: str) -> None:
        self.folder = folder / f"labels-{file_name(data)}"
        self._data = data

    def read(self) -> list[Remembered]:
        """Read the labels that hold in the order they were given; what is torn is left out."""
        remembered = list[Remembered]()
        left_out = partial(log.warning, "left out of the memory: %s")
        for feedback in readable_feedback(feedback_files(self.folder), left_out):
            withdrawn = [name for name, label in feedback.labels.items() if label < 0]
            earlier = [entry for entry in remembered if entry.object == feedback.object_name]
            for entry in earlier:
                for name in withdrawn:
                    entry.labels.pop(name, None)
            labels = {name: label == 1 for name, label in feedback.labels.items() if label >= 0}
            remembered.append(Remembered(feedback.object_name, labels))
        return [entry for entry in remembered if entry.labels]

    def add(self, name: str, labels: Mapping[str, bool]) -> None:
        """Write what was told of an object."""
        self._write(Feedback(name, {attribute: int(label) for attribute, label in labels.items()}))

    def forget(self, name: str | None = None) -> int:
        """Take the labels of an object back, or all; return of how many trials they were."""
        entries = [entry for entry in self.read() if name in (None, entry.object)]
        attributes_of = dict[str, set[str]]()
        for entry in entries:
            attributes_of.setdefault(entry.object, set()).update(entry.labels)
        for object_name, attributes in attributes_of.items():
            self._write(Feedback(object_name, dict.fromkeys(sorted(attributes), -1)))
        return len(entries)

    def _write(self, feedback: Feedback) -> None:
        header = {"config": {"command": "ask --learn"}, "data": self._data}
        write_feedback(self.folder, feedback, header=header)


def tell_remembered(learner: Learner, entries: list[Remembered]) -> None:
    """Tell a learner that replays a table what was said of its objects."""
    objects = () if learner.table is None else learner.table.objects
    for entry in entries:
        if entry.object in objects:
            learner.tell(entry.object, _of_domain(learner, entry.labels))


def _of_domain(learner: Learner, labels: Mapping[str, bool]) -> dict[str, bool]:
    """Return the labels that the learner's domain has attributes for: variants share a memory."""
    return {name: value for name, value in labels.items() if name in learner.domain.attributes}
