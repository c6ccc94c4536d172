"""Options that several commands share."""

import hashlib
import importlib
import json
import sys
import sysconfig
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from meal_bayes.files import LOGS

if TYPE_CHECKING:
    from meal_bayes.datasets import PerceptTable

Command = TypeVar("Command", bound=Callable[..., Any])

# As `untrusted` has them, which loads NumPy: the command line starts without. Change both.
LARGEST = 1e6
NAME_LIMIT = 1000
LARGEST_COUNT = 10_000_000  # that is read; `experiments.config.MOST_TRIALS` is what a run may have
COUNT = click.IntRange(1, LARGEST_COUNT)


class FiniteRange(click.FloatRange):
    """Numbers of a range; "nan", which no comparison excludes, is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        number = super().convert(value, param, ctx)
        if number != number:  # noqa: PLR0124  as NaN alone is
            self.fail(f"{value!r} is no number.", param, ctx)
        return number


AMOUNT = FiniteRange(0, LARGEST)
SEED = click.IntRange(0, 2**63 - 1)
FILE = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)


def option(
    name: str, kind: Any, default: object, metavar: str | None, text: str, **more: Any
) -> Callable[[Command], Command]:
    """Return an option of this type and help; its default is shown, unless that is None."""
    if default is not None:
        more = {"default": default, "show_default": True} | more
    return click.option(*name.split(), type=kind, metavar=metavar, help=text, **more)


def table_of(
    dataset: str, root: Path | None, perception: str = "default"
) -> "tuple[str, PerceptTable]":
    """Return the table of --dataset and --root, after the name by which a run finds it again.

    The table of a user's own recordings is computed once, and kept in the cache.
    """
    from meal_bayes.cli.console import note, progress
    from meal_bayes.perception import TableSource

    source = TableSource.of(dataset, perception, root=root)
    with progress("percepts", "behaviors") as advance:
        return source.name, source.load(on_progress=advance, on_note=note)


def agent_value(text: str) -> object:
    """Return an agent's name as it is, or the value of `package.module:name` (`named_value`)."""
    return named_value(text) if ":" in text else text


AGENTS = "prior, random, random_legal, predefined, predefined_plus, greedy, morc, olfc or bayes"
ONLINE_AGENTS = (
    "iterative_random_legal, iterative_morc, morc_itrs, bayes, bayes_memory, bayes_no_bonus, "
    "bayes_itrs or iterative_morc_bayes"
)
OWN = "package.module:name of your own"


def seed_option(default: int = 0) -> Callable[[Command], Command]:
    """Return the option --seed."""
    text = "Seed of failures, recordings and planning; equal seeds give equal trials."
    return option("--seed", SEED, default, "S", text)


_SHARED = {
    "dataset": option(  # with "root"; `table_of` reads both
        "--dataset", None, "roc36", "NAME|FILE",
        "roc36, ispy32, cy101 or a variant of them; your own domain (TOML, with --root), or your "
        "own percept table (.npz).",
    ),
    "root": option(
        "--root", click.Path(exists=True, file_okay=False, path_type=Path), None, "FOLDER",
        "Folder of your recordings (with --dataset DOMAIN.toml), or of a mirror of public ones.",
    ),
    "perception": option(
        "--perception", click.Choice(["default", "paper"]), "default", None,
        "Classifiers that compute the percepts: those of the package, or the paper's.",
    ),
    "yes_no": click.option(
        "--yes-no", is_flag=True, help='Ask a yes-or-no question: "Is it red and not heavy?".'
    ),
    "payoffs": click.option(
        "--payoffs", type=float, nargs=4, metavar="S S S S",
        help="Rewards of a right yes, a wrong yes, a right no and a wrong no.",
    ),
    "seed": seed_option(),
    "key": option(
        "--key", None, "", "TEXT",
        "Version of your own agents' code; trials of runs with the same key are reused.",
    ),
    "jobs": option("--jobs", click.IntRange(1, 1024), 1, None, "Number of processes."),
    "cluster": option(
        "--cluster", None, None, "ADDRESS", "Dask scheduler whose workers do the computations."
    ),
    "logs": option("--logs", FOLDER, Path(LOGS), None, "Folder of the trial logs."),
    "fresh": click.option("--fresh", is_flag=True, help="Run again what was computed before."),
    "json": click.option("--json", "as_json", is_flag=True, help="Print one JSON object."),
}  # fmt: skip


def shared(*names: str) -> Callable[[Command], Command]:
    """Return a decorator that adds options which mean the same in several commands."""

    def add(command: Command) -> Command:
        for name in reversed(names):
            command = _SHARED[name](command)
        return command

    return add


def comma_list(*texts: str) -> tuple[str, ...]:
    """Return names that were given one by one or as comma lists."""
    return tuple(name.strip() for text in texts for name in text.split(","))


def digest(config: Mapping[str, object]) -> str:
    """Return a short name that equal configurations share and others do not."""
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:8]


def named_value(name: str) -> Any:
    """Import the value of ``package.module:name``, also from a module of the current folder."""
    from meal_bayes.domain import unknown
    from meal_bayes.errors import SettingsError

    module, _, attribute = name.partition(":")
    if not module or not attribute:
        raise SettingsError(
            f"{name!r} does not name a Python object; write it as package.module:name."
        )
    # A script of the user's lies in the current folder, which an installed program does not search.
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # as `python -m` does
    try:
        loaded = importlib.import_module(module)
    except ImportError as fault:
        raise SettingsError(
            f"The module of {name!r} cannot be imported ({fault}); run the command in the folder "
            "of the module, or add this folder to PYTHONPATH."
        ) from fault
    except (Exception, SystemExit) as fault:  # whatever the module executes
        raise SettingsError(f"The module of {name!r} raised {_raised(fault)}.") from fault
    try:
        return getattr(loaded, attribute)
    except AttributeError:
        public = [member for member in dir(loaded) if not member.startswith("_")]
        raise SettingsError(unknown(f"name in {module}", attribute, public)) from None
    except Exception as fault:  # of its own `__getattr__`
        raise SettingsError(f"{name!r} raised {_raised(fault)}.") from fault


def _raised(fault: BaseException) -> str:
    """Return an exception of a user's module in words, with the last line in the user's files."""
    text = f"{type(fault).__name__}: {fault}".removesuffix(": ")
    libraries = tuple({*sysconfig.get_paths().values(), str(Path(__file__).parents[1]), "<"})
    places = [
        f"{place.filename}, line {place.lineno}"
        for place in traceback.extract_tb(fault.__traceback__)
        if not place.filename.startswith(libraries)
    ]
    where = f" ({places[-1]})" if places else ""
    return f"{text}{where}; import it in Python to see the whole traceback"
