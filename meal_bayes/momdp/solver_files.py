"""Files of a MOMDP for other solvers: Cassandra's .pomdp, and the .pomdpx of SARSOP.

*.pomdp*, the format of pomdp-solve and of the authors' code, has one flat state and no observed x.
So that a solver can infer x, there are two observations without a percept: `na`, nothing has
happened or the trial is over, and `done`, x has changed. (In the authors' files success and failure
of `reinit` look the same, which hides x.)

*.pomdpx*, the input of SARSOP (APPL's `pomdpsol`), is factored: x is observed, y hidden. The layout
is that of the authors' files: y is one variable of 2^N values, a percept is one observation of K^N
values, and `na` is the observation of everything that shows none.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import TERMINAL
from meal_bayes.errors import SettingsError
from meal_bayes.files import draft_of
from meal_bayes.momdp.flat_pomdp import (
    DONE,
    NOTHING,
    FileTables,
    file_tables,
    percept_probabilities,
)
from meal_bayes.momdp.model import MOMDP


def write_pomdp(momdp: MOMDP, path: str | Path) -> None:
    """Write a MOMDP as a .pomdp file; after an error, no file is written.

    State `s<x>p<y>` is (x, y), with the bits of y in the query's order; `term` is the last state.

    Parameters
    ----------
    momdp : MOMDP
        Decision problem.
    path : str | Path
        File to write. Missing folders are created, and an existing file is replaced.

    Raises
    ------
    SettingsError
        The file format cannot represent the MOMDP: the precision is finite, a truth has several
        latent classes, there are too many attributes, Pr(percept | behavior, x') depends on x, or
        (only for .pomdp) x cannot be inferred from the observation.
    OutputError
        The file cannot be written.
    """
    tables = file_tables(momdp)
    _check_observable(momdp, tables)
    _write(path, _pomdp(momdp, tables))


def write_pomdpx(momdp: MOMDP, path: str | Path) -> None:
    """Write a MOMDP as a .pomdpx file; parameters and errors are those of `write_pomdp`.

    The alpha vectors of a solver are indexed by y in the query's bit order, and the observed
    variable is x.
    """
    _write(path, _pomdpx(momdp, file_tables(momdp)))


def _write(path: str | Path, lines: Iterable[str]) -> None:
    with draft_of(path) as draft, draft.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(f"{line}\n" for line in lines)


def _check_observable(momdp: MOMDP, tables: FileTables) -> None:
    """Check that every observation identifies x', given the x before it."""
    silent = tables.comes < 1
    # (E,X,3) what can be observed on arrival at x': a percept, `done`, `na`
    signs = np.stack([tables.comes > 0, silent & tables.moves, silent & ~tables.moves], axis=2)
    reached = tables.transition[:, :-1] > 0
    alike = reached.astype(int) @ signs.astype(int)  # (E,X-1,3) x' that look the same
    for behavior, x, sign in np.argwhere(alike > 1):
        targets = np.flatnonzero(reached[behavior, x] & signs[behavior, :, sign])[:2]
        states = " or ".join(repr(momdp.x_names[i]) for i in targets)
        raise SettingsError(
            f"{momdp.behavior_names[behavior]!r} in {momdp.x_names[x]!r} leads to {states} "
            "with the same observation, and .pomdp has no observed x; write .pomdpx instead."
        )


def _pomdp(momdp: MOMDP, tables: FileTables) -> Iterator[str]:
    end = momdp.terminal
    percepts = tables.percept_names
    states = [[f"s{x}p{y}" for y in tables.y_names] for x in range(end)]
    start = np.zeros((end, len(tables.y_names)))
    start[momdp.start] = tables.prior
    yield f"# query: {_remark(momdp.query.text)}"
    for x, x_name in enumerate(momdp.x_names[:-1]):
        yield f"# s{x}: {_remark(x_name)}"
    yield f"# digits behind p, 1 true and 0 false: {_remark(', '.join(momdp.query.attributes))}"
    yield f"discount: {_number(momdp.discount)}"
    yield "values: reward"
    yield f"states: {' '.join(map(' '.join, states))} {TERMINAL}"
    yield f"actions: {' '.join(tables.action_names)}"
    yield f"observations: {' '.join(percepts)} {NOTHING} {DONE}"
    yield f"start: {' '.join(map(_number, start.ravel()))} 0.0"
    for action, name in enumerate(tables.action_names):
        yield f"T: {name} : * : {TERMINAL} 1.0"
        yield f"O: {name} : * : {NOTHING} 1.0"
        if action < momdp.n_behaviors:
            yield from _behavior(momdp, tables, action, states)
        reward = tables.reward[:-1, :, action]
        base = _most_frequent(reward)
        yield f"R: {name} : * : * : * {_number(base)}"
        yield f"R: {name} : {TERMINAL} : * : * 0.0"
        for x, y in np.argwhere(reward != base):
            yield f"R: {name} : {states[x][y]} : * : * {_number(reward[x, y])}"


def _behavior(
    momdp: MOMDP, tables: FileTables, behavior: int, states: list[list[str]]
) -> Iterator[str]:
    """Yield what a behavior leads to and shows, where it is not "ends, and shows nothing"."""
    name = tables.action_names[behavior]
    for x in np.flatnonzero(tables.transition[behavior, :-1, -1] != 1):
        row = tables.transition[behavior, x]
        for y, state in enumerate(states[x]):
            yield f"T: {name} : {state} : {TERMINAL} {_number(row[-1])}"
            for target in np.flatnonzero(row[:-1]):
                yield f"T: {name} : {state} : {states[target][y]} {_number(row[target])}"
    for x in np.flatnonzero(tables.comes[behavior] + tables.moves[behavior]):
        comes = tables.comes[behavior, x]
        silent = 1 - tables.comes[behavior, x]
        moves = tables.moves[behavior, x]
        for state, row in zip(states[x], percept_probabilities(momdp, behavior), strict=True):
            yield f"O: {name} : {state} : {NOTHING} {_number(0.0 if moves else silent)}"
            if moves and silent > 0:
                yield f"O: {name} : {state} : {DONE} {_number(silent)}"
            for z in np.flatnonzero(comes * row):
                yield f"O: {name} : {state} : {tables.percept_names[z]} {_number(comes * row[z])}"


def _remark(text: str) -> str:
    """Format any text as a comment of one line."""
    return " ".join(text.encode("ascii", "replace").decode().split())[:200]


def _pomdpx(momdp: MOMDP, tables: FileTables) -> Iterator[str]:
    states = tables.x_names
    actions = tables.action_names
    n_x = len(tables.x_names)
    hidden = [f"y{name}" for name in tables.y_names]
    yield '<?xml version="1.0" encoding="ISO-8859-1"?>'
    yield '<pomdpx version="0.1" id="meal">'
    yield f"<Discount>{_number(momdp.discount)}</Discount>"
    yield "<Variable>"
    yield f'<StateVar vnamePrev="x0v" vnameCurr="x1v" fullyObs="true">{_values(states)}</StateVar>'
    yield f'<StateVar vnamePrev="y0v" vnameCurr="y1v">{_values(hidden)}</StateVar>'
    yield f'<ObsVar vname="o">{_values((*tables.percept_names, NOTHING))}</ObsVar>'
    yield f'<ActionVar vname="a">{_values(actions)}</ActionVar>'
    yield '<RewardVar vname="r"/>'
    yield "</Variable>"
    yield "<InitialStateBelief>"
    yield from _table("CondProb", "x0v", "null", [_entry("-", np.eye(n_x)[momdp.start])])
    yield from _table("CondProb", "y0v", "null", [_entry("-", tables.prior)])
    yield "</InitialStateBelief>"
    yield "<StateTransitionFunction>"
    yield from _table("CondProb", "x1v", "a x0v", _transitions(tables))
    identity = "<Entry><Instance>* - -</Instance><ProbTable>identity</ProbTable></Entry>"
    yield from _table("CondProb", "y1v", "a y0v", [identity])
    yield "</StateTransitionFunction>"
    yield "<ObsFunction>"
    yield from _table("CondProb", "o", "a x1v y1v", _percepts(momdp, tables))
    yield "</ObsFunction>"
    yield "<RewardFunction>"
    yield from _table("Func", "r", "a x0v y0v", _rewards(tables))
    yield "</RewardFunction>"
    yield "</pomdpx>"


def _values(names: Iterable[str]) -> str:
    return f"<ValueEnum>{' '.join(names)}</ValueEnum>"


def _table(tag: str, variable: str, parents: str, entries: Iterable[str]) -> Iterator[str]:
    """Yield a table; later entries replace earlier ones."""
    yield f'<{tag}><Var>{variable}</Var><Parent>{parents}</Parent><Parameter type="TBL">'
    yield from entries
    yield f"</Parameter></{tag}>"


def _transitions(tables: FileTables) -> Iterator[str]:
    yield _entry("* * -", np.eye(len(tables.x_names))[-1])
    for behavior, x in np.argwhere(tables.transition[:, :, -1] != 1):
        instance = f"{tables.action_names[behavior]} {tables.x_names[x]} -"
        yield _entry(instance, tables.transition[behavior, x])


def _percepts(momdp: MOMDP, tables: FileTables) -> Iterator[str]:
    # Entries that a file does not state are 0. With a row of zeros for every action, x and y,
    # `pomdpsol` would need 45 s instead of 6 s to read a question about seven attributes.
    yield _entry(f"* * * {NOTHING}", [1.0])
    for behavior, name in enumerate(tables.action_names[: momdp.n_behaviors]):
        percepts = percept_probabilities(momdp, behavior)  # (Y,Z-1)
        for x in np.flatnonzero(tables.comes[behavior]):
            comes = tables.comes[behavior, x]
            for y, row in zip(tables.y_names, percepts, strict=True):
                yield _entry(f"{name} {tables.x_names[x]} y{y} -", [*(comes * row), 1 - comes])


def _rewards(tables: FileTables) -> Iterator[str]:
    for action, name in enumerate(tables.action_names):
        reward = tables.reward[:-1, :, action]  # (X-1,Y)
        base = _most_frequent(reward)
        yield _entry(f"{name} * *", [base], "ValueTable")
        everywhere = (reward == reward[0]).all(axis=0)  # (Y,) whatever x is
        for y in np.flatnonzero(everywhere & (reward[0] != base)):
            yield _entry(f"{name} * y{tables.y_names[y]}", [reward[0, y]], "ValueTable")
        for x, y in np.argwhere(~everywhere & (reward != base)):
            instance = f"{name} {tables.x_names[x]} y{tables.y_names[y]}"
            yield _entry(instance, [reward[x, y]], "ValueTable")
        yield _entry(f"{name} {tables.x_names[-1]} *", [0.0], "ValueTable")


def _entry(instance: str, row: Iterable[float], table: str = "ProbTable") -> str:
    numbers = " ".join(map(_number, row))
    return f"<Entry><Instance>{instance}</Instance><{table}>{numbers}</{table}></Entry>"


def _number(value: float) -> str:
    """Write a number so that it reads back equal, with a digit on both sides of the point."""
    return np.format_float_positional(float(value), trim="0")


def _most_frequent(values: NDArray[np.float64]) -> float:
    """Return the value of most entries: files state it once and list the others."""
    unique, counts = np.unique(values, return_counts=True)
    return float(unique[counts.argmax()])
