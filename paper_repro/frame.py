"""What every item is made of: a setting, tables, statements and figures, and where they go."""

import dataclasses
import json
import math
import time
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import Interval, canvas
from meal_bayes.files import write_whole
from meal_bayes.trial_log import read_seconds
from paper_repro.statements import Evidence, Statement, verdict

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
_ZERO = 1e-9

Choice = TypeVar("Choice")
Found = TypeVar("Found")


class Estimate(NamedTuple):
    """A mean and its standard error."""

    mean: float
    se: float

    @classmethod
    def of(cls, interval: Interval) -> "Estimate":
        """Return the mean of an interval and its standard error."""
        return cls(interval.estimate, interval.se)


Cell = str | int | float | Estimate | None  # None: not measured, or not printed


@dataclasses.dataclass(frozen=True, slots=True)
class Setting:
    """How an item is run; `spent` holds the seconds behind every log that it rests on."""

    quick: bool = False
    seed: int = 0
    jobs: int = 1
    logs: Path = Path("logs")
    as_published: bool = False  # the published code's protocol alone
    cluster: str | None = None  # address of a Dask scheduler
    trials: int | None = None  # of an agent offline, at most
    repeats: int | None = None  # of online runs, at most; 0 runs none
    on_progress: Callable[[int, int], None] | None = None
    spent: dict[Path, float] = dataclasses.field(default_factory=dict, compare=False)

    @property
    def committed(self) -> bool:
        """Whether this run is what git keeps: in full, in all protocols."""
        return not (self.quick or self.as_published)

    def spend(self, logs: Iterable[Path]) -> None:
        """Note the seconds that the trials of some logs took to compute."""
        self.spent.update((path, math.fsum(read_seconds(path))) for path in logs)

    @property
    def protocols(self) -> tuple[str, ...]:
        """Columns to run."""
        return ("published",) if self.as_published else ("published", "recorded")

    def choose(self, full: Choice, quick: Choice) -> Choice:
        """Return the size of a full run, or of a quick one."""
        return quick if self.quick else full

    def trial_steps(self, full: Sequence[int], quick: int) -> tuple[int, ...]:
        """Return the steps of offline trials, cut at the most that are wanted."""
        return _cut((quick,) if self.quick else full, self.trials)

    def repeat_steps(self, full: Sequence[int]) -> tuple[int, ...]:
        """Return the steps of online repeats, cut likewise; a quick run has one."""
        return _cut((1,) if self.quick else full, self.repeats)


