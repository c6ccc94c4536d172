"""The terminal: consoles, characters that every terminal can show, progress."""

import contextlib
import json
import math
import textwrap
import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, NoReturn, Protocol

import click
import rich.progress
from rich.console import Console, ConsoleOptions, JustifyMethod, RenderableType
from rich.measure import Measurement
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

_CONTROLS = 0x20  # control characters are those below it
_PICTURES = 0x2400  # from here on Unicode has pictures of them
_NARROWEST = 20  # columns; what says to have fewer is of unknown width
_USUAL = 80  # columns of such a terminal
_WIDEST = 10_000  # columns that no table needs
_LABEL = 10  # characters of a label, at least
_NARROW = 20  # characters of the text beside it, at least
_EVERY = 15.0  # s between lines of progress without a terminal
_SHARE = 0.05  # of the work, from which on its pace is known; one whole unit will do too


class Advance(Protocol):
    """Called with what is done, and what there is in all; in another unit, with its name."""

    def __call__(self, done: float, total: int, noun: str = ...) -> None:
        """Show it."""


def printable(text: str) -> str:
    r"""Replace the characters that would control the terminal; names come from files of others.

    >>> printable("mug\x1b[2J") == "mug\N{SYMBOL FOR ESCAPE}[2J"
    True
    """
    return "".join(map(_printable_character, text))


def _printable_character(character: str) -> str:
    if character.isprintable() or character == "\n":
        return character
    if ord(character) < _CONTROLS:
        return chr(_PICTURES + ord(character))
    return "\N{REPLACEMENT CHARACTER}"


def say(text: object) -> None:
    """Print one result on standard output."""
    click.echo(printable(str(text)))


class _Console(Console):
    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield segments of printable text; those that move the cursor are the console's own."""
        for segment in super().render(renderable, options):
            text = segment.text if segment.control else printable(segment.text)
            yield Segment(text, segment.style, segment.control)

    def on_broken_pipe(self) -> NoReturn:
        """Raise, as the program chooses the exit code."""
        raise BrokenPipeError


def output(*, stderr: bool = False) -> Console:
    """Return the console of results, or of progress and notes."""
    console = _Console(stderr=stderr, highlight=False, markup=False, emoji=False)
    if console.width < _NARROWEST:  # COLUMNS=0, or a terminal of unknown width
        console.width = _USUAL
    return console


def print_table(
    columns: Mapping[str, str] | Sequence[str],
    rows: Iterable[Any],
    *,
    left_aligned: Collection[str] = (),
    narrow: bool = False,
) -> None:
    """Print a table of results, right-justified but for the first column and those `left_aligned`.

    Rows hold the texts of columns, or are mappings, which each column's template formats. The first
    column holds names, which stay whole. In a `narrow` table columns stand close and all lines stay
    whole, so that 80 characters hold them.
    """
    # No lines: columns are told apart by space, and a copied table pastes as text.
    table = Table(box=None, padding=(0, 1 if narrow else 2, 0, 0), header_style="bold")
    for number, name in enumerate(columns):
        justify: JustifyMethod = "left" if number == 0 or name in left_aligned else "right"
        table.add_column(name, justify=justify, no_wrap=narrow or number == 0, overflow="fold")
    for row in rows:
        formats = columns.values() if isinstance(columns, Mapping) else None
        table.add_row(*(row if formats is None else (text.format_map(row) for text in formats)))
    console = output()
    # In a window that is too narrow lines wrap at its edge; cut, they would say other numbers.
    options = console.options.update(width=_WIDEST)
    least, whole = Measurement.get(console, options, table)
    console.width = max(console.width, whole if narrow else least)
    console.print(table)


def print_json(facts: Mapping[str, object]) -> None:
    """Print one JSON object on standard output; null stands for what is not finite."""
    from meal_bayes.look import json_value

    click.echo(json.dumps(json_value(facts), allow_nan=False))


def print_facts(console: Console, facts: Mapping[str, str], **styles: str) -> None:
    """Print labels and their texts, by label in a style; long texts wrap beside their label."""
    for label, value in facts.items():
        width = max(console.width - max(len(label), _LABEL) - 3, _NARROW)
        rows = list[Text]()
        for line in value.splitlines():
            parts = textwrap.wrap(line, width, break_long_words=False) or [""]
            rows += (Text(part, styles.get(label, "")) for part in parts)
        print_rows(console, label, rows)


def print_rows(console: Console, label: str, rows: Iterable[Text], *, cut: bool = False) -> None:
    """Print lines of text, the first behind the label; `cut` ends them where the window ends."""
    for text in rows:
        line = Text.assemble((f"  {label:<{_LABEL}} ", "dim"), text)
        if cut:
            console.print(line, no_wrap=True, overflow="ellipsis")
        else:
            console.print(line, soft_wrap=True)
        label = ""


