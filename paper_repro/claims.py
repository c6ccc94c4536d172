"""Does the paper hold? What it claims, a row a claim, read off the results of the items."""

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatch
from typing import Any, NamedTuple

from paper_repro import frame
from paper_repro.statements import (
    CONSTRUCTED,
    FALLS,
    OUTCOMES,
    RECORDED,
    STANDS,
    THEIRS,
    UNDECIDED,
)

_SHORT = {STANDS: "stand", FALLS: "fall", None: "not run"}  # of several
IN_PART = "in part"
NOT_RUN = "not run yet"
ACCURACIES = 2.0  # numbers below have three decimals, others one
_WORDS = {  # of an outcome, for one claim and for several
    STANDS: ("stands", "stand"),
    IN_PART: ("stands in part", "stand in part"),
    FALLS: ("falls", "fall"),
    UNDECIDED: ("is undecided", "are undecided"),
    NOT_RUN: ("is not run yet", "are not run yet"),
}
_SHOWN = 3  # statements whose effects are shown one by one; of more, what they come to


class Claim(NamedTuple):
    """A claim of the paper with what came of it.

    Attributes
    ----------
    says, where : the claim, and its places in the paper.
    item, column, because : what answers it, in which column, and why in that one.
    outcome : of all its statements together.
    elsewhere : how many of the same statements have each outcome in the other of both columns, and
        in an item that has them by another planner.
    counts : how many statements have each outcome.
    effects : estimate and interval of each, or the rule of a fact; of many, what they come to.
    older : whether an earlier version ran it.
    """

    says: str
    where: str
    item: str
    column: str
    because: str
    outcome: str
    elsewhere: str
    counts: str
    effects: tuple[str, ...]
    older: bool


def claims() -> tuple[Claim, ...]:
    """Read every claim of claims.toml off the results that are there."""
    return tuple(_claim(entry) for entry in frame.read_table("claims.toml")["claim"])


def chosen(entry: Mapping[str, Any], statements: Iterable[Mapping[str, Any]]) -> list[Any]:
    """Return the statements that answer a claim, in their order."""
    return [
        row
        for row in statements
        if row["protocol"] == entry["column"]
        and any(fnmatch(row["text"], _escaped(pattern)) for pattern in entry["statements"])
    ]


def outcome_of(outcomes: Sequence[str | None]) -> str:
    """Return the outcome of a claim from those of its statements.

    It stands where all do, and falls where what is decided falls; where only some stand it holds in
    part; where nothing is decided it is undecided.

    >>> outcome_of(["stands", "undecided"]), outcome_of(["undecided", "undecided"])
    ('in part', 'undecided')
    """
    kinds = set(outcomes) - {None, CONSTRUCTED}
    if not kinds:
        return NOT_RUN if None in outcomes or not outcomes else CONSTRUCTED
    if len(kinds) == 1 and None not in outcomes:
        return str(next(iter(kinds)))
    if STANDS in kinds:
        return IN_PART
    return FALLS if FALLS in kinds else UNDECIDED


def sentence(rows: Sequence[Claim]) -> str:
    """Say in one sentence how many claims hold, for a reader to quote."""
    outcomes = [row.outcome for row in rows]
    number = {kind: outcomes.count(kind) for kind in _WORDS}
    told = ", ".join(f"{n} {_counted(kind, n)}" for kind, n in number.items() if n)
    lead = next(row for row in rows if row.says.startswith("MORC is more accurate"))
    effect = "; ".join(lead.effects)
    text = (
        f"Of {len(rows)} claims of the paper, each judged in the column that can answer it, "
        f"{told}. The main one, that planning is more accurate than a fixed sequence, "
        f"{_counted(lead.outcome, 1)}"
    )
    return f"{text}: {effect}." if effect else f"{text}."


def _counted(kind: str, n: int) -> str:
    """Return the words for one claim of an outcome, or for several."""
    one, several = _WORDS[kind]
    return one if n == 1 else several


def _claim(entry: Mapping[str, Any]) -> Claim:
    """Read a claim off the statements that answer it, and count the same ones elsewhere."""
    result = frame.read_result(entry["item"])
    rows = chosen(entry, result["statements"]) if result else []
    outcomes = [row["outcome"] for row in rows]
    (other,) = {THEIRS, RECORDED} - {entry["column"]}
    places = {f"in *{other}*": (entry["item"], other)}
    for beside in entry.get("beside", ()):
        places |= {f"in *{column}* of {beside}": (beside, column) for column in (THEIRS, RECORDED)}
    told = {place: _counted_there(entry, *at) for place, at in places.items()}
    return Claim(
        says=entry["says"],
        where=entry["where"],
        item=entry["item"],
        column=entry["column"],
        because=entry["because"],
        outcome=outcome_of(outcomes),
        elsewhere="; ".join(f"{place} {counts}" for place, counts in told.items() if counts),
        counts=counted(outcomes) if len(set(outcomes)) > 1 else "",
        effects=effects_of(rows),
        older=result is not None and frame.is_marked_older(entry["item"]),
    )


def _counted_there(entry: Mapping[str, Any], item: str, column: str) -> str:
    """Say how many of a claim's statements have each outcome in a column of an item."""
    result = frame.read_result(item)
    rows = chosen({**entry, "column": column}, result["statements"]) if result else []
    return counted([row["outcome"] for row in rows])


def counted(outcomes: Sequence[str | None]) -> str:
    """Say how many statements have each outcome, in its order; nothing where none is run.

    >>> counted(["undecided", "stands", "stands", None])
    '2 stand, 1 undecided, 1 not run'
    """
    number = {kind: outcomes.count(kind) for kind in (*OUTCOMES, None) if kind in outcomes}
    if set(number) <= {None}:
        return ""
    told = []
    for kind, n in number.items():
        several = n > 1 or kind is None
        told.append(f"{n} {_SHORT.get(kind, kind) if several else kind}")
    return ", ".join(told)


