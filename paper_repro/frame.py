"""What every item of the paper is made of: its setting, tables, claims, figures, and a verdict.

A script has one function, `run(setting) -> Result`; `main` makes it a program of its own.
"""

import argparse
import dataclasses
import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import canvas
from meal_bayes.files import write_whole

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
_ZERO = 1e-9
_NAMED = 4  # fallen statements that a verdict names


class Estimate(NamedTuple):
    """A mean and its standard error."""

    mean: float
    se: float


Cell = str | int | float | Estimate | None  # None: not measured, or not printed


@dataclasses.dataclass(frozen=True, slots=True)
class Setting:
    """How an item is run; the numbers of settings.toml are read through it."""

    quick: bool = False
    seed: int = 0
    jobs: int = 1
    logs: Path = Path("logs")
    as_published: bool = False  # the published code's protocol alone
    on_progress: Callable[[int, int], None] | None = None

    @property
    def committed(self) -> bool:
        """Whether this run is what git keeps: in full, in all protocols."""
        return not (self.quick or self.as_published)

    @property
    def protocols(self) -> tuple[str, ...]:
        """Columns to run."""
        return ("published",) if self.as_published else ("published", "recorded")

    def of(self, item: str, key: str) -> Any:
        """Look a number of settings.toml up; of {full, quick} the one that is wanted."""
        value = _table("settings.toml")[item][key]
        if isinstance(value, Mapping) and set(value) == {"full", "quick"}:
            return value["quick" if self.quick else "full"]
        return value


@dataclasses.dataclass(frozen=True, slots=True)
class Claim:
    """Something that the paper says of an item, and whether it stands; None: cannot be asked."""

    text: str
    recorded: bool | None  # on recorded percepts, or where no percept is drawn
    published: bool | None = None  # in the published code's protocol
    contradicted: bool = False  # by other numbers of the paper itself


