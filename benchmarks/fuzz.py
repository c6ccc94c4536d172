"""Damage files of every kind that the package reads, by hypothesis, and read them.

A reading may refuse a file with an error of the package, or give what the bytes say. Logs and
tables carry checksums: what they give must be what was written. Of text that people write, a digit
may have become another one, which nobody can see; there the values must be those of a second
reading that is written here. `silent` counts results that are not what the file says, `hangs`
readings that took more than five seconds of CPU, `tracebacks` everything that is raised and is not
one of the package's errors, or that the command line would not tell in one line, `changed` files
that are not what they were.
"""

import csv
import hashlib
import json
import math
import os
import pickle
import re
import signal
import sys
import tempfile
import time
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable
from functools import partial
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner
from hypothesis import Phase, given, seed, settings
from hypothesis import strategies as st
from measuring import options_of, peak_mb, show

from meal_bayes.cli import main as program
from meal_bayes.datasets import load_percepts, make_synthetic
from meal_bayes.datasets.csv_files import load_csv_folder, save_csv_folder
from meal_bayes.datasets.percepts import BIN_EDGES, PerceptTable, save_percepts
from meal_bayes.domain import load_domain
from meal_bayes.domain.tables import domain_table
from meal_bayes.errors import MealBayesError
from meal_bayes.experiments import offline_tasks
from meal_bayes.learner import Learner
from meal_bayes.trial_log import (
    Logs,
    check_log,
    log_info,
    read_outcomes,
    read_trials,
    salvage,
    write_trials,
)
from meal_bayes.trials import TrialOutcomes

FILES = {  # kind: the file that is damaged
    "log": "run.mcap",
    "outcomes": "outcomes.mcap",
    "table": "own.npz",
    "csv": "look_color.csv",
    "labels": "labels.csv",
    "toml": "own.toml",
}
OBJECTS = 6
RECORDINGS = 3
TRIALS = 6


def make_sound(folder: Path) -> None:
    """Write one sound file of every kind."""
    shipped = resources.files("meal_bayes") / "domain/tables/toy.toml"
    text = shipped.read_text(encoding="utf-8").replace('name = "toy"', 'name = "own"')
    (folder / FILES["toml"]).write_text(text, encoding="utf-8")
    domain = load_domain(folder / FILES["toml"])
    rng = np.random.default_rng(5)
    dataset = make_synthetic(domain, objects=OBJECTS, recordings=RECORDINGS, rng=rng)
    save_csv_folder(dataset, folder)
    shape = (OBJECTS, RECORDINGS, len(domain.behaviors), len(domain.attributes))
    bins = np.zeros((OBJECTS, OBJECTS, shape[3], shape[2], len(BIN_EDGES) + 1), np.uint8)
    odds = rng.normal(0, 2, shape)
    percepts = PerceptTable(
        domain,
        dataset.objects,
        dataset.labels,
        log_odds=odds,
        edges=BIN_EDGES,
        training_bins=bins,
        provenance={},
    )
    save_percepts(percepts, folder / FILES["table"])
    learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    tasks = offline_tasks(load_percepts("roc36"), 2, TRIALS, 0)
    trials = [learner.ask(task) for task in tasks]
    header = {"config": {"dataset": "roc36"}}
    write_trials(folder / FILES["log"], trials, header=header)
    write_trials(folder / FILES["outcomes"], [TrialOutcomes.of(trials)], header=header)


COMMANDS = {
    "log": (("log", "check"), ("log", "info", "--json"), ("log", "show"),
            ("log", "recover", "--out", "out.mcap", "--json"), ("report", "-o", "out.html")),
    "table": (("data", "list"), ("memory", "show", "--dataset")),
    "toml": (("ask", "red", "--object", "a", "--dataset"), ("data", "list")),
}  # fmt: skip
FAULTS = ("silent", "hangs", "tracebacks", "changed")
PATIENCE = 5.0  # s of CPU
MEMORY = 500.0  # MB
EVERY = 10  # of so many inputs one goes through the command line too
SHOWN = 20  # faults that are told
TOKENS = [
    *(sign.encode() for sign in "\"'[]{},;:\n\r\t#=*<>&-. \0\u0663\ufeff"),
    *b"nan inf -inf 1e999 3_4 0x10 uniform \xff \x1b[31m".split(),
    b"9" * 400,
]  # fmt: skip

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)

Reading = Callable[[Path], object]


class Wrong(Exception):
    """What was read is not what the file says."""


class Hang(BaseException):
    """Raised by the clock; no `Exception`, so that no reader takes it for a fault of its own."""