def effects_of(rows: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    """Say what the statements of a claim come to, short enough for a row.

    A few are shown one by one, with what they measure where that differs. Of more, those that fall
    are named where they are printed numbers with margins; else each quantity has the range of its
    estimates and of its half widths.
    """
    run = [row for row in rows if row["outcome"] is not None]
    quantities = [quantity_of(row) for row in run]
    if len(run) == 1 and run[0]["estimate"] is not None:
        return (f"{_in_words(quantities[0])}: {_effect(run[0])}",)
    if len(run) <= _SHOWN:
        return _one_by_one(run, quantities)
    if all(" is in [" in row["rule"] for row in run):
        fallen = [
            f"{_shortened(row['text'])}: {_effect(row)}" for row in run if row["outcome"] == FALLS
        ]
        return (f"of {len(run)} printed numbers {len(fallen)} fall", *fallen)
    ranges = [
        _range(name, [row for row in run if quantity_of(row) == name])
        for name in dict.fromkeys(quantities)
    ]
    decided = [row for row in run if row["outcome"] in {STANDS, FALLS}]
    # Where a few of many are decided, a reader wants to know which.
    shown = decided if len(decided) < len(run) and len(decided) <= _SHOWN else []
    named = [f"{row['outcome']}: {_shortened(row['text'])} {_effect(row)}" for row in shown]
    return (*ranges, *named)


def _one_by_one(rows: Sequence[Mapping[str, Any]], quantities: Sequence[str]) -> tuple[str, ...]:
    """Show the effect of each statement, with what it measures where that differs."""
    mixed = len(set(quantities)) > 1
    told = []
    names = labels([row["text"] for row in rows])
    for row, label, quantity in zip(rows, names, quantities, strict=True):
        measured = f"{_in_words(quantity)} " if mixed else ""
        told.append(f"{label}{measured}{_effect(row)}")
    return tuple(told)


def quantity_of(row: Mapping[str, Any]) -> str:
    """Return what the interval of a statement is of, without its unit and its bound.

    >>> quantity_of({"rule": "reward: the lead over random is above 0, and 3 more"})
    'reward'
    >>> quantity_of({"rule": "hours less its is below 0"})
    'hours less its'
    """
    return str(row["rule"]).partition(" is ")[0].partition(": ")[0].removesuffix(", s")


def _in_words(quantity: str) -> str:
    """Write out the words by which a rule names a difference.

    >>> _in_words("accuracy less its")
    "accuracy minus the other agent's"
    """
    written = quantity.replace(" less its", " minus the other agent's").replace(" less ", " minus ")
    return written.replace("iterative_morc's", "Iterative MORC's")


def labels(texts: Sequence[str]) -> list[str]:
    """Return what tells statements apart, each with a colon: their texts less what all share.

    >>> labels(["best in reward at 1 attribute", "best in cost at 1 attribute"])
    ['reward: ', 'cost: ']
    >>> labels(["best at 2 attributes", "best at 3 attributes"])
    ['2 attributes: ', '3 attributes: ']
    """
    if len(texts) < 2:
        return [""] * len(texts)
    words = [_shortened(text).split(" ") for text in texts]
    shortest = min(map(len, words))

    def shared(sides: list[list[str]]) -> int:
        places = (n for n in range(shortest) if len({side[n] for side in sides}) > 1)
        return next(places, shortest)

    start = shared(words)
    end = min(shared([side[::-1] for side in words]), shortest - start)
    if end and words[0][-end].startswith("attribute") and words[0][-end - 1] != words[1][-end - 1]:
        end -= 1  # a word that goes with the number before it
    return [" ".join(side[start : len(side) - end]).strip(":, ") + ": " for side in words]


def _shortened(text: str) -> str:
    """Say a statement's text by the short words of claims.toml."""
    for long, short in frame.read_table("claims.toml")["short"].items():
        text = text.replace(long, short)
    return text


def _effect(row: Mapping[str, Any]) -> str:
    """Show the estimate with its interval at its level, or what a fact rests on."""
    if row["estimate"] is None:
        return str(row["rule"])
    estimate = row["estimate"]
    low, high = row["interval"]
    form, unit = _form([row])
    return f"{estimate:{form}} [{low:{form}}, {high:{form}}]{unit}"


def _range(quantity: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Show the least and the largest estimate of a quantity, and how wide its intervals are."""
    if len(rows) == 1:
        return f"{_in_words(quantity)}: {_effect(rows[0])}"
    form, unit = _form(rows)
    estimates = [row["estimate"] for row in rows]
    halves = [(row["interval"][1] - row["interval"][0]) / 2 for row in rows]
    plain = form.removeprefix("+")
    return (
        f"{_in_words(quantity)}: {min(estimates):{form}} to {max(estimates):{form}}{unit}"
        f" (of {len(rows)}, ± {min(halves):{plain}} to {max(halves):{plain}})"
    )


def _form(rows: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Return the number format of some effects, signed where they are compared with 0; the unit."""
    ends = [abs(value) for row in rows for value in (row["estimate"], *row["interval"])]
    bounds = [row["rule"].partition(", and")[0] for row in rows]
    sign = "+" if all(rule.endswith((" above 0", " below 0")) for rule in bounds) else ""
    unit = " s" if rows[0]["rule"].partition(" is ")[0].endswith(", s") else ""
    return f"{sign}.{3 if max(ends) < ACCURACIES else 1}f", unit


def _escaped(pattern: str) -> str:
    """Let brackets in a pattern stand for themselves."""
    return pattern.replace("[", "[[]")
