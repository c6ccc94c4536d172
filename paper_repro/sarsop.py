"""SARSOP [Kurniawati2008], the paper's solver: an adapter to an installed `pomdpsol`."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.momdp import MOMDP, answer_value, initial_belief, write_pomdpx
from meal_bayes.momdp.belief import percepts_left
from meal_bayes.momdp.model import DISCOUNT
from meal_bayes.planners import Decision, History
from meal_bayes.planners.solver import choose

_PROGRAM = "pomdpsol"
_VARIABLE = "MEAL_BAYES_POMDPSOL"
_QUOTED = 400  # characters of the program's output that a message quotes
Vectors = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]
_HOME = "https://github.com/AdaCompNUS/sarsop"


@dataclass(frozen=True, slots=True)
class Sarsop:
    """Settings; the precision that it reaches in its time depends on the machine.

    Attributes
    ----------
    seconds : float
        CPU s of solving; by default the paper's budget.
    precision : float
        Gap between its bounds at which it ends before that.
    program : str | Path | None
        By default MEAL_BAYES_POMDPSOL, or `pomdpsol` on the PATH.
    patience : float
        s that all else may take: to read the problem, to bound its values, to write the policy,
        and to wait for other programs.
    """

    seconds: float = 5.0
    precision: float = 1e-3
    program: str | Path | None = None
    patience: float = 600.0

    def __post_init__(self) -> None:
        times = (self.seconds, self.precision, self.patience)
        if not all(0 < value < np.inf for value in times):
            raise SettingsError(
                f"Sarsop needs seconds, precision and patience above 0, and finite; found {self}."
            )

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "AlphaVectorPolicy":
        """Write the problem, run `pomdpsol` in a folder of its own, read its policy."""
        program = _find(self.program)
        vectors = _vectors(problem_file(momdp), program, self)
        try:
            return AlphaVectorPolicy(momdp, *vectors)
        except SettingsError as fault:
            raise DataError(f"{program} wrote a policy that does not fit: {fault}") from fault


def problem_file(momdp: MOMDP) -> bytes:
    """Return a MOMDP as .pomdpx."""
    if momdp.discount >= 1:
        raise SettingsError(f"SARSOP needs a discount below 1; the paper's is {DISCOUNT:g}.")
    with TemporaryDirectory(prefix="meal_bayes-") as name:
        path = Path(name) / "problem.pomdpx"
        write_pomdpx(momdp, path)
        return path.read_bytes()


@lru_cache(maxsize=64)
def _vectors(problem: bytes, program: str, settings: Sarsop) -> Vectors:
    """Solve a problem in a folder of its own; one that was solved before is not solved again."""
    with TemporaryDirectory(prefix="meal_bayes-") as name:
        folder = Path(name)
        (folder / "problem.pomdpx").write_bytes(problem)
        # SARSOP ends when its bounds are near, or else when its time is over, with what it has.
        limits = ["--timeout", f"{settings.seconds:g}", "--precision", f"{settings.precision:g}"]
        command = [program, *limits, "--output", "out.policy", "problem.pomdpx"]
        output = _run(command, folder, settings.seconds + settings.patience)
        if not (folder / "out.policy").is_file():
            raise SettingsError(f"{program} wrote no policy; its output ends: {output}")
        return read_policy(folder / "out.policy")


def _find(program: str | Path | None) -> str:
    """Find the program: the given one, the environment's, or the one on the PATH."""
    named = program or os.environ.get(_VARIABLE) or _PROGRAM
    path = shutil.which(str(named))
    if path is None:
        raise SettingsError(
            f"No program {str(named)!r} here. Build pomdpsol ({_HOME}) and put it on the PATH, or "
            f"name it in {_VARIABLE}; or plan with Factored, which needs no other program."
        )
    return str(Path(path).resolve())


def _run(command: Sequence[str], folder: Path, seconds: float) -> str:
    """Run a program to its end or the end of patience; return the end of its output, one line."""
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            timeout=seconds,
            check=False,
        )
    except subprocess.TimeoutExpired as fault:
        raise SettingsError(
            f"{command[0]} had not ended after {seconds:g} s; ask fewer attributes, or give "
            "more patience."
        ) from fault
    except OSError as fault:
        raise SettingsError(f"{command[0]} cannot be run ({fault}).") from fault
    text = "".join(c if c.isprintable() else " " for c in done.stdout[-_QUOTED:])
    end = " ".join(text.split()) or "none"
    if done.returncode:
        raise SettingsError(
            f"{command[0]} ended with code {done.returncode}; its output ends: {end}"
        )
    return end