def signed(value: object) -> str:
    """Return an amount with its sign, or "-" of what is no finite number.

    >>> signed(2.0), signed(None)
    ('+2.0', '-')
    """
    from meal_bayes.look import AMOUNT

    finite = isinstance(value, float) and math.isfinite(value)
    return f"{value:+{AMOUNT}}" if finite else "-"


def note(text: str) -> None:
    """Print one line on standard error."""
    output(stderr=True).print(text, style="dim", soft_wrap=True)


class _Pace:
    """How fast a run goes, from what it found done when it began."""

    def __init__(self, now: float) -> None:
        self._start = now
        self._first = 0.0  # done when it began
        self._previous = math.inf  # done when it was last looked at
        self._last_line = now

    def begins_anew(self, done: float, now: float) -> bool:
        """Look at what is done; return whether another run begins with it."""
        anew = done < self._previous - 1
        if anew:  # what was there must not count as speed
            self._start = now
            self._first = done
        self._previous = done
        return anew

    def is_line_due(self, done: float, now: float) -> bool:
        """Return whether it is time for a line, and anything was done."""
        due = now - self._last_line >= _EVERY and done > self._first
        if due:
            self._last_line = now
        return due

    def seconds_left(self, done: float, total: int, now: float) -> float | None:
        """Estimate the seconds to the end by the pace so far; None while that says little.

        Pieces of a first unit come after what each process does once, which would count as theirs.
        """
        gained = done - self._first
        if gained < min(1.0, _SHARE * (total - self._first)) or gained <= 0:
            return None
        return (now - self._start) / gained * (total - done)


@contextlib.contextmanager
def progress(what: str, noun: str) -> Iterator[Advance]:
    """Show fraction done, time passed and time left: a bar on a terminal, else lines.

    One after another, several runs may advance it: each begins with what it found done.
    """
    console = output(stderr=True)
    # On no terminal rich prints nothing before the end; then a line tells from time to time.
    bars = rich.progress.Progress(
        rich.progress.SpinnerColumn("line"),  # moves while a long piece of work does not
        rich.progress.TextColumn("{task.description}", markup=False),
        rich.progress.BarColumn(bar_width=None),
        rich.progress.MofNCompleteColumn(),
        rich.progress.TextColumn("{task.fields[noun]},"),
        rich.progress.TimeElapsedColumn(),
        rich.progress.TextColumn("{task.fields[left]}"),
        console=console,
        transient=True,
        expand=True,
        disable=not console.is_terminal,
    )
    task = bars.add_task(printable(what), total=None, noun=noun, left="")
    begun = time.monotonic()
    pace = _Pace(begun)
    runs = 0

    def advance(done: float, total: int, noun: str = noun) -> None:
        nonlocal runs
        now = time.monotonic()
        if pace.begins_anew(done, now):
            runs += 1
            name = what if runs == 1 else f"{what}, run {runs}"
            bars.reset(task, completed=int(done), total=total, description=printable(name))
        seconds = pace.seconds_left(done, total, now)
        left = "" if seconds is None else f"{seconds:.0f} s left"
        bars.update(task, completed=done, total=total, noun=noun, left=left)
        if bars.disable and done < total and pace.is_line_due(done, now):
            run = "" if runs == 1 else f"run {runs}"
            begins = ", ".join(filter(None, ("" if what == noun else what, run)))
            begins += ": " if begins else ""
            passed = f"{now - begun:.0f} s"
            note(", ".join(filter(None, (f"{begins}{int(done)} of {total} {noun}", passed, left))))

    with bars:
        yield advance


@contextlib.contextmanager
def resumed(noun: str) -> Iterator[Advance]:
    """Show progress of a run that can be resumed; print what is there, and what is kept."""
    state = ""
    try:
        with progress(noun, noun) as bar:

            def advance(done: float, total: int, noun: str = noun) -> None:
                nonlocal state
                if not state and done:
                    note(f"{int(done)} of {total} {noun} are there already")
                state = f"{int(done)} of {total} {noun}"
                bar(done, total, noun)

            yield advance
    except KeyboardInterrupt:
        note(f"interrupted: {state or f'no {noun}'} are kept; the same command goes on from there")
        raise


@contextlib.contextmanager
def showing_compilation() -> Iterator[None]:
    """Say that the planner is prepared, and on a terminal how far that is.

    Nothing is shown where an earlier program compiled its kernels, as in most programs.
    """
    from meal_bayes.planners.jit import PREPARING, Compiling, watch_compilation

    console = output(stderr=True)
    status = console.status(PREPARING, spinner="line")
    announced = False

    def report(now: Compiling) -> None:
        nonlocal announced
        if console.is_terminal:
            status.update(f"{PREPARING}: part {now.done + 1} of at most {now.most}")
            status.start()
        elif not announced:
            note(PREPARING)
        announced = True

    try:
        with watch_compilation(report, status.stop):
            yield
    finally:
        status.stop()
