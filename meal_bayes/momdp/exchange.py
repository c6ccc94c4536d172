"""What a MOMDP becomes in a file for other solvers: the tables and checks that formats share."""

import contextlib
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.files import draft_of
from meal_bayes.momdp.flat import reward_table
from meal_bayes.momdp.model import MOMDP

LARGEST = 1_000_000  # numbers in a file; as .pomdp some 60 MB, more than solvers get through

_SAME = 1e-9  # probabilities that differ by less are rounded alike
_RESERVED = {
    "T", "O", "R", "discount", "values", "reward", "cost", "states", "actions", "observations",
    "start", "include", "exclude", "uniform", "identity", "reset", "term", "na", "done", "null",
}  # fmt: skip


class Exchange(NamedTuple):
    """A MOMDP as tables of what can be written down, with names that every parser takes.

    Attributes
    ----------
    x_names : (X,) states.
    y_names : (Y,) bits of the values, the query's first attribute leading.
    action_names : (A,) behaviors, then reports.
    percept_names : (Z-1,) levels, the first attribute leading.
    transition : (E,X,X) Pr(x' | x, behavior).
    comes : (E,X) Pr(a percept comes | behavior, x').
    moves : (E,X) whether the behavior leads to x' from another x.
    reward : (X-1,Y,A), none in `term`.
    prior : (Y,) Pr(y).
    """

    x_names: tuple[str, ...]
    y_names: tuple[str, ...]
    action_names: tuple[str, ...]
    percept_names: tuple[str, ...]
    transition: NDArray[np.float64]
    comes: NDArray[np.float64]
    moves: NDArray[np.bool_]
    reward: NDArray[np.float64]
    prior: NDArray[np.float64]


def exchange(momdp: MOMDP, *, forbid_illegal: bool = False) -> Exchange:
    """Convert a MOMDP to the tables of a file.

    As in `flatten`, percepts never run out, and every behavior may be chosen everywhere.

    Parameters
    ----------
    momdp : the problem.
    forbid_illegal : let illegal behaviors end the trial at a price below every report, so that no
        solver takes one. By default they cost and do what the diagram says.

    Raises
    ------
    SettingsError : finite precision, whose state would have to carry the percept counts; several
        latent classes a truth; a file beyond `LARGEST`; a diagram where Pr(percept | behavior,
        x') depends on x.
    """
    _check(momdp)
    n_y, end = 2 ** len(momdp.query), momdp.terminal
    transition, observation_probability = (
        momdp.transition.copy(),
        momdp.observation_probability.copy(),
    )
    reward = reward_table(momdp, n_y)[:-1].reshape(end, n_y, momdp.n_actions)
    if forbid_illegal:
        e, x = np.nonzero(~momdp.legal.T[:, :end])
        transition[e, x] = np.eye(end + 1)[end]
        observation_probability[e, x] = 0.0
        reward[x, :, e] = (momdp.incorrect - 1.0 - momdp.cost[e])[:, None]
    comes, moves = _arrivals(momdp, transition, observation_probability)
    y_names = tuple(f"{y:0{len(momdp.query)}b}" for y in range(n_y))
    separator = "" if momdp.levels <= 10 else "_"  # digits
    levels = np.ndindex((momdp.levels,) * len(momdp.query))
    reports = tuple(f"a{name}" for name in y_names)
    return Exchange(
        x_names=(*_plain(momdp.x_names[:-1], ()), "term"),
        y_names=y_names,
        action_names=(*_plain(momdp.behavior_names, reports), *reports),
        percept_names=tuple("p" + separator.join(map(str, index)) for index in levels),
        transition=transition,
        comes=comes,
        moves=moves,
        reward=reward,
        prior=np.where(momdp.query.values, momdp.prior, 1 - momdp.prior).prod(axis=1),
    )


def _check(momdp: MOMDP) -> None:
    if not np.isinf(momdp.precision).all() or not momdp.class_is_truth:
        raise SettingsError(
            "A POMDP file cannot hold rows of finite precision, or several latent classes a "
            "truth; build the MOMDP with precision=inf and without `latent_classes` (Eq. 8)."
        )
    n_y, n_z = 2 ** len(momdp.query), momdp.levels ** len(momdp.query)
    pairs = int(
        momdp.observation_probability.any(axis=1).sum()
    )  # behaviors and the x' they perceive at
    size = n_y * (pairs * n_z + n_y + momdp.n_behaviors * momdp.terminal)  # O, rewards, T
    if size > LARGEST:
        raise SettingsError(
            f"{len(momdp.query)} attributes make a file of {size:.2g} numbers; files end at "
            f"{LARGEST:.0e}. Ask fewer attributes, or use a planner of this package."
        )


def _arrivals(
    momdp: MOMDP, transition: NDArray[np.float64], observation_probability: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Compute Pr(percept | behavior, x'), and whether x' can be entered; both (E,X)."""
    comes = np.zeros(transition.shape[:2])
    moves = np.zeros(transition.shape[:2], dtype=bool)
    for e, target in np.ndindex(momdp.n_behaviors, momdp.terminal):
        sources = np.flatnonzero(transition[e, :-1, target] > 0)
        if not len(sources):
            continue
        rates = observation_probability[e, sources, target]
        if np.ptp(rates) > _SAME:
            most, least = (sources[int(i)] for i in (rates.argmax(), rates.argmin()))
            names = momdp.x_names
            raise SettingsError(
                f"{momdp.behavior_names[e]!r} arrives at {names[target]!r} from {names[most]!r} "
                f"with a percept in {rates.max():.0%} of the cases, from {names[least]!r} in "
                f"{rates.min():.0%}; .pomdp and .pomdpx know only Pr(z | action, x'). Forbid "
                "illegal behaviors, if it is one that stays where it is, or give the diagram a "
                "state of its own for each."
            )
        comes[e, target] = rates[0]
        moves[e, target] = (sources != target).any()
    return comes, moves


def _plain(names: Iterable[str], taken: Iterable[str]) -> tuple[str, ...]:
    """Turn names into identifiers of the formats, all different."""
    used, out = {*taken, *_RESERVED}, []
    for name in names:
        word = re.sub(r"[^A-Za-z0-9_]", "_", name)[:60]
        word = word if word[:1].isalpha() else f"n{word}"
        while word in used:
            word += "_"
        used.add(word)
        out.append(word)
    return tuple(out)


def number(value: float) -> str:
    """Write a number so that it reads back equal, with a digit on both sides of the point."""
    text = repr(float(value))
    return np.format_float_positional(value, trim="0") if "e" in text else text


def most_frequent(values: NDArray[np.float64]) -> float:
    """Return the value of most entries: files state it once and list the others."""
    found, counts = np.unique(values, return_counts=True)
    return float(found[counts.argmax()])


@contextlib.contextmanager
def whole_file(path: str | Path) -> Iterator[TextIO]:
    """Open a text file that gets its name only once it is whole; missing folders are made.

    Raises
    ------
    OutputError : the file cannot be written.
    """
    with draft_of(path) as draft, draft.open("w", encoding="ascii", newline="\n") as file:
        yield file
