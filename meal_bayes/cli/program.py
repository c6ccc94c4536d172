"""The command-line program: its exit codes, and its errors in one line."""

import contextlib
import io
import logging
import os
import sys
import warnings
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from meal_bayes.errors import DownloadError, MealBayesError, OutputError

FAILED = 2  # exit code of errors that the user can fix: a value, a file of wrong content
SYSTEM = 1  # of errors of the system: a full disk, missing rights, a closed stream
INTERRUPTED = 130  # by Ctrl-C, or by a closed pipe
_LONGEST = 2000  # characters of an error


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
        _show_warnings()
        try:
            _check_text(sys.argv[1:] if args is None else args)
            code = super().main(args, *rest, **{**extra, "standalone_mode": False})
            sys.stdout.flush()
        except (KeyboardInterrupt, click.Abort):
            _leave(INTERRUPTED)
        except BrokenPipeError:
            _close_output()
            _leave(INTERRUPTED)
        except click.UsageError as fault:
            hint = f" Try: {fault.ctx.command_path} --help" if fault.ctx is not None else ""
            _fail(f"{fault.format_message()}{hint}")
        except (OutputError, DownloadError) as fault:
            _fail(str(fault), SYSTEM)
        except (MealBayesError, click.ClickException) as fault:
            _fail(str(fault))
        except OSError as fault:
            _fail(_system_message(fault), SYSTEM)
        except MemoryError:
            _fail("There is not enough memory; ask for less at a time, or close others.", SYSTEM)
        _leave(code if isinstance(code, int) else 0)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; interruptions end without click's messages."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            _close_output()
            raise click.Abort from None
        except KeyboardInterrupt:
            raise click.Abort from None


def _hold_streams() -> None:
    """Open the standard streams that are closed, as the next file would get their numbers."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    closed = sys.stdout is None
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115, PTH123
    plain = sys.__stderr__
    if plain is not None and sys.stderr is plain:
        sys.stderr = _Notes(plain.buffer, plain.encoding, "replace", line_buffering=True)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError):  # a test's stream may not have it
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]
    if closed:
        _fail("Standard output is closed, so nothing could be shown; give it a place.", SYSTEM)


def _check_text(arguments: Sequence[str]) -> None:
    """Check that arguments are UTF-8 text, as logs and pages are."""
    for text in arguments:
        try:
            text.encode()
        except UnicodeEncodeError:
            shown = os.fsencode(text).decode("utf-8", "backslashreplace")
            raise click.UsageError(
                f"{shown!r} is not UTF-8 text; rename the file, or set a UTF-8 locale."
            ) from None
        if "\0" in text:
            raise click.UsageError(f"{text!r} holds a zero byte; leave it out.")


class _Notes(io.TextIOWrapper):
    """Standard error that drops text which cannot be written, as on a full disk."""

    def write(self, text: str) -> int:
        """Write text, or drop it."""
        try:
            return super().write(text)
        except BrokenPipeError:
            raise
        except OSError:
            self._drop_rest()
            return len(text)

    def flush(self) -> None:
        """Flush, or drop the rest."""
        try:
            super().flush()
        except BrokenPipeError:
            raise
        except OSError:
            self._drop_rest()

    def _drop_rest(self) -> None:
        """Redirect to the null device, or the interpreter would try again at its end."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)


class _Warnings(logging.Handler):
    """Log handler that prints a warning in one line."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        from meal_bayes.cli.console import note

        note(f"{record.levelname.lower()}: {' '.join(record.getMessage().split())}")


def _show_warnings() -> None:
    # Names are data: in figures, what the font does not have is drawn as a box.
    warnings.filterwarnings("ignore", message="Glyph .* missing from font")
    log = logging.getLogger("meal_bayes")
    if not any(isinstance(handler, _Warnings) for handler in log.handlers):
        log.addHandler(_Warnings(logging.WARNING))


def _system_message(fault: OSError) -> str:
    why = fault.strerror or str(fault) or type(fault).__name__
    if fault.filename is not None:
        return f"{fault.filename}: {why}; give another place, or repair this one."
    return f"The output cannot be written, or a file read: {why}; give it another place."


def _fail(message: str, code: int = FAILED) -> NoReturn:
    from meal_bayes.cli.console import printable

    line = printable(" ".join(message.split()))
    if len(line) > _LONGEST:
        line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
    with contextlib.suppress(OSError):  # standard error may be closed
        click.echo(f"error: {line}", err=True)
    if code == SYSTEM:
        _close_output()
    _leave(code)


def _close_output() -> None:
    """Redirect buffered output to the null device, or the interpreter would fail at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(nowhere, sys.stdout.fileno())


def _leave(code: int) -> NoReturn:
    sys.exit(code)