@dataclasses.dataclass(frozen=True, slots=True)
class Table:
    """Rows under columns."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclasses.dataclass(frozen=True, slots=True)
class Result:
    """What came of an item."""

    item: str  # name of its script
    title: str
    paper: str  # its number, in a few words
    ours: str  # the same of ours
    tables: tuple[Table, ...]
    claims: tuple[Claim, ...]
    notes: tuple[str, ...] = ()
    # by what their files' names end in after the item
    figures: Mapping[str, canvas.Axes] = dataclasses.field(default_factory=dict)
    # computing time: kept apart, as it is never the same twice
    seconds: float = 0.0  # in all, logged ones included
    timing: str = ""  # what else is to be told of it
    # of the published code's departures, by their number in errata.toml
    effects: Mapping[str, str] = dataclasses.field(default_factory=dict)


def asked(n: int) -> str:
    """Name a number of attributes.

    >>> asked(1), asked(2)
    ('1 attribute', '2 attributes')
    """
    return f"{n} attribute{'s' if n != 1 else ''}"


def verdict(claims: Sequence[Claim]) -> str:
    """Judge an item from its claims, and name those that do not stand.

    >>> verdict([Claim("a", recorded=True), Claim("b", recorded=False, published=True)])
    'reproduced only in the published protocol: 1 of 2 statements stand on recordings; not: b'
    """
    own = [claim for claim in claims if claim.recorded is not None]
    code = [claim for claim in claims if claim.published is not None]
    stand = f"{sum(bool(c.recorded) for c in own)} of {len(own)} statements stand"
    in_code = f"{sum(bool(c.published) for c in code)} of {len(code)} in the published protocol"
    if not claims:
        return "the paper says nothing that could be judged"
    if not own:
        return f"on recordings not run: {in_code}"
    fell = [claim for claim in own if not claim.recorded]
    more = f" and {len(fell) - _NAMED} more" if len(fell) > _NAMED else ""
    names = "; not: " + "; ".join(claim.text for claim in fell[:_NAMED]) + more
    if not fell:
        return f"reproduced: {stand}"
    if all(claim.contradicted for claim in fell):
        return f"reproduced where the paper agrees with itself: {stand}{names}"
    if all(claim.published for claim in fell) and all(claim.published for claim in code):
        return f"reproduced only in the published protocol: {stand} on recordings{names}"
    return f"not reproduced: {stand}" + (f", {in_code}" if code else "") + names


def agrees(paper: Estimate, ours: Estimate, *, printed: int) -> bool:
    """Whether two estimates are within two standard errors of their difference.

    `printed` is the number of decimals in the paper, whose rounding is allowed for.
    """
    reach = 2 * math.hypot(paper.se, 0.0 if math.isnan(ours.se) else ours.se)
    return abs(paper.mean - ours.mean) <= reach + 0.5 * 10.0**-printed + 1e-9


@lru_cache(maxsize=4)
def _table(name: str) -> dict[str, Any]:
    return tomllib.loads((HERE / name).read_text(encoding="utf-8"))


def paper_values(item: str) -> dict[str, Any]:
    """Give what paper_values.toml holds of an item."""
    values: dict[str, Any] = _table("paper_values.toml")[item]
    return values


def facts(result: Result, setting: Setting) -> dict[str, Any]:
    """Give a result as plain values; equal runs give equal ones."""
    return {
        "item": result.item,
        "title": result.title,
        "command": command(result.item, setting),
        "seed": setting.seed,
        "verdict": verdict(result.claims),
        "paper": result.paper,
        "ours": result.ours,
        "tables": [
            {
                "title": table.title,
                "columns": list(table.columns),
                "rows": [[_plain(cell) for cell in row] for row in table.rows],
            }
            for table in result.tables
        ],
        "claims": [dataclasses.asdict(claim) for claim in result.claims],
        "notes": list(result.notes),
        "figures": [f"{result.item}{end}.png" for end in result.figures],
        "effects": dict(result.effects),
    }


def command(item: str, setting: Setting) -> str:
    """Give the command behind a result."""
    extra = (" --quick" if setting.quick else "") + (
        " --as-published" if setting.as_published else ""
    )
    return f"meal-bayes reproduce {item}{extra} --seed {setting.seed}"


def write(result: Result, setting: Setting) -> dict[str, Any]:
    """Write a result: to results/ what git keeps, beside the logs what is quick or partial."""
    folder = RESULTS if setting.committed else setting.logs / "paper_repro"
    told = facts(result, setting)
    text = json.dumps(told, indent=1, allow_nan=False) + "\n"
    write_whole(folder / f"{result.item}.json", text)
    for end, figure in result.figures.items():
        canvas.save(figure, folder / f"{result.item}{end}.png")
    timing = folder / "timing.json"
    known = json.loads(timing.read_text(encoding="utf-8")) if timing.is_file() else {}
    known[result.item] = {"seconds": round(result.seconds, 1), "told": result.timing}
    write_whole(timing, json.dumps(known, indent=1, sort_keys=True) + "\n")
    return told


def _plain(cell: Cell) -> Any:
    """Six digits are enough, and are the same on every machine."""
    if isinstance(cell, Estimate):
        return [_plain(number) for number in cell]
    if isinstance(cell, float):
        nothing = abs(cell) < _ZERO  # what rounding leaves over
        return None if math.isnan(cell) else 0.0 if nothing else float(f"{cell:.6g}")
    return cell


def main(run: Callable[[Setting], Result]) -> None:
    """Run one script by itself: python paper_repro/table3.py --quick."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="few trials, results beside the logs")
    parser.add_argument("--as-published", action="store_true", help="the published protocol alone")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--logs", type=Path, default=Path("logs"), help="folder of trial logs")
    options = parser.parse_args()
    if options.seed < 0:
        raise SettingsError(f"seed is {options.seed}; give a whole number, 0 or more.")
    from pages import result_page  # noqa: PLC0415  it reads results, which this module writes

    print(result_page(write(run(Setting(**vars(options))), Setting(**vars(options)))))
