"""Do items of the paper give what is committed? They are run again and compared, leaf by leaf.

Texts, outcomes and counts must be equal; numbers may differ by a fraction of their size, as last
digits go by the machine. Items whose recordings cannot be had are passed over. Ends with 1 where
anything differs. By default the items that take seconds.

    python benchmarks/repeat.py [ITEM ...] [--tolerance 0.001] [--json]
"""

import json
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from measuring import options_of, show

from meal_bayes.errors import DownloadError
from paper_repro import frame

CHEAP = ("table2", "fig5", "fig7", "published_ask", "t1t2", "table5")


def differences(old: Any, new: Any, tolerance: float, place: str = "") -> Iterator[tuple[str, str]]:
    """Yield the place of each leaf that differs, and both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in sorted({*old, *new}):
            yield from differences(old.get(name), new.get(name), tolerance, f"{place}/{name}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for number, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, tolerance, f"{place}/{number}")
    elif not same(old, new, tolerance):
        yield place, f"{old!r:.60} was, {new!r:.60} is"


def same(old: Any, new: Any, tolerance: float) -> bool:
    """Return whether two leaves are equal, or numbers as near as that.

    >>> same(1.0, 1.0005, 0.001), same(1.0, 1.002, 0.001), same(True, 1, 0.1), same("a", "b", 1.0)
    (True, False, False, False)
    """
    if type(old) is float or type(new) is float:
        numbers = all(isinstance(value, int | float) for value in (old, new))
        return numbers and math.isclose(old, new, rel_tol=tolerance, abs_tol=tolerance)
    return type(old) is type(new) and bool(old == new)


def main() -> None:
    """Run, compare, and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("items", nargs="*", default=CHEAP, metavar="ITEM")
    parser.add_argument("--tolerance", type=float, default=0.001)
    options = parser.parse_args()
    rows = []
    failed = False
    for item in frame.named(options.items):
        with tempfile.TemporaryDirectory() as folder:
            try:
                found = repeat(item, Path(folder), options.tolerance)
            except (DownloadError, frame.NotRun) as fault:
                rows.append({"item": item, "": f"passed over: {fault}"})
                continue
        failed |= bool(found)
        rows += [{"item": item, "": f"{place}: {text}"} for place, text in found]
        rows += [] if found else [{"item": item, "": "as committed"}]
    show(rows, rows if options.json else None)
    sys.exit(failed)


def repeat(item: str, folder: Path, tolerance: float) -> list[tuple[str, str]]:
    """Run an item in a folder, and return where it differs from what is committed."""
    committed = frame.read_result(item)
    frame.run_item(item, frame.Setting(logs=folder), folder)
    made = json.loads((folder / f"{item}.json").read_text(encoding="utf-8"))
    return list(differences(committed, made, tolerance))


if __name__ == "__main__":
    main()
