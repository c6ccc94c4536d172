"""How the program ends: quietly, or with one line that teaches."""

import contextlib
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from meal_bayes.errors import MealBayesError

FAILED = 2  # exit code of every failure that is told in one line
INTERRUPTED = 130  # by Ctrl-C, or by a reader that went away


class Section(click.Group):
    """A group of commands; alone it shows its help."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Take nothing for `--help`."""
        return super().parse_args(ctx, args or ["--help"])

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the commands in the order they were added."""
        return list(self.commands)


class Program(Section):
    """The whole: every failure that a user can mend is one line on standard error."""

    def main(self, args: Sequence[str] | None = None, *rest: Any, **extra: Any) -> NoReturn:
        """Run a command line and exit."""
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(AttributeError):  # a test's stream may not have it
                stream.reconfigure(errors="replace")  # type: ignore[union-attr]
        try:
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
        except (MealBayesError, click.ClickException) as fault:
            _fail(str(fault))
        except OSError as fault:
            _fail(f"{fault.filename}: {fault.strerror}." if fault.filename else str(fault))
        _leave(code if isinstance(code, int) else 0)

    def invoke(self, ctx: click.Context) -> Any:
        """Keep interruptions from click, which would say more of them than there is to say."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            _close_output()
            raise click.Abort from None
        except KeyboardInterrupt:
            raise click.Abort from None


def _fail(message: str) -> NoReturn:
    click.echo(f"error: {' '.join(message.split())}", err=True)
    _leave(FAILED)


def _close_output() -> None:
    """Let what is still buffered go nowhere, or the interpreter would complain at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with contextlib.suppress(OSError, ValueError):
        os.dup2(nowhere, sys.stdout.fileno())


def _leave(code: int) -> NoReturn:
    sys.exit(code)
