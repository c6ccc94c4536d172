"""Factored .pomdpx, the input of SARSOP (APPL's `pomdpsol`): x is observed, y hidden.

The layout is that of the authors' files: y is one variable of 2^N values, a percept is one
observation of K^N values, and `na` is the observation of everything that shows none.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from meal_bayes.momdp.exchange import Exchange, exchange, most_frequent, number, whole_file
from meal_bayes.momdp.flat import percept_probabilities
from meal_bayes.momdp.model import MOMDP


def write_pomdpx(momdp: MOMDP, path: str | Path, *, forbid_illegal: bool = False) -> None:
    """Write a MOMDP as .pomdpx; the file is there only once it is whole.

    Alpha vectors of a solver run over y in the query's bit order, observed values over x.

    Parameters
    ----------
    momdp : the problem.
    path : missing folders are made, a file of that name is replaced.
    forbid_illegal : price illegal behaviors below every report, as formats know no legality; by
        default they cost and do what the diagram says.

    Raises
    ------
    SettingsError : what a file cannot hold (finite precision, several latent classes a truth, too
        many attributes, a diagram where Pr(percept | behavior, x') depends on x), or no place to
        write.
    """
    tables = exchange(momdp, forbid_illegal=forbid_illegal)
    with whole_file(path) as file:
        file.writelines(f"{line}\n" for line in _lines(momdp, tables))


def _lines(momdp: MOMDP, tables: Exchange) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="ISO-8859-1"?>'
    yield '<pomdpx version="0.1" id="meal">'
    yield f"<Discount>{number(momdp.discount)}</Discount>"
    yield from _variables(tables)
    yield from _start(momdp, tables)
    yield from _transitions(momdp, tables)
    yield from _observations(momdp, tables)
    yield from _rewards(tables)
    yield "</pomdpx>"


def _variables(tables: Exchange) -> Iterator[str]:
    hidden = [f"y{name}" for name in tables.y_names]
    yield "<Variable>"
    yield (
        '<StateVar vnamePrev="x0v" vnameCurr="x1v" fullyObs="true">'
        f"{_values(tables.x_names)}</StateVar>"
    )
    yield f'<StateVar vnamePrev="y0v" vnameCurr="y1v">{_values(hidden)}</StateVar>'
    yield f'<ObsVar vname="o">{_values((*tables.percept_names, "na"))}</ObsVar>'
    yield f'<ActionVar vname="a">{_values(tables.action_names)}</ActionVar>'
    yield '<RewardVar vname="r"/>'
    yield "</Variable>"


def _values(names: Iterable[str]) -> str:
    return f"<ValueEnum>{' '.join(names)}</ValueEnum>"


def _start(momdp: MOMDP, tables: Exchange) -> Iterator[str]:
    yield "<InitialStateBelief>"
    yield from _table("x0v", "null", [_entry("-", np.eye(len(tables.x_names))[momdp.start])])
    yield from _table("y0v", "null", [_entry("-", tables.prior)])
    yield "</InitialStateBelief>"


def _transitions(momdp: MOMDP, tables: Exchange) -> Iterator[str]:
    end = np.eye(len(tables.x_names))[-1]
    yield "<StateTransitionFunction>"
    yield from _table(
        "x1v",
        "a x0v",
        (
            _entry(f"{tables.action_names[e]} {tables.x_names[x]} -", row)
            for e in range(momdp.n_behaviors)
            for x, row in enumerate(tables.transition[e])
            if row[-1] != 1
        ),
        first=_entry("* * -", end),
    )
    identity = "<Entry><Instance>* - -</Instance><ProbTable>identity</ProbTable></Entry>"
    yield from _table("y1v", "a y0v", [identity])
    yield "</StateTransitionFunction>"


def _observations(momdp: MOMDP, tables: Exchange) -> Iterator[str]:
    nothing = np.eye(len(tables.percept_names) + 1)[-1]
    yield "<ObsFunction>"
    yield from _table("o", "a x1v y1v", _percepts(momdp, tables), first=_entry("* * * -", nothing))
    yield "</ObsFunction>"


def _percepts(momdp: MOMDP, tables: Exchange) -> Iterator[str]:
    for e, name in enumerate(tables.action_names[: momdp.n_behaviors]):
        percepts = percept_probabilities(momdp, e)  # (Y,Z-1)
        for x in np.flatnonzero(tables.comes[e]):
            comes = tables.comes[e, x]
            for y, row in zip(tables.y_names, percepts, strict=True):
                instance = f"{name} {tables.x_names[x]} y{y} -"
                yield _entry(instance, [*(comes * row), 1 - comes])


def _rewards(tables: Exchange) -> Iterator[str]:
    yield "<RewardFunction>"
    yield '<Func><Var>r</Var><Parent>a x0v y0v</Parent><Parameter type="TBL">'
    for action, name in enumerate(tables.action_names):
        reward = tables.reward[:, :, action]  # (X-1,Y)
        base = most_frequent(reward)
        yield _reward(f"{name} * *", base)
        everywhere = (reward == reward[0]).all(axis=0)  # (Y,) whatever x is
        for y in np.flatnonzero(everywhere & (reward[0] != base)):
            yield _reward(f"{name} * y{tables.y_names[y]}", reward[0, y])
        for x, y in np.argwhere(~everywhere & (reward != base)):
            yield _reward(f"{name} {tables.x_names[x]} y{tables.y_names[y]}", reward[x, y])
        yield _reward(f"{name} {tables.x_names[-1]} *", 0.0)
    yield "</Parameter></Func>"
    yield "</RewardFunction>"


def _table(
    variable: str, parents: str, entries: Iterable[str], *, first: str = ""
) -> Iterator[str]:
    yield f'<CondProb><Var>{variable}</Var><Parent>{parents}</Parent><Parameter type="TBL">'
    if first:
        yield first
    yield from entries
    yield "</Parameter></CondProb>"


def _entry(instance: str, row: Iterable[float]) -> str:
    numbers = " ".join(number(value) for value in row)
    return f"<Entry><Instance>{instance}</Instance><ProbTable>{numbers}</ProbTable></Entry>"


def _reward(instance: str, value: float) -> str:
    return f"<Entry><Instance>{instance}</Instance><ValueTable>{number(value)}</ValueTable></Entry>"
