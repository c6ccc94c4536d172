"""Read a file as the package does, and compare with an independent reading of the same bytes.

A reader may refuse with an error of the package, or give what the bytes say. Logs and tables carry
checksums: what they give must be what was written. Of text that people write, a digit may
have become another one, which nobody can see; there the values must be those of a second reading
that is written here, and nothing that the format does not allow may pass.
"""

import csv
import dataclasses
import io
import json
import math
import pickle
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.csv_folder import load_csv_folder
from meal_bayes.domain import load_domain
from meal_bayes.domain.tables import domain_table
from meal_bayes.trial_log import Logs, check_log, log_info, read_outcomes, read_trials, salvage

_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)


class Wrong(Exception):
    """What was read is not what the file says."""


Reader = Callable[[Path], None]  # raises `Wrong`, or what the package raises


def readers(kind: str, sound: Path) -> tuple[Reader, ...]:
    """Return the readings of a kind of file; `sound` is the undamaged one."""
    if kind == "log":
        trials = [pickle.dumps(trial) for trial in read_trials(sound)]
        return (
            lambda path: _check_trials(path, trials),
            lambda path: _check_salvage(path, trials),
            lambda path: _check_info(path, len(trials)),
            lambda path: _check_check(path, trials),
        )
    if kind == "table":
        table = pickle.dumps(load_percepts(sound))
        return (lambda path: _check_same(pickle.dumps(load_percepts(path)), table),)
    if kind == "outcomes":
        outcomes, trials = repr(dataclasses.astuple(read_outcomes(sound))), log_info(sound).trials
        return (
            lambda path: _check_same(repr(dataclasses.astuple(read_outcomes(path))), outcomes),
            lambda path: _check_info(path, trials),
            lambda path: _check_salvaged(path, trials),
        )
    if kind in ("csv", "labels"):
        return (_check_csv,)
    if kind == "toml":
        return (_check_toml,)
    return _WRITTEN_ONLY


def _refused(read: Callable[[Path], object]) -> Reader:
    """Make the reading of a file that is of another kind: it must be refused."""

    def check(path: Path) -> None:
        read(path)
        raise Wrong(f"{read.__module__}.{read.__name__} takes it")

    return check


# The package writes .pomdp and .pomdpx and reads neither: whichever reader gets one must refuse it.
_WRITTEN_ONLY = tuple(map(_refused, (log_info, read_outcomes, lambda p: list(read_trials(p)))))


def _check_same(found: object, expected: object) -> None:
    if found != expected:
        raise Wrong("it is not what was written")


def _check_trials(path: Path, trials: list[bytes]) -> None:
    given = 0
    for given, trial in enumerate(read_trials(path), 1):
        if given > len(trials) or pickle.dumps(trial) != trials[given - 1]:
            raise Wrong(f"trial {given - 1} is another")
    if given != len(trials):
        raise Wrong(f"{given} of {len(trials)} trials, and no word")


def _check_salvage(path: Path, trials: list[bytes]) -> None:
    known = iter(trials)
    for trial in salvage(path):
        packed = pickle.dumps(trial)
        if not any(packed == other for other in known):
            raise Wrong("a trial that nobody wrote, or one twice")
    logs = Logs(path)
    count = sum(1 for _ in logs.trials())
    if count != len(trials) and not logs.problems:
        raise Wrong(f"{count} of {len(trials)} trials, and no problem told")


def _check_salvaged(path: Path, trials: int) -> None:
    if sum(len(part) for part in salvage(path)) > trials:
        raise Wrong("outcomes twice, or that nobody wrote")


def _check_info(path: Path, trials: int) -> None:
    if (found := log_info(path).trials) != trials:
        raise Wrong(f"{found} trials, not {trials}")


def _check_check(path: Path, trials: list[bytes]) -> None:
    report = check_log(path)
    if report.whole and report.trials != len(trials):
        raise Wrong(f"whole, with {report.trials} trials")


def _check_csv(path: Path) -> None:
    folder = path.parent
    domain = load_domain(folder / "own.toml")
    dataset = load_csv_folder(domain, folder)
    labels = {row[0]: row[1:] for row in _rows(folder / "labels.csv")}
    names = labels.pop("object")
    for o, name in enumerate(dataset.objects):
        for p, attribute in enumerate(domain.attributes):
            cell = labels[name][names.index(attribute)]
            if cell not in ("1", "0", "") or dataset.labels[o, p] != int(cell or -1):
                raise Wrong(f"label {attribute} of {name} is {cell!r}")
    for (behavior, modality), values in dataset.features.items():
        rows = {tuple(row[:2]): row[2:] for row in _rows(folder / f"{behavior}_{modality}.csv")}
        rows.pop(("object", "recording"))
        own = {name: sorted(r for o, r in rows if o == name) for name in dataset.objects}
        if sum(map(len, own.values())) != len(rows):
            raise Wrong("rows of objects that are not there")
        for o, name in enumerate(dataset.objects):
            for r, recording in enumerate(sorted(own[name], key=lambda text: (len(text), text))):
                _check_cells(rows[name, recording], values[o, r])


def _rows(path: Path) -> Iterator[list[str]]:
    """Read rows by the standard library's reader, strictly."""
    text = path.read_bytes().decode("utf-8-sig")
    for line in text.split("\n"):
        if line.strip():
            yield [
                cell.strip() for cell in next(csv.reader(io.StringIO(line.strip()), strict=True))
            ]


def _check_cells(cells: list[str], values: Any) -> None:
    if len(cells) != len(values) or not all(map(_NUMBER.fullmatch, cells)):
        raise Wrong(f"cells {cells} became {values}")
    if not np.array_equal(np.array(cells, np.float64).astype(np.float32), values):
        raise Wrong(f"cells {cells} became {values}")


def _check_toml(path: Path) -> None:
    domain = load_domain(path)
    told = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    found = json.loads(json.dumps(domain_table(domain)))  # lists, as a file has them
    for behavior in domain.behaviors:
        if not 0 <= behavior.cost < math.inf:
            raise Wrong(f"cost {behavior.cost}")
    rows = [*told.pop("behaviors", ()), *told.get("diagram", {}).pop("effects", ())]
    for row, other in zip(rows, [*found["behaviors"], *found["diagram"]["effects"]], strict=True):
        for key, value in row.items():
            if other[key] != value:
                raise Wrong(f"{key} is {other[key]!r}, the file says {value!r}")
    for table, other in ((told.pop("diagram", {}), found["diagram"]), (told, found)):
        for key, value in table.items():
            if key not in ("extends", "note") and other[key] != value:
                raise Wrong(f"{key} is {other[key]!r}, the file says {value!r}")
