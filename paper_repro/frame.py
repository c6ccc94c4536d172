"""What every item is made of: a setting, tables, statements and figures, and where they go."""

import dataclasses
import json
import math
import time
import tomllib
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from threadpoolctl import threadpool_info

import meal_bayes
from meal_bayes.domain import unknown
from meal_bayes.errors import MealBayesError, SettingsError
from meal_bayes.evaluation import Estimate
from meal_bayes.experiments.online import plan_online
from meal_bayes.experiments.units import Planned, run_units
from meal_bayes.files import LOGS, write_whole
from meal_bayes.trial_log import read_seconds
from paper_repro import figures
from paper_repro.made_by import made_by
from paper_repro.statements import PROTOCOLS, THEIRS, Evidence, judged, verdict

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
PROVENANCE = "provenance.json"
_ZERO = 1e-9

Choice = TypeVar("Choice")

Cell = str | int | float | Estimate | None  # None: not measured, or not printed


class NotRun(MealBayesError):
    """A setting that runs nothing of an item."""


@dataclasses.dataclass(frozen=True, slots=True)
class Setting:
    """How an item is run; `spent` holds the seconds behind every log that it rests on."""

    quick: bool = False
    seed: int = 0
    jobs: int = 1
    logs: Path = Path(LOGS)
    as_published: bool = False  # the paper's own settings alone
    trials: int | None = None  # of an agent offline, at most
    repeats: int | None = None  # of online runs, at most; 0 leaves them out
    only: str = ""  # of an item's panels, those with this in their title
    on_progress: Callable[[float, int, str], None] | None = None  # done, in all, of what
    spent: dict[Path, float] = dataclasses.field(default_factory=dict, compare=False)

    def progress_in(self, noun: str) -> Callable[[float, int], None] | None:
        """Return what a run of such units calls with (done, in all)."""
        report = self.on_progress
        if report is None:
            return None
        return lambda done, total: report(done, total, noun)

    def spend(self, logs: Iterable[Path]) -> None:
        """Note the seconds that the trials of some logs took to compute."""
        self.spent.update((path, math.fsum(read_seconds(path))) for path in logs)

    @property
    def full(self) -> bool:
        """Whether this is the run whose results are committed: every trial, of the usual seed."""
        return command("", self) == command("", Setting())

    @property
    def protocols(self) -> tuple[str, ...]:
        """Columns to run: the paper's settings, and its method on recordings."""
        return PROTOCOLS[:1] if self.as_published else PROTOCOLS

    def choose(self, full: Choice, quick: Choice) -> Choice:
        """Return the size of a full run, or of a quick one."""
        return quick if self.quick else full

    def trials_of(self, full: int, quick: int) -> int:
        """Return how many offline trials an agent runs: one number, looked at once."""
        return min(quick if self.quick else full, self.trials or full)

    def repeats_of(self, full: int, *, column: str = THEIRS) -> int:
        """Return how many online repeats an agent runs, of an item that begins with a column.

        `NotRun` where no repeats are asked for, or the paper's settings alone and it has none.
        """
        if self.repeats == 0 or column not in self.protocols:
            raise NotRun("none of its online runs is asked for")
        return min(2 if self.quick else full, self.repeats or full)


