"""Does the paper hold? What it claims, a row a claim, read off the results of the items."""

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatch
from typing import Any, NamedTuple

from paper_repro import frame
from paper_repro.statements import CONSTRUCTED, FALLS, STANDS, UNDECIDED

_SHORT = {STANDS: "stand", FALLS: "fall", None: "not run"}  # of several
IN_PART, NOT_RUN = "in part", "not run yet"
_FEW = 2.0  # numbers below have three decimals


class Claim(NamedTuple):
    """A claim of the paper with what came of it.

    Attributes
    ----------
    says, where : the claim, and its places in the paper.
    item, column, because : what answers it, in which column, and why in that one.
    outcome : of all its statements together.
    counts : how many statements have each outcome.
    effects : estimate and interval of each, or the rule of a fact.
    older : whether it was run by an earlier version, or with other percept tables.
    """

    says: str
    where: str
    item: str
    column: str
    because: str
    outcome: str
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

    It stands, or falls, where all that is decided does and nothing is left open; where some stand
    it holds in part; else it is undecided.

    >>> outcome_of(["stands", "undecided"]), outcome_of(["undecided", "undecided"])
    ('in part', 'undecided')
    """
    kinds = set(outcomes) - {None, CONSTRUCTED}
    if not kinds:
        return NOT_RUN if None in outcomes or not outcomes else CONSTRUCTED
    if len(kinds) == 1 and None not in outcomes:
        return str(next(iter(kinds)))
    return IN_PART if STANDS in kinds else FALLS if FALLS in kinds else UNDECIDED


def sentence(rows: Sequence[Claim]) -> str:
    """Say in one sentence how many claims hold, for a reader to quote."""
    number = {kind: [row.outcome for row in rows].count(kind)
              for kind in (STANDS, IN_PART, FALLS, UNDECIDED, NOT_RUN)}  # fmt: skip
    told = ", ".join(f"{n} {_counted(kind, n)}" for kind, n in number.items() if n)
    lead = next(row for row in rows if row.says.startswith("MORC is more accurate"))
    effect = "; ".join(lead.effects)
    return (f"Of {len(rows)} claims of the paper, each judged in the column that can answer it, "
            f"{told}. The main one, that planning is more accurate than a fixed sequence, "
            f"{_counted(lead.outcome, 1)}" + (f": {effect}." if effect else "."))  # fmt: skip


def _counted(kind: str, n: int) -> str:
    one = {STANDS: "stands", IN_PART: "stands in part", FALLS: "falls",
           UNDECIDED: "is undecided", NOT_RUN: "is not run yet"}  # fmt: skip
    many = {STANDS: "stand", IN_PART: "stand in part", FALLS: "fall",
            UNDECIDED: "are undecided", NOT_RUN: "are not run yet"}  # fmt: skip
    return (one if n == 1 else many)[kind]


def _claim(entry: Mapping[str, Any]) -> Claim:
    result = frame.read_result(entry["item"])
    rows = chosen(entry, result["statements"]) if result else []
    outcomes = [row["outcome"] for row in rows]
    number = {kind: outcomes.count(kind) for kind in dict.fromkeys(outcomes)}
    counts = ", ".join(f"{n} {_SHORT.get(kind, kind) if n > 1 else kind or 'not run'}"
                       for kind, n in number.items())  # fmt: skip
    return Claim(
        entry["says"], entry["where"], entry["item"], entry["column"], entry["because"],
        outcome_of(outcomes),
        counts if len(number) > 1 else "",
        tuple(f"{label}{effect}" for row, label in zip(rows, labels(rows), strict=True)
              if (effect := _effect(row))),
        older=result is not None and entry["column"] in frame.older_columns(entry["item"]),
    )  # fmt: skip


def labels(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what tells statements apart, each with a colon: their texts less what all share.

    >>> labels([{"text": "best in reward at 1 attribute"}, {"text": "best in cost at 1 attribute"}])
    ['reward: ', 'cost: ']
    >>> labels([{"text": "best at 2 attributes"}, {"text": "best at 3 attributes"}])
    ['2 attributes: ', '3 attributes: ']
    """
    if len(rows) < 2:
        return [""] * len(rows)
    texts = [row["text"].split(" ") for row in rows]
    shortest = min(map(len, texts))

    def shared(words: list[list[str]]) -> int:
        places = (n for n in range(shortest) if len({text[n] for text in words}) > 1)
        return next(places, shortest)

    start = shared(texts)
    end = min(shared([text[::-1] for text in texts]), shortest - start)
    if end and texts[0][-end].startswith("attribute") and texts[0][-end - 1] != texts[1][-end - 1]:
        end -= 1  # a word that goes with the number before it
    return [" ".join(text[start : len(text) - end]).strip(":, ") + ": " for text in texts]


def _effect(row: Mapping[str, Any]) -> str:
    """Show the estimate with its interval at its level, or what a fact rests on."""
    if row["outcome"] is None:
        return ""
    if row["estimate"] is None:
        return str(row["rule"])
    estimate, (low, high) = row["estimate"], row["interval"]
    digits = 3 if max(abs(estimate), abs(low), abs(high)) < _FEW else 1
    of_zero = row["rule"].partition(", and")[0].endswith((" above 0", " below 0"))
    sign = "+" if of_zero else ""
    seconds = " s" if row["rule"].partition(" is ")[0].endswith(", s") else ""
    form = f"{sign}.{digits}f"
    return f"{estimate:{form}} [{low:{form}}, {high:{form}}]{seconds}"


def _escaped(pattern: str) -> str:
    """Let brackets in a pattern stand for themselves."""
    return pattern.replace("[", "[[]")
