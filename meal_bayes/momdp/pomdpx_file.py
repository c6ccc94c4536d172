"""Factored .pomdpx, the input of SARSOP (APPL's `pomdpsol`): x is observed, y hidden.

The layout is that of the authors' files: y is one variable of 2^N values, a percept is one
observation of K^N values, and `na` is the observation of everything that shows none.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from meal_bayes.files import draft_of
from meal_bayes.momdp.exchange import (
    FileTables,
    file_tables,
    most_frequent,
    number,
    percept_probabilities,
)
from meal_bayes.momdp.model import MOMDP


def write_pomdpx(momdp: MOMDP, path: str | Path) -> None:
    """Write a MOMDP as .pomdpx; the file is there only once it is whole.

    Alpha vectors of a solver run over y in the query's bit order, observed values over x.

    Parameters
    ----------
    momdp : MOMDP
        The problem.
    path : str | Path
        Missing folders are made, a file of that name is replaced.

    Raises
    ------
    SettingsError
        What a file cannot hold: finite precision, several latent classes a truth, too many
        attributes, or a diagram where Pr(percept | behavior, x') depends on x.
    OutputError
        The file cannot be written.
    """
    tables = file_tables(momdp)
    with draft_of(path) as draft, draft.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(f"{line}\n" for line in _lines(momdp, tables))


def _lines(momdp: MOMDP, tables: FileTables) -> Iterator[str]:
    states, actions, n_x = tables.x_names, tables.action_names, len(tables.x_names)
    hidden = [f"y{name}" for name in tables.y_names]
    yield '<?xml version="1.0" encoding="ISO-8859-1"?>'
    yield '<pomdpx version="0.1" id="meal">'
    yield f"<Discount>{number(momdp.discount)}</Discount>"
    yield "<Variable>"
    yield f'<StateVar vnamePrev="x0v" vnameCurr="x1v" fullyObs="true">{_values(states)}</StateVar>'
    yield f'<StateVar vnamePrev="y0v" vnameCurr="y1v">{_values(hidden)}</StateVar>'
    yield f'<ObsVar vname="o">{_values((*tables.percept_names, "na"))}</ObsVar>'
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
    for e, x in np.argwhere(tables.transition[:, :, -1] != 1):
        yield _entry(f"{tables.action_names[e]} {tables.x_names[x]} -", tables.transition[e, x])


def _percepts(momdp: MOMDP, tables: FileTables) -> Iterator[str]:
    yield _entry("* * * -", np.eye(len(tables.percept_names) + 1)[-1])
    for e, name in enumerate(tables.action_names[: momdp.n_behaviors]):
        percepts = percept_probabilities(momdp, e)  # (Y,Z-1)
        for x in np.flatnonzero(tables.comes[e]):
            comes = tables.comes[e, x]
            for y, row in zip(tables.y_names, percepts, strict=True):
                yield _entry(f"{name} {tables.x_names[x]} y{y} -", [*(comes * row), 1 - comes])


def _rewards(tables: FileTables) -> Iterator[str]:
    for action, name in enumerate(tables.action_names):
        reward = tables.reward[:-1, :, action]  # (X-1,Y)
        base = most_frequent(reward)
        yield _entry(f"{name} * *", [base], "ValueTable")
        everywhere = (reward == reward[0]).all(axis=0)  # (Y,) whatever x is
        for y in np.flatnonzero(everywhere & (reward[0] != base)):
            yield _entry(f"{name} * y{tables.y_names[y]}", [reward[0, y]], "ValueTable")
        for x, y in np.argwhere(~everywhere & (reward != base)):
            instance = f"{name} {tables.x_names[x]} y{tables.y_names[y]}"
            yield _entry(instance, [reward[x, y]], "ValueTable")
        yield _entry(f"{name} {tables.x_names[-1]} *", [0.0], "ValueTable")


def _entry(instance: str, row: Iterable[float], table: str = "ProbTable") -> str:
    numbers = " ".join(map(number, row))
    return f"<Entry><Instance>{instance}</Instance><{table}>{numbers}</{table}></Entry>"