@dataclass(frozen=True, slots=True)
class AlphaVectorPolicy:
    """Policy that starts the best plan of several: V(x, b) = max of the vectors of x times b.

    Answers need no vector, as their value is exact, and those of illegal behaviors are left out. A
    behavior that keeps x and whose percepts have run out (`limit`, which vectors know nothing of)
    is passed over. Truths are in the query's bit order, actions numbered as in the MOMDP.

    Attributes
    ----------
    momdp : MOMDP
    vectors : (V,Y) array
        Value of each plan by truth.
    x : (V,) int array
        Where it begins.
    action : (V,) int array
        Its first action.
    """

    momdp: MOMDP
    vectors: NDArray[np.float64]
    x: NDArray[np.int64]
    action: NDArray[np.int64]

    def __post_init__(self) -> None:
        momdp = self.momdp
        n = len(self.momdp.query)
        set_frozen(self, vectors=freeze(self.vectors))
        set_frozen(self, x=freeze(self.x, np.int64), action=freeze(self.action, np.int64))
        if self.vectors.shape[1] != 2**n:
            raise SettingsError(
                f"Alpha vectors of {self.vectors.shape[1]} values; {n} attributes have {2**n} "
                "(they may belong to another query)."
            )
        for name, numbers, count in (
            ("x", self.x, len(momdp.x_names)),
            ("actions", self.action, momdp.n_actions),
        ):
            if numbers.min() < 0 or numbers.max() >= count:
                raise SettingsError(
                    f"Alpha vectors with {name} from {numbers.min()} to {numbers.max()}; the MOMDP "
                    f"has {count} (they may belong to another one)."
                )

    @property
    def lower_bound(self) -> float:
        """Value of the best plan at the start of a trial, exact but for `limit`."""
        belief = initial_belief(self.momdp)
        vectors, _ = self._plans(belief.x)
        planned = float((vectors @ belief.joint).max(initial=-np.inf))
        # To answer at once has no vector, and is worth what the belief says.
        return max(planned, answer_value(self.momdp, belief))

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the best plan, or the best answer."""
        momdp = self.momdp
        belief = history.belief
        vectors, actions = self._plans(belief.x)
        values = np.full(momdp.n_behaviors, -np.inf)
        np.maximum.at(values, actions, vectors @ belief.joint)
        # A recording is not used twice in a trial: where all have been, a behavior that keeps x
        # shows nothing new, which the problem file cannot say.
        used_up = percepts_left(momdp, belief) <= 0
        values[used_up & (momdp.transition[:, belief.x, belief.x] == 1)] = -np.inf
        return Decision.exact(*choose(momdp, belief, values))

    def _plans(self, x: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return vectors and first behaviors of the plans that are legal at x."""
        legal = np.append(self.momdp.legal[x], False)
        rows = (self.x == x) & legal[np.minimum(self.action, self.momdp.n_behaviors)]
        return self.vectors[rows], self.action[rows]


def read_policy(path: Path) -> Vectors:
    """Read a .policy file: values (V,Y) of the vectors, their x (V,) and their actions (V,)."""
    try:
        every = ElementTree.fromstring(path.read_text("ascii")).find("AlphaVector")
        if every is None:
            raise ValueError("it has no <AlphaVector>")  # noqa: TRY301
        count = int(every.get("numVectors", ""))
        length = int(every.get("vectorLength", ""))
        if len(every) != count or not count:
            raise ValueError(f"found {len(every)} vectors; it promises {count}")  # noqa: TRY301
        vectors = np.array([_values(element, length) for element in every])
        x = np.array([int(element.get("obsValue", "")) for element in every])
        return vectors, x, np.array([int(element.get("action", "")) for element in every])
    except (ElementTree.ParseError, ValueError, LookupError, OSError) as fault:
        raise DataError(f"{path} is no policy of SARSOP ({fault}).") from fault


def _values(element: ElementTree.Element, length: int) -> NDArray[np.float64]:
    """Read the values of a vector: all of them, or those that are not 0 with their places."""
    values = np.array((element.text or "").split(), dtype=np.float64)
    if element.tag == "SparseVector":
        pairs = [(entry.text or "").split() for entry in element]
        values = np.zeros(length)
        values[[int(place) for place, _ in pairs]] = [float(value) for _, value in pairs]
    if values.shape != (length,) or not np.isfinite(values).all():
        raise ValueError(f"a vector has {len(values)} values; expected {length} finite ones")
    return values