class Table(NamedTuple):
    """Rows under columns."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclasses.dataclass(frozen=True, slots=True)
class Result:
    """What came of an item.

    Attributes
    ----------
    title : what it is about.
    sentence : what came of it, one sentence to quote.
    tables : of its numbers.
    evidence : of what the paper says of it, by protocol and text; None where it is not run.
    size : how many trials or repeats its numbers are of.
    notes : for readers.
    shows : what the paper describes, beside the figures, which are drawn from the tables.
    effects : of the published code's departures, by their number in errata.toml.
    """

    title: str
    sentence: str
    tables: tuple[Table, ...]
    evidence: Mapping[str, Mapping[str, Evidence | None]]
    size: str = ""
    notes: tuple[str, ...] = ()
    shows: str = ""
    effects: Mapping[str, str] = dataclasses.field(default_factory=dict)


def asked(n: int) -> str:
    """Name a number of attributes.

    >>> asked(1), asked(2)
    ('1 attribute', '2 attributes')
    """
    return "1 attribute" if n == 1 else f"{n} attributes"


@lru_cache(maxsize=4)
def read_table(name: str) -> dict[str, Any]:
    """Read a TOML file of this folder."""
    return tomllib.loads((HERE / name).read_text(encoding="utf-8"))


def paper_values(item: str) -> Any:
    """Return what paper_values.toml holds of an item, or under a key of its own."""
    return read_table("paper_values.toml")[item]


def items() -> tuple[str, ...]:
    """List the items, in the order of the paper."""
    values = read_table("paper_values.toml")
    return tuple(
        name for name, entry in values.items() if isinstance(entry, dict) and "where" in entry
    )


def named(words: Iterable[str]) -> tuple[str, ...]:
    """Read item names, in the order of the paper; "all" is every one of them."""
    wanted = {word.strip() for text in words for word in text.split(",")}
    for word in sorted(wanted - {"all", *items()}):
        raise SettingsError(unknown("item", word, ["all", *items()]))
    return tuple(item for item in items() if wanted & {"all", item})


def reproduce(item: str, setting: Setting) -> dict[str, Any]:
    """Run one item and write what came of it; returns the facts that were written."""
    # Git keeps what comes of full runs alone: numbers of a few trials would hide those of many.
    return run_item(item, setting, RESULTS if setting.full else setting.logs / "paper_repro")


def run_item(item: str, setting: Setting, folder: Path) -> dict[str, Any]:
    """Run one item and write what came of it into a folder; returns the facts."""
    begin = time.perf_counter()
    setting = dataclasses.replace(setting, spent={})
    progress = setting.progress_in("batches")
    run_units(planned_runs(item, setting), jobs=setting.jobs, on_progress=progress)
    result: Result = _module_of(item, setting).run(setting)
    # Trials that the logs hold already took their time in an earlier run, which counts as well.
    seconds = max(time.perf_counter() - begin, math.fsum(setting.spent.values()))
    record = write_record(folder, facts(item, result, setting))
    note_provenance(item, folder, command(item, setting), seconds)
    return record


def planned_runs(item: str, setting: Setting) -> list[Planned]:
    """Plan the online runs that an item lists in `runs`, whose units run as one list.

    What an item does not list it runs itself, one run after another.
    """
    listed = getattr(_module_of(item, setting), "runs", None)
    configs = [] if listed is None else listed(setting)
    return [plan_online(config, logs=setting.logs) for config in configs]


def _module_of(item: str, setting: Setting) -> Any:
    """Import an item; `NotRun` where panels are named and it has none."""
    module = import_module(f"paper_repro.items.{item}")
    if setting.only and not hasattr(module, "panels_of"):
        raise NotRun("it has no panels, of which --only could choose")
    return module


def write_record(folder: Path, record: dict[str, Any]) -> dict[str, Any]:
    """Draw the figures of a record and write it with their names; returns what was written."""
    shown = record | {"figures": figures.draw_into(folder, record)}
    text = json.dumps(shown, indent=1, allow_nan=False)
    write_whole(folder / f"{record['item']}.json", f"{text}\n", expected=True)
    return shown


def note_provenance(item: str, folder: Path, command: str, seconds: float) -> None:
    """Keep beside the results what a run rested on that its command does not say."""
    by_item = provenance(folder)
    by_item[item] = {
        "code": made_by(command),
        "blas": blas_kernel(),
        "version": meal_bayes.__version__,
        "seconds": round(seconds, 1),
        "older": False,
    }
    _write_provenance(folder, by_item)


def mark_older() -> None:
    """Mark the items that other code made than this; pages show these marks."""
    by_item = provenance(RESULTS)
    for item, made in by_item.items():
        made["older"] = is_older(item)
    _write_provenance(RESULTS, by_item)


def _write_provenance(folder: Path, by_item: dict[str, Any]) -> None:
    text = json.dumps(by_item, indent=1, sort_keys=True)
    write_whole(folder / PROVENANCE, f"{text}\n", expected=True)


def provenance(folder: Path) -> dict[str, Any]:
    """Read by item what runs rested on: code, linear algebra, version, and their seconds."""
    path = folder / PROVENANCE
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}


def minutes_of(item: str) -> float:
    """Return how many minutes of computing a full run of an item took; 0 where it never ran."""
    return float(provenance(RESULTS).get(item, {}).get("seconds", 0.0)) / 60


@lru_cache(maxsize=1)
def blas_kernel() -> str:
    """Name the kernel of the linear algebra: last digits of what classifiers show go by it."""
    kernels = (
        entry.get("architecture") or entry["internal_api"]
        for entry in threadpool_info()
        if entry["user_api"] == "blas"
    )
    return ", ".join(sorted(set(kernels)))


def is_older(item: str) -> bool:
    """Return whether other code, data or settings than this version's full run made an item."""
    made = provenance(RESULTS).get(item, {}).get("code")
    return bool(made != made_by(command(item, Setting())))


