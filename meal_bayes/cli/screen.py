"""The terminal: consoles, signs that every terminal can show, progress, the planner's first run."""

import contextlib
import itertools
import re
import threading
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple, NoReturn

import click
from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook, RenderResult
from rich.measure import Measurement
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment

_PICTURES, _CONTROLS = 0x2400, 0x20  # pictures of the control characters below it
_NARROWEST, _USUAL = 20, 80  # columns
_PATIENCE = 2.0  # s until a wait is explained
_EVERY = 15.0  # s between lines of progress where nobody watches

Advance = Callable[[int, int], None]  # called with (done, in all)


class Signs(NamedTuple):
    """Characters beyond ASCII, and what stands for them where the output cannot show them."""

    full: str
    empty: str
    arrow: str
    spread: str
    chosen: str


_UNICODE = Signs(
    "\N{FULL BLOCK}",
    "\N{LIGHT SHADE}",
    "\N{RIGHTWARDS ARROW}",
    "\N{PLUS-MINUS SIGN}",
    "\N{BLACK RIGHT-POINTING POINTER}",
)
_ASCII = Signs("#", ".", "->", "+-", ">")


def printable(text: str) -> str:
    r"""Show what would otherwise command the terminal: names come from files that others wrote.

    Control characters become their pictures; what turns text around or is no character, a sign for
    the unknown. Line breaks stay.

    >>> printable("mug\x1b[2J") == "mug\N{SYMBOL FOR ESCAPE}[2J"
    True
    """
    return text if text.isprintable() else _HIDDEN.sub(_picture, text)


def say(text: object) -> None:
    """Print one result on standard output."""
    click.echo(printable(str(text)))


_HIDDEN = re.compile(r"[^\n]")


def _picture(found: re.Match[str]) -> str:
    sign = found.group()
    if sign.isprintable():
        return sign
    code = ord(sign)
    return chr(_PICTURES + code) if code < _CONTROLS else "\N{REPLACEMENT CHARACTER}"


class _Shown(RenderHook):
    """Makes all that a console prints printable."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """Wrap what is to be printed."""
        return [_Printable(one) for one in renderables]


class _Printable:
    """One thing that is printed."""

    def __init__(self, inside: ConsoleRenderable) -> None:
        self._inside = inside

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield its segments; those that move the cursor are the console's own."""
        for segment in console.render(self._inside, options):
            text = segment.text if segment.control else printable(segment.text)
            yield Segment(text, segment.style, segment.control)

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """Measure it."""
        return Measurement.get(console, options, self._inside)


class _Screen(Console):
    def on_broken_pipe(self) -> NoReturn:
        """Leave the broken pipe to the program, which knows the exit code."""
        raise BrokenPipeError


def output() -> Console:
    """Make the console of results."""
    return _console(stderr=False)


def notes() -> Console:
    """Make the console of progress and notes, on standard error."""
    return _console(stderr=True)


def _console(*, stderr: bool) -> Console:
    console = _Screen(stderr=stderr, highlight=False, markup=False, emoji=False)
    console.push_render_hook(_Shown())
    if console.width < _NARROWEST:  # COLUMNS=0, or a terminal that does not tell
        console.width = _USUAL
    return console


def signs_of(console: Console) -> Signs:
    """Choose the signs that a console can show."""
    return _ASCII if console.options.ascii_only else _UNICODE


def note(text: str) -> None:
    """Print one line on standard error."""
    notes().print(text, style="dim", soft_wrap=True)


@contextlib.contextmanager
def patience(text: str) -> Iterator[None]:
    """Explain a wait, if it turns out to be one."""
    timer = threading.Timer(_PATIENCE, note, (text,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextlib.contextmanager
def progress(what: str, unit: str) -> Iterator[Advance]:
    """Show how far the work is and how long it will take: a bar, or lines where nobody watches."""
    console = notes()
    if not console.is_terminal:
        yield _lines(console, what, unit)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TextColumn(f"{unit},"),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    with Progress(*columns, console=console, transient=True, expand=True) as bars:
        task = bars.add_task(printable(what), total=None)

        def advance(done: int, total: int) -> None:
            if bars.tasks[0].total is None:  # what was there before must not count as speed
                bars.reset(task, completed=done, total=total)
            bars.update(task, completed=done, total=total)

        yield advance


@contextlib.contextmanager
def resumed(units: str) -> Iterator[Advance]:
    """Show how far a run is that goes on where it stopped; tell what is there, what is kept."""
    done = total = 0
    try:
        with progress(units, units) as bar:

            def advance(so_far: int, in_all: int) -> None:
                nonlocal done, total
                if not total and so_far:
                    note(f"{so_far} of {in_all} {units} are there already")
                done, total = so_far, in_all
                bar(so_far, in_all)

            yield advance
    except KeyboardInterrupt:
        note(
            f"interrupted: {done} of {total} {units} are kept; the same command goes on from there"
        )
        raise


def _lines(console: Console, what: str, unit: str) -> Advance:
    start = last = time.monotonic()
    first = -1

    def advance(done: int, total: int) -> None:
        nonlocal last, first
        now = time.monotonic()
        first = done if first < 0 else first
        if now - last >= _EVERY and first < done < total:
            last = now
            left = (now - start) / (done - first) * (total - done)
            console.print(f"{what}: {done}/{total} {unit}, {left:.0f} s left", soft_wrap=True)

    return advance


@contextlib.contextmanager
def showing_compilation() -> Iterator[None]:
    """Show a moving sign with seconds while kernels are compiled, once after an install."""
    from meal_bayes.planners import watch_compilation

    sign = _Sign("compiling the planner, once after an install")
    try:
        with watch_compilation(sign.start, sign.stop):
            yield
    finally:
        sign.stop()


class _Sign:
    """A line on standard error that counts seconds; where nobody watches, one line is all."""

    def __init__(self, text: str) -> None:
        self._text, self._console, self._ended = text, notes(), threading.Event()
        self._began: float | None = None
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        if self._began is None:
            self._began = time.monotonic()
            if not self._console.is_terminal:
                note(f"{self._text} ...")
        if self._console.is_terminal and self._thread is None:
            self._ended.clear()
            self._thread = threading.Thread(target=self._move, args=(self._began,), daemon=True)
            self._thread.start()

    def _move(self, began: float) -> None:
        for sign in itertools.cycle("-\\|/"):
            seconds = time.monotonic() - began
            self._write(f"\r{sign} {self._text}: {seconds:.0f} s ")
            if self._ended.wait(0.1):
                break
        self._write("\r\033[K")

    def _write(self, text: str) -> None:
        self._console.file.write(text)
        self._console.file.flush()

    def stop(self) -> None:
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
