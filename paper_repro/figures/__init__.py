"""Figures of the items, drawn from their records: no picture shows what no table says.

Titles say what the numbers say, as they are made of them, and drawing again needs no run.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

from matplotlib.axes import Axes

from meal_bayes import look
from meal_bayes.files import write_whole
from paper_repro.figures import offline, online
from paper_repro.figures.shapes import Record

DRAWINGS: Mapping[str, Callable[[Record], dict[str, Axes]]] = {
    "eq7": offline.eq7,
    "fig4": offline.fig4,
    "fig5": offline.fig5,
    "fig8": offline.fig8,
    "fig9": offline.fig9,
    "fig10": online.fig10,
    "fig11": online.fig11,
    "fig12": online.fig12,
}


def draw(record: Record) -> dict[str, Axes]:
    """Draw the figures of an item's record, by the names of their files."""
    item = record["item"]
    if item not in DRAWINGS:
        return {}
    return {f"{item}{end}.png": ax for end, ax in DRAWINGS[item](record).items()}


def draw_into(folder: Path, record: Record) -> list[str]:
    """Write the figures of an item's record and remove those it has no more; returns the names."""
    drawn = draw(record)
    item = record["item"]
    for name, ax in drawn.items():
        write_whole(folder / name, look.render(ax, "png"), expected=True)
    for path in (*folder.glob(f"{item}.png"), *folder.glob(f"{item}_*.png")):
        if path.name not in drawn:
            path.unlink()
    return list(drawn)
