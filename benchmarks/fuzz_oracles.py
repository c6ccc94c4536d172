"""Read a file as the package does, and compare with an independent reading of the same bytes.

A reader may refuse with an error of the package, or give what the bytes say. Logs and tables carry
checksums: what they give must be what was written. Of text that people write, a digit may
have become another one, which nobody can see; there the values must be those of a second reading
that is written here, and nothing that the format does not allow may pass.
"""

import csv
import dataclasses
import io
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
from meal_bayes.errors import MealBayesError
from meal_bayes.momdp import read_pomdp
from meal_bayes.planners.point_based.policy_file import read_policy
from meal_bayes.trial_log import Logs, check_log, log_info, read_outcomes, read_trials, salvage

_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)


class Wrong(Exception):
    """What was read is not what the file says."""


Reader = Callable[[Path], None]  # raises `Wrong`, or what the package raises


def readers(kind: str, sound: Path) -> tuple[Reader, ...]:  # noqa: PLR0911  one a kind
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
    if kind == "pomdp":
        return (_check_pomdp,)
    return _POMDPX


def _refused(read: Callable[[Path], object]) -> Reader:
    """Make the reading of a file that is of another kind: it must be refused."""

    def check(path: Path) -> None:
        read(path)
        raise Wrong(f"{read.__module__}.{read.__name__} takes it")

    return check


# The package writes .pomdpx for SARSOP and reads none: whichever reader gets one must refuse it.
_POMDPX = tuple(
    map(
        _refused, (read_policy, read_pomdp, log_info, read_outcomes, lambda p: list(read_trials(p)))
    )
)


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
    told, found = tomllib.loads(path.read_bytes().decode("utf-8-sig")), domain_table(domain)
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


def _check_pomdp(path: Path) -> None:
    found = read_pomdp(path)
    for rows in (found.transition, found.observation):
        if (rows < 0).any() or not np.allclose(rows.sum(axis=-1), 1):
            raise Wrong("rows that are no probabilities")
    if not (0 <= found.discount <= 1 and np.isfinite(found.reward).all()):
        raise Wrong("a discount or reward that is none")
    for (action, source, target), value in _transitions(path, found).items():
        if not np.allclose(found.transition[action, source, target], value, atol=1e-4):
            raise Wrong(f"T[{action},{source},{target}]; the file says {value}")


def _transitions(path: Path, found: Any) -> dict[tuple[int, int, int], float]:
    """Read the T statements of one line, the way the package writes them; later ones count."""
    text = path.read_bytes().decode("utf-8-sig")
    places = [
        {name: i for i, name in enumerate(names)}
        for names in (found.action_names, found.state_names, found.state_names)
    ]
    cells: dict[tuple[int, int, int], float] = {}
    for line in text.split("\n"):
        words = line.partition("#")[0].replace(":", " : ").split()
        plain = len(words) == 8 and words[0] == "T" and [words[i] for i in (1, 3, 5)] == [":"] * 3
        if words[:1] == ["T"] and not plain:
            return {}  # not as the package writes them
        if plain:
            indices = [
                range(len(place)) if word == "*" else [place.get(word, -1)]
                for place, word in zip(places, (words[2], words[4], words[6]), strict=True)
            ]
            cells.update(
                ((a, s, t), float(words[7]))
                for a in indices[0]
                for s in indices[1]
                for t in indices[2]
            )
    return {} if any(min(cell) < 0 for cell in cells) else cells


def refused(fault: BaseException) -> bool:
    """Whether a fault is the package's own way to say no, in one printable line."""
    return isinstance(fault, MealBayesError)
