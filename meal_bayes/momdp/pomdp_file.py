"""Cassandra's .pomdp, the format of pomdp-solve and of the authors' code: one flat state.

The format has no observed x. So that a solver can infer x, there are two observations
without a percept: `na`, nothing has happened or the trial is over, and `done`, x has changed. (In
the authors' files success and failure of `reinit` look the same, which hides x.)
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.momdp.exchange import Exchange, exchange, most_frequent, number, whole_file
from meal_bayes.momdp.flat import percept_probabilities
from meal_bayes.momdp.model import MOMDP

_NOTHING, _DONE, _END = "na", "done", "term"


def write_pomdp(momdp: MOMDP, path: str | Path, *, forbid_illegal: bool = False) -> None:
    """Write a MOMDP as .pomdp; the file is there only once it is whole.

    State `s<x>p<y>` is (x, y), with the bits of y in the query's order; `term` is the last state.

    Parameters
    ----------
    momdp : the problem.
    path : missing folders are made, a file of that name is replaced.
    forbid_illegal : price illegal behaviors below every report, as formats know no legality; by
        default they cost and do what the diagram says.

    Raises
    ------
    SettingsError : what a file cannot hold (finite precision, several latent classes a truth, too
        many attributes, a diagram where Pr(percept | behavior, x') depends on x, or where x could
        not be inferred from the observation), or no place to write.
    """
    tables = exchange(momdp, forbid_illegal=forbid_illegal)
    _check_observable(momdp, tables)
    with whole_file(path) as file:
        file.writelines(f"{line}\n" for line in _lines(momdp, tables))


def _check_observable(momdp: MOMDP, tables: Exchange) -> None:
    """Check that every observation identifies x', given the x before it."""
    for e, x in np.ndindex(momdp.n_behaviors, momdp.terminal):
        shown: dict[str, int] = {}
        for target in np.flatnonzero(tables.transition[e, x] > 0):
            for sign in _signs(tables, e, int(target)):
                if sign in shown:
                    one, other = (momdp.x_names[i] for i in (shown[sign], target))
                    raise SettingsError(
                        f"{momdp.behavior_names[e]!r} in {momdp.x_names[x]!r} leads to {one!r} or "
                        f"{other!r} with the same observation, and .pomdp has no observed x; "
                        "write .pomdpx instead."
                    )
                shown[sign] = int(target)


def _signs(tables: Exchange, e: int, target: int) -> Iterator[str]:
    """Yield the observations that a behavior can give at its target, percepts as one."""
    if target == len(tables.x_names) - 1:
        yield _NOTHING
        return
    if tables.comes[e, target] > 0:
        yield "a percept"
    if tables.comes[e, target] < 1:
        yield _DONE if tables.moves[e, target] else _NOTHING


def _lines(momdp: MOMDP, tables: Exchange) -> Iterator[str]:
    living = [[f"s{x}p{y}" for y in tables.y_names] for x in range(momdp.terminal)]
    start = np.zeros((momdp.terminal, len(tables.y_names)))
    start[momdp.start] = tables.prior
    yield f"# query: {_remark(', '.join(momdp.query.attributes))}"
    for x, name in enumerate(momdp.x_names[:-1]):
        yield f"# s{x}: {_remark(name)}"
    yield f"discount: {number(momdp.discount)}"
    yield "values: reward"
    yield f"states: {' '.join(map(' '.join, living))} {_END}"
    yield f"actions: {' '.join(tables.action_names)}"
    yield f"observations: {' '.join(tables.percept_names)} {_NOTHING} {_DONE}"
    yield f"start: {' '.join(map(number, start.ravel()))} 0.0"
    for action, name in enumerate(tables.action_names):
        yield f"T: {name} : * : {_END} 1.0"
        yield f"O: {name} : * : {_NOTHING} 1.0"
        if action < momdp.n_behaviors:
            yield from _transitions(name, tables.transition[action], living)
            yield from _observations(momdp, tables, action, living)
        yield from _rewards(name, tables.reward[:, :, action], living)


def _transitions(name: str, rows: NDArray[np.float64], living: list[list[str]]) -> Iterator[str]:
    for x, row in enumerate(rows[:-1]):
        if row[-1] == 1:
            continue
        for y, state in enumerate(living[x]):
            yield f"T: {name} : {state} : {_END} {number(row[-1])}"
            for target in np.flatnonzero(row[:-1]):
                yield f"T: {name} : {state} : {living[target][y]} {number(row[target])}"


def _observations(momdp: MOMDP, tables: Exchange, e: int, living: list[list[str]]) -> Iterator[str]:
    name, percepts = tables.action_names[e], percept_probabilities(momdp, e)  # (Y,Z-1)
    for x in np.flatnonzero(tables.comes[e] + tables.moves[e]):
        comes, silent = tables.comes[e, x], 1 - tables.comes[e, x]
        done = bool(tables.moves[e, x])
        for state, row in zip(living[x], percepts, strict=True):
            yield f"O: {name} : {state} : {_NOTHING} {number(0.0 if done else silent)}"
            if done and silent > 0:
                yield f"O: {name} : {state} : {_DONE} {number(silent)}"
            for z in np.flatnonzero(comes * row):
                yield f"O: {name} : {state} : {tables.percept_names[z]} {number(comes * row[z])}"


def _rewards(name: str, reward: NDArray[np.float64], living: list[list[str]]) -> Iterator[str]:
    base = most_frequent(reward)
    yield f"R: {name} : * : * : * {number(base)}"
    yield f"R: {name} : {_END} : * : * 0.0"
    for x, y in np.argwhere(reward != base):
        yield f"R: {name} : {living[x][y]} : * : * {number(reward[x, y])}"


def _remark(text: str) -> str:
    """Format any text as a comment of one line."""
    return " ".join(text.encode("ascii", "replace").decode().split())[:200]
