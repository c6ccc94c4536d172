"""SARSOP [Kurniawati2008], the field's standard solver: an adapter to an installed `pomdpsol`."""

import contextlib
import os
import shutil
import signal
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meal_bayes import processes
from meal_bayes.cache import temporary_folder
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.momdp.pomdpx_file import write_pomdpx
from meal_bayes.planners.point_based.alpha_vectors import AlphaVectorPolicy
from meal_bayes.planners.point_based.policy_file import read_policy

_PROGRAM = "pomdpsol"
_VARIABLE = "MEAL_BAYES_POMDPSOL"
_QUOTED = 400  # characters of the program's output that a message quotes
_HOME = "https://github.com/AdaCompNUS/sarsop"


@dataclass(frozen=True, slots=True)
class Sarsop:
    """Settings; the precision that it reaches in its time depends on the machine.

    Attributes
    ----------
    seconds : float
        s of solving; by default the paper's budget.
    precision : float
        Gap between its bounds at which it ends before that.
    program : str | Path | None
        By default MEAL_BAYES_POMDPSOL, or `pomdpsol` on the PATH.
    patience : float
        s that reading the problem and writing the policy may need besides.

    Raises
    ------
    SettingsError
        A time or precision that is not above 0.
    """

    seconds: float = 5.0
    precision: float = 1e-3
    program: str | Path | None = None
    patience: float = 60.0

    def __post_init__(self) -> None:
        times = (self.seconds, self.precision, self.patience)
        if not all(0 < value < np.inf for value in times):
            raise SettingsError(
                f"Sarsop needs seconds, precision and patience above 0, and finite; found {self}."
            )

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> AlphaVectorPolicy:
        """Write the problem, run `pomdpsol` in a folder of its own, read its policy.

        Raises
        ------
        SettingsError
            No such program; a problem that its format cannot hold; a program that fails or does not
            come to an end.
        DataError
            A policy that is not well formed, or of another problem.
        """
        program = _find(self.program)
        if momdp.discount >= 1:
            raise SettingsError("SARSOP needs a discount below 1; the paper's is 0.99.")
        with temporary_folder() as folder:
            write_pomdpx(momdp, folder / "problem.pomdpx")
            command = [
                program, "--timeout", f"{self.seconds:g}", "--precision", f"{self.precision:g}",
                "--output", "out.policy", "problem.pomdpx",
            ]  # fmt: skip
            _run(command, folder, self.seconds + self.patience)
            if not (folder / "out.policy").is_file():
                raise SettingsError(
                    f"{program} wrote no policy; its output ends: {_output(folder)}"
                )
            alpha = read_policy(folder / "out.policy")
        try:
            return AlphaVectorPolicy(momdp, alpha)
        except SettingsError as fault:
            raise DataError(f"{program} wrote a policy that does not fit: {fault}") from fault


def _find(program: str | Path | None) -> str:
    """Find the program: the given one, the environment's, or the one on the PATH."""
    named = program or os.environ.get(_VARIABLE) or _PROGRAM
    found = shutil.which(str(named))
    if found is None:
        raise SettingsError(
            f"No program {str(named)!r} here. Build pomdpsol ({_HOME}) and put it on the PATH, or "
            f"name it in {_VARIABLE}; or plan with Factored, which needs no other program."
        )
    return str(Path(found).resolve())


def _run(command: Sequence[str], folder: Path, seconds: float) -> None:
    """Run a program, without a shell, to its end or the end of patience."""
    with (folder / "output.txt").open("wb") as words:
        process = processes.start(
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=words, stderr=subprocess.STDOUT,
            start_new_session=True,
        )  # fmt: skip
        try:
            code = process.wait(timeout=seconds)
        except subprocess.TimeoutExpired as fault:
            raise SettingsError(
                f"{command[0]} had not ended after {seconds:g} s; ask fewer attributes, or give "
                "more patience."
            ) from fault
        finally:
            if process.returncode is None:
                _end(process)
    if code != 0:
        raise SettingsError(
            f"{command[0]} ended with code {code}; its output ends: {_output(folder)}"
        )


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Stop a program with all that it has started."""
    with contextlib.suppress(ProcessLookupError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()


def _output(folder: Path) -> str:
    """Return the end of a program's output, in one line."""
    with (folder / "output.txt").open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - _QUOTED))
        text = file.read(_QUOTED).decode("utf-8", errors="replace")
    return " ".join("".join(c if c.isprintable() else " " for c in text).split()) or "none"
