"""All items in the order of the paper; adding one is a script and a line here."""

from collections.abc import Iterable
from importlib import import_module
from typing import Any

from frame import HERE, Setting, write
from pages import errata, readme

from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.files import write_whole

ITEMS = (
    "table2",
    "fig4",
    "fig5",
    "fig7",
    "table3",
    "fig8",
    "fig9",
    "table4",
    "t1t2",
    "fig10",
    "fig11",
    "fig12",
    "table5",
    "errata",
)


def named(words: Iterable[str]) -> tuple[str, ...]:
    """Read item names, in the order of the paper; "all" is every one of them."""
    wanted = {word.strip() for text in words for word in text.split(",")}
    for word in wanted - {"all", *ITEMS}:
        raise SettingsError(unknown("item", word, ["all", *ITEMS]))
    return ITEMS if "all" in wanted else tuple(item for item in ITEMS if item in wanted)


def reproduce(item: str, setting: Setting) -> dict[str, Any]:
    """Run one item and write what came of it."""
    return write(import_module(item).run(setting), setting)


def write_pages() -> list[str]:
    """Write README.md and ERRATA.md from the results that are there; gives their paths."""
    paths = HERE / "README.md", HERE / "ERRATA.md"
    for path, text in zip(paths, (readme(ITEMS), errata(ITEMS)), strict=True):
        write_whole(path, text)
    return [str(path) for path in paths]
