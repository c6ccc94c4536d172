"""The command-line program: its exit codes, and its errors in one line."""

import ast
import contextlib
import inspect
import itertools
import logging
import os
import sys
import textwrap
import warnings
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from meal_bayes.cli.console import note, printable
from meal_bayes.errors import DownloadError, MealBayesError, OutputError

# Exit codes, each a row of docs/how-to/command-line.md.
FAILED = 2  # errors that the user can fix: a value, a file of wrong content
SYSTEM = 1  # errors of the system: a full disk, missing rights, a closed stream
UNSOUND = 1  # what was checked is not as it should be: a log, files of a data set, a table
ABSENT = 1  # a log does not hold the steps of the trial that was asked for
UNREAD = 3  # `log recover` passed over bytes, and perhaps trials
INTERRUPTED = 130  # Ctrl-C, or a closed pipe
_FILES = "meal_bayes.files"  # whose log names the files that are replaced
_LONGEST = 2000  # characters of an error
_AROUND = 30  # characters shown around one that no text can hold
_NO_DOCSTRINGS = 2  # level of optimization (`python -OO`) that takes docstrings away


class Section(click.Group):
    """A group of commands, which shows its help without a command."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse no arguments as `--help`."""
        return super().parse_args(ctx, args or ["--help"])

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the commands in the order they were added."""
        return list(self.commands)


class Program(Section):
    """The program: every error that a user can fix is one line on standard error."""

    def main(self, args: Sequence[str] | None = None, *rest: Any, **extra: Any) -> NoReturn:
        """Run a command line and exit."""
        _hold_streams()
        _show_notes()
        if sys.flags.optimize >= _NO_DOCSTRINGS:
            _restore_help(self)
        try:
            _check_words(sys.argv[1:] if args is None else args)
            code = super().main(args, *rest, **{**extra, "standalone_mode": False})
            sys.stdout.flush()
        except (KeyboardInterrupt, click.Abort, BrokenPipeError):
            _close_output()
            sys.exit(INTERRUPTED)
        except click.UsageError as fault:
            hint = f" Try: {fault.ctx.command_path} --help" if fault.ctx is not None else ""
            _fail(f"{fault.format_message()}{hint}")
        except (OutputError, DownloadError) as fault:
            _fail(str(fault), SYSTEM)
        except (MealBayesError, click.ClickException) as fault:
            _fail(str(fault))
        except OSError as fault:
            why = fault.strerror or str(fault) or type(fault).__name__
            text = f"The output cannot be written, or a file read: {why}; give it another place."
            if fault.filename is not None:
                text = f"{fault.filename}: {why}; give another place, or repair this one."
            _fail(text, SYSTEM)
        # Logs and pages are UTF-8; a file's name need not be.
        except UnicodeEncodeError as fault:
            part = fault.object[max(fault.start - _AROUND, 0) : fault.end + _AROUND]
            readable = part.encode("utf-8", "backslashreplace").decode()
            _fail(f"{readable!r} is not UTF-8 text; rename the file, or set a UTF-8 locale.")
        except MemoryError:
            _fail("There is not enough memory; ask for less at a time, or close others.", SYSTEM)
        sys.exit(code if isinstance(code, int) else 0)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; interruptions end without click's messages."""
        try:
            return super().invoke(ctx)
        except (BrokenPipeError, KeyboardInterrupt):
            raise click.Abort from None


def _check_words(words: Sequence[str]) -> None:
    """Refuse an empty word, such as a shell makes of a variable that is not set."""
    for before, word in itertools.pairwise(["", *words]):
        option = word.removesuffix("=") if word.startswith("--") and word.endswith("=") else ""
        if not word.strip() or option:
            what = option or (f"what follows {before}" if before else "the first word")
            raise click.UsageError(f"{what} is empty on the command line; give it a value.")


def _hold_streams() -> None:
    """Check that results can be shown, and let every stream show every name."""
    if sys.stderr is None:  # it was closed; notes are lost
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    if sys.stdout is None:
        _fail("Standard output is closed, so nothing could be shown; give it a place.", SYSTEM)
    # A name that the terminal's encoding lacks is shown by a question mark, not by an error.
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError):  # a test's stream may not have it
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]


class _Notes(logging.Handler):
    """Log handler that prints a note in one line, and says of a warning that it is one."""

    def emit(self, record: logging.LogRecord) -> None:
        kind = "" if record.levelno < logging.WARNING else f"{record.levelname.lower()}: "
        note(kind + " ".join(record.getMessage().split()))


def _warning_line(message: Warning | str, *_: object, **__: object) -> str:
    """Return a warning of Python as one line, without the place in the code that warns."""
    return f"warning: {printable(' '.join(str(message).split()))}\n"


def _show_notes() -> None:
    # Names are data: in figures, what the font does not have is drawn as a box.
    warnings.filterwarnings("ignore", message="Glyph .* missing from font")
    warnings.formatwarning = _warning_line
    log = logging.getLogger("meal_bayes")
    if not any(isinstance(handler, _Notes) for handler in log.handlers):
        notes = _Notes()
        notes.addFilter(lambda record: record.levelno >= logging.WARNING or record.name == _FILES)
        log.addHandler(notes)
    logging.getLogger(_FILES).setLevel(logging.INFO)


def _restore_help(command: click.Command) -> None:
    """Read the help of a command, and of those in it, from the source of their functions."""
    if command.callback is not None:
        source = textwrap.dedent(inspect.getsource(command.callback))
        (function,) = ast.parse(source).body
        if isinstance(function, ast.FunctionDef):
            command.help = ast.get_docstring(function)
    for inner in command.commands.values() if isinstance(command, click.Group) else ():
        _restore_help(inner)


def _fail(message: str, code: int = FAILED) -> NoReturn:
    line = printable(" ".join(message.split()))
    if len(line) > _LONGEST:
        line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
    with contextlib.suppress(OSError):  # standard error may be closed
        click.echo(f"{click.style('error:', fg='red')} {line}", err=True)
    if code == SYSTEM:
        _close_output()
    sys.exit(code)


def _close_output() -> None:
    """Redirect buffered output to the null device, or the interpreter would fail at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(nowhere, sys.stdout.fileno())