class Tally:
    """Count inputs and faults, and keep the words of some."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.told: list[str] = []

    def note(self, fault: str, text: str) -> None:
        """Count one fault."""
        self.counts[fault] += 1
        if len(self.told) < SHOWN:
            self.told.append(f"{fault}: {text}")

    def run(self, name: str, reading: Reading, path: Path) -> None:
        """Read a file under the clock; the other files of its folder must stay as they are."""
        before = digests(path.parent)
        begin = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, PATIENCE)
        try:
            reading(path)
        except (Hang, MealBayesError):
            pass
        except Wrong as fault:
            self.note("silent", f"{name}: {fault}")
        except Exception as fault:
            self.note("tracebacks", f"{name}: {type(fault).__name__}: {str(fault)[:200]}")
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        if time.process_time() - begin > PATIENCE:
            self.note("hangs", name)
        if digests(path.parent) != before:
            self.note("changed", name)
        if peak_mb() > MEMORY and not self.counts["memory"]:
            self.note("memory", f"{name}: {peak_mb():.0f} MB")


def digests(folder: Path) -> dict[str, bytes]:
    """Return a digest of every file, but of those that commands write as they were told."""
    paths = [path for path in folder.iterdir() if not path.name.startswith("out.")]
    return {path.name: hashlib.sha256(path.read_bytes()).digest() for path in paths}


@st.composite
def damages(draw: st.DrawFn, data: bytes) -> bytes:
    """Draw a damaged copy: a bit, a cut, a hole, a block twice or left out, a token, a tail."""
    begin = draw(st.integers(0, len(data) - 1))
    end = min(len(data), begin + draw(st.sampled_from((1, 2, 5, 30, 300, 3000))))
    span = data[begin:end]
    rest = data[end:]
    kind = draw(st.sampled_from(("bit", "cut", "hole", "twice", "without", "token", "tail")))
    if kind == "bit":
        flipped = data[begin] ^ 1 << draw(st.integers(0, 7))
        return data[:begin] + bytes([flipped]) + data[begin + 1 :]
    if kind == "token":
        width = draw(st.sampled_from((0, 1, 3)))
        return data[:begin] + draw(st.sampled_from(TOKENS)) + data[begin + width :]
    if kind == "tail":
        return data + draw(st.sampled_from((bytes(100), data[-50:], b"\n1,2,3\n", b"x = 1\n")))
    middle = {"cut": b"", "hole": bytes(end - begin), "twice": span + span, "without": b""}[kind]
    return data[:begin] + middle + (b"" if kind == "cut" else rest)


def readings(kind: str, sound: Path) -> tuple[Reading, ...]:
    """Return the readings of a kind of file; `sound` is the undamaged one."""
    if kind == "log":
        trials = [pickle.dumps(trial) for trial in read_trials(sound)]
        return tuple(partial(check, trials) for check in (check_trials, check_salvage, check_facts))
    if kind == "outcomes":
        whole = pickle.dumps(read_outcomes(sound))
        facts = partial(check_facts, range(TRIALS))
        return lambda path: require(pickle.dumps(read_outcomes(path)) == whole, "others"), facts
    if kind == "table":
        whole = pickle.dumps(load_percepts(sound))
        return (lambda path: require(pickle.dumps(load_percepts(path)) == whole, "another table"),)
    return (check_domain,) if kind == "toml" else (check_csv,)


def require(true: bool, otherwise: str) -> None:
    """Raise `Wrong` where something does not hold."""
    if not true:
        raise Wrong(otherwise)


def check_trials(trials: list[bytes], path: Path) -> None:
    """Read trials in order: those that were written, all of them, or an error."""
    number = -1
    for number, trial in enumerate(read_trials(path)):
        require(pickle.dumps(trial) in trials[number : number + 1], f"trial {number} is another")
    require(number + 1 == len(trials), f"{number + 1} of {len(trials)} trials, and no word")


def check_salvage(trials: list[bytes], path: Path) -> None:
    """Salvage what was written, in its order; who reads logs is told what is missing."""
    left = iter(trials)
    for trial in salvage(path):
        require(pickle.dumps(trial) in left, "a trial that nobody wrote, or one twice")
    logs = Logs(path)
    number = sum(len(group.outcomes) for group in logs.groups())
    require(number == len(trials) or bool(logs.problems), f"{number} trials, and no problem told")


def check_facts(trials: list[bytes], path: Path) -> None:
    """Count trials without reading them."""
    report = check_log(path)
    require(not report.whole or report.trials == len(trials), f"whole, of {report.trials} trials")
    number = log_info(path).trials
    require(number == len(trials), f"{number} of {len(trials)} trials")


def check_csv(path: Path) -> None:
    """Compare a folder of features and labels with its rows, read by the standard library."""
    domain = load_domain(path.with_name(FILES["toml"]))
    dataset = load_csv_folder(domain, path.parent)
    (_, *names), *rows = rows_of(path.with_name(FILES["labels"]))
    labels = {name: dict(zip(names, cells, strict=True)) for name, *cells in rows}
    for (o, name), (p, attribute) in product(
        enumerate(dataset.objects), enumerate(domain.attributes)
    ):
        cell = labels[name][attribute]
        right = cell in ("1", "0", "") and dataset.labels[o, p] == int(cell or -1)
        require(right, f"label {attribute} of {name} is {cell!r}")
    for (behavior, modality), values in dataset.features.items():
        _, *rows = rows_of(path.with_name(f"{behavior}_{modality}.csv"))
        require({row[0] for row in rows} <= set(dataset.objects), "rows of unknown objects")
        for o, name in enumerate(dataset.objects):
            mine = sorted((int(r), cells) for other, r, *cells in rows if other == name)
            for r, (_, cells) in enumerate(mine):
                require(all(map(NUMBER.fullmatch, cells)), f"cells {cells} are read")
                numbers = np.array(cells, np.float64).astype(np.float32)
                require(np.array_equal(numbers, values[o, r]), f"other numbers than {cells}")


def rows_of(path: Path) -> list[list[str]]:
    """Read the rows of a CSV file strictly."""
    lines = path.read_bytes().decode("utf-8-sig").split("\n")
    rows = csv.reader((line.strip() for line in lines if line.strip()), strict=True)
    return [[cell.strip() for cell in row] for row in rows]


def check_domain(path: Path) -> None:
    """Compare a domain with the table that the standard library reads."""
    domain = load_domain(path)
    require(all(0 <= behavior.cost < math.inf for behavior in domain.behaviors), "a cost")
    table = json.loads(json.dumps(domain_table(domain)))  # lists, as a file has them
    check_same(tomllib.loads(path.read_bytes().decode("utf-8-sig")), table, "the table")


def check_same(told: Any, value: Any, name: str) -> None:
    """Compare what a file tells with what was read of it, which has defaults besides."""
    if isinstance(told, dict) and isinstance(value, dict):
        for key in told.keys() - {"extends", "note"}:
            check_same(told[key], value.get(key), key)
    elif isinstance(told, list) and isinstance(value, list) and len(told) == len(value):
        for part, other in zip(told, value, strict=True):
            check_same(part, other, name)
    else:
        require(told == value, f"{name} is {value!r}, the file says {told!r}")


def command(arguments: tuple[str, ...], path: Path) -> None:
    """Call the command line, which must end with 0, 1 or 2 and at most one line of error."""
    result = CliRunner().invoke(program, [*arguments, str(path)])
    for out in path.parent.glob("out.*"):
        out.unlink()
    errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    printable = all(sign.isprintable() or sign == "\n" for sign in result.output)
    raised = result.exception is not None and not isinstance(result.exception, SystemExit)
    if raised or result.exit_code not in (0, 1, 2, 3) or len(errors) > 1 or not printable:
        told = f"{result.exit_code}, {result.exception!r}, {result.output[:200]!r}"
        raise RuntimeError(f"{' '.join(arguments)} ends with {told}")


def fuzz(kind: str, inputs: int, number: int, folder: Path, tally: Tally) -> None:
    """Damage the file of one kind over and over."""
    path = folder / FILES[kind]
    whole = path.read_bytes()
    every = readings(kind, path)

    @seed(number)
    @settings(max_examples=inputs, deadline=None, database=None, phases=[Phase.generate])
    @given(damages(whole))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        tally.counts["inputs"] += 1
        shown = tally.counts["inputs"] % EVERY == 0
        commands = [partial(command, words) for words in COMMANDS.get(kind, ()) if shown]
        for reading in (*every, *commands):
            tally.run(f"{kind} {tally.counts['inputs']}", reading, path)

    read()
    path.write_bytes(whole)


def main() -> int:
    """Read the command line; the exit code is 1 where a fault was found."""
    parser = options_of(__doc__)
    parser.add_argument("--inputs", type=int, default=1000, help="damages of each kind of file")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", action="append", choices=FILES, help="a kind; may be repeated")
    options = parser.parse_args()

    def ring(*_: object) -> None:
        raise Hang

    signal.signal(signal.SIGPROF, ring)
    warnings.simplefilter("error")  # what a library mutters, nobody foresaw
    rows = []
    told = []
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        make_sound(Path(name))
        for kind in options.only or FILES:
            tally = Tally()
            fuzz(kind, options.inputs, options.seed, Path(name), tally)
            counts = {key: tally.counts[key] for key in ("inputs", *FAULTS)}
            rows.append({"kind": kind, **counts, "peak_mb": round(peak_mb())})
            told += tally.told
    totals = {key: sum(row[key] for row in rows) for key in ("inputs", *FAULTS)}
    report = {**totals, "peak_mb": rows[-1]["peak_mb"], "kinds": rows, "told": told}
    show(rows, report if options.json else None)
    print(*told, sep="\n", file=sys.stderr)
    return int(bool(told))


if __name__ == "__main__":
    sys.exit(main())