@dataclasses.dataclass(frozen=True, slots=True)
class Table:
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
    paper, ours : its number in a few words, the paper's and ours on recordings.
    published : the same in the published code's protocol; empty where it has none.
    statements : what the paper says of it, judged.
    figures : by what their files' names end in after the item.
    shows : what the paper describes, beside the figures.
    effects : of the published code's departures, by their number in errata.toml.
    """

    title: str
    paper: str
    ours: str
    tables: tuple[Table, ...]
    statements: tuple[Statement, ...]
    published: str = ""
    notes: tuple[str, ...] = ()
    figures: Mapping[str, canvas.Axes] = dataclasses.field(default_factory=dict)
    shows: str = ""
    effects: Mapping[str, str] = dataclasses.field(default_factory=dict)


def until_decided(
    names: Iterable[str],
    steps: Sequence[int],
    run: Callable[[str, int], Found],
    judge: Callable[[Mapping[str, Found]], Mapping[str, Evidence]],
) -> tuple[dict[str, Found], dict[str, Evidence]]:
    """Run agents in steps until every statement about them is decided, or no step would do it.

    Parameters
    ----------
    names : of the agents.
    steps : repeats (or trials) of an agent, in all, growing.
    run : runs an agent so often, or reads it from the logs.
    judge : judges the statements, by text; their `agents` go on where one is undecided.
    """
    at = dict.fromkeys(names, 0)
    found = {name: run(name, steps[0]) for name in at}
    while True:
        evidence = dict(judge(found))
        open_ = (one for one in evidence.values() if not one.decided)
        within = (one for one in open_ if one.needed is None or one.needed <= steps[-1])
        again = {name for one in within for name in one.agents}
        again = {name for name in again if name in at and at[name] + 1 < len(steps)}
        if not again:
            return found, evidence
        for name in sorted(again):
            at[name] += 1
            found[name] = run(name, steps[at[name]])


def asked(n: int) -> str:
    """Name a number of attributes.

    >>> asked(1), asked(2)
    ('1 attribute', '2 attributes')
    """
    return f"{n} attribute{'s' if n != 1 else ''}"


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
    return tuple(name for name, section in values.items() if isinstance(section, dict))


def named(words: Iterable[str]) -> tuple[str, ...]:
    """Read item names, in the order of the paper; "all" is every one of them."""
    wanted = {word.strip() for text in words for word in text.split(",")}
    for word in sorted(wanted - {"all", *items()}):
        raise SettingsError(unknown("item", word, ["all", *items()]))
    return tuple(item for item in items() if wanted & {"all", item})


def reproduce(item: str, setting: Setting) -> dict[str, Any]:
    """Run one item and write what came of it; returns the facts that were written."""
    begin, setting = time.perf_counter(), dataclasses.replace(setting, spent={})
    result: Result = import_module(f"paper_repro.items.{item}").run(setting)
    seconds = max(time.perf_counter() - begin, math.fsum(setting.spent.values()))
    folder = RESULTS if setting.committed else setting.logs / "paper_repro"
    found = facts(item, result, setting)
    write_whole(folder / f"{item}.json", json.dumps(found, indent=1, allow_nan=False) + "\n")
    for end, figure in result.figures.items():
        canvas.save(figure, folder / f"{item}{end}.png")
    timing = folder / "timing.json"
    known = json.loads(timing.read_text(encoding="utf-8")) if timing.is_file() else {}
    known[item] = round(seconds, 1)
    write_whole(timing, json.dumps(known, indent=1, sort_keys=True) + "\n")
    return found


def facts(item: str, result: Result, setting: Setting) -> dict[str, Any]:
    """Return a result as plain values; equal runs give equal ones."""
    statements = [statement.as_dict() for statement in result.statements]
    tables = [*result.tables, *_evidence(result.statements)]
    return {
        "item": item,
        "title": result.title,
        "command": command(item, setting),
        "seed": setting.seed,
        "verdict": verdict(statements),
        "paper": result.paper,
        "published": result.published,
        "ours": result.ours,
        "tables": [
            {
                "title": table.title,
                "columns": list(table.columns),
                "rows": [[plain_cell(cell) for cell in row] for row in table.rows],
            }
            for table in tables
        ],
        "statements": statements,
        "notes": [" ".join(note.split()) for note in result.notes],
        "figures": [f"{item}{end}.png" for end in result.figures],
        "shows": result.shows,
        "effects": dict(result.effects),
    }


def command(item: str, setting: Setting) -> str:
    """Return the command behind a result."""
    quick, code = " --quick" * setting.quick, " --as-published" * setting.as_published
    most = "".join(
        f" --{name} {value}"
        for name, value in (("trials", setting.trials), ("repeats", setting.repeats))
        if value is not None
    )
    return f"meal-bayes reproduce {item}{quick}{code}{most} --seed {setting.seed}"


def plain_cell(cell: Cell) -> Any:
    """Return a cell as JSON: six digits are enough, and are the same on every machine."""
    if isinstance(cell, Estimate):
        return [plain_cell(number) for number in cell]
    if isinstance(cell, float):
        nothing = abs(cell) < _ZERO  # what rounding leaves over
        return None if not math.isfinite(cell) else 0.0 if nothing else float(f"{cell:.6g}")
    return cell


def _cut(steps: Sequence[int], most: int | None) -> tuple[int, ...]:
    """Return steps up to the most; none where that is 0."""
    if most is None:
        return tuple(steps)
    return tuple(dict.fromkeys(min(step, most) for step in steps if most))


def _evidence(statements: Sequence[Statement]) -> list[Table]:
    """Build the table of what every statement rests on: rule, mean with its sign, interval."""
    rows: list[tuple[Cell, ...]] = []
    for one in statements:
        for protocol in ("published", "recorded"):
            found: Evidence | None = getattr(one, protocol)
            if found is not None:
                mean, _, low, high = map(float, found.interval)
                rows.append((one.text, protocol, found.rule, mean, low, high, found.outcome,
                             found.repeats, found.needed))  # fmt: skip
    columns = ("statement", "protocol", "stands if", "mean", "95 % low", "high", "outcome",
               "repeats", "needed")  # fmt: skip
    return [Table("what the statements rest on", columns, tuple(rows))] if rows else []