def is_marked_older(item: str) -> bool:
    """Return whether an item was of an earlier version when the pages were written."""
    return bool(provenance(RESULTS).get(item, {}).get("older", True))


def read_result(item: str) -> dict[str, Any] | None:
    """Read the committed facts of an item; None where it was never run in full."""
    path = RESULTS / f"{item}.json"
    if not path.is_file():
        return None
    return dict(json.loads(path.read_text(encoding="utf-8")))


def facts(item: str, result: Result, setting: Setting) -> dict[str, Any]:
    """Return a result as plain values; equal runs give equal ones."""
    values = paper_values(item)
    statements = judged(result.evidence, values.get("central", ["*"]), values["where"])
    return {
        "item": item,
        "title": result.title,
        "command": command(item, setting),
        "seed": setting.seed,
        "verdict": verdict(statements),
        "sentence": " ".join(result.sentence.split()),
        "size": result.size,
        "tables": [plain(table._asdict()) for table in result.tables],
        "statements": plain(statements),
        "notes": [" ".join(note.split()) for note in result.notes],
        "figures": [],  # drawn from the rest
        "shows": " ".join(result.shows.split()),
        "effects": dict(result.effects),
    }


def command(item: str, setting: Setting) -> str:
    """Return the command behind a result."""
    words = [f"meal-bayes reproduce {item}"]
    if setting.quick:
        words.append("--quick")
    if setting.as_published:
        words.append("--as-published")
    if setting.trials is not None:
        words.append(f"--trials {setting.trials}")
    if setting.repeats is not None:
        words.append(f"--repeats {setting.repeats}")
    if setting.only:
        words.append(f'--only "{setting.only}"')
    words.append(f"--seed {setting.seed}")
    return " ".join(words)


def plain(value: Any) -> Any:
    """Return a value as JSON: six digits are enough, and are the same on every machine.

    An effect is its estimate and standard error, or of a fraction the ends of its 95 % interval.
    """
    if isinstance(value, Estimate):
        estimate, se, low, high = value.interval()
        return plain([estimate, low, high] if value.fraction else [estimate, se])
    if isinstance(value, Mapping):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return _six_digits(value) if isinstance(value, float) else value


def _six_digits(value: float) -> float | None:
    """Round to six digits; None where it is not finite, as JSON has no word for that."""
    if not math.isfinite(value):
        return None
    if abs(value) < _ZERO:  # what rounding leaves over
        return 0.0
    return float(f"{value:.6g}")
