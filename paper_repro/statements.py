"""What the paper states, judged by an interval: it stands, it falls, or it is undecided.

Functions here take plain arrays and intervals. A statement about a difference compares agents on
the same tasks; objects (offline) or repeats (online) are the clusters of its interval.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.evaluation import Interval, paired_difference

STANDS, FALLS, UNDECIDED, CONSTRUCTED = OUTCOMES = (
    "stands",
    "falls",
    "undecided",
    "by construction",
)
_NONE = Interval(math.nan, math.nan, math.nan, math.nan)


@dataclasses.dataclass(frozen=True, slots=True)
class Evidence:
    """The outcome of a statement under one protocol, and what it rests on.

    Attributes
    ----------
    outcome : one of `OUTCOMES`.
    rule : when the statement stands.
    interval : of the decisive difference; nan where a fact decides.
    repeats : trials or repeats behind it.
    needed : repeats that would decide it if mean and spread stayed; None where it is decided, or
        where no number would.
    agents : whose further repeats could decide it.
    """

    outcome: str
    rule: str
    interval: Interval = _NONE
    repeats: int = 1
    needed: int | None = None
    agents: tuple[str, ...] = ()

    @property
    def decided(self) -> bool:
        """Whether more repeats are not called for."""
        return self.outcome != UNDECIDED


@dataclasses.dataclass(frozen=True, slots=True)
class Statement:
    """Something that the paper says of an item; None: not run in that protocol."""

    text: str
    recorded: Evidence | None  # on recorded percepts, or where no percept is drawn
    published: Evidence | None = None  # in the published code's protocol

    def as_dict(self) -> dict[str, str | int | None]:
        """Return the statement as results/ keep it."""
        own, code = self.recorded, self.published
        both = [one for one in (own, code) if one is not None]
        open_ = [one for one in both if not one.decided]
        counted = open_ or both
        needed = [one.needed for one in open_ if one.needed is not None]
        return {
            "text": self.text,
            "recorded": own.outcome if own else None,
            "published": code.outcome if code else None,
            "repeats": min((one.repeats for one in counted), default=0),
            "needed": max(needed, default=None),
        }


def mean_interval(values: ArrayLike, clusters: ArrayLike) -> Interval:
    """Return the mean with its 95 % interval over clusters.

    Where all cases are right, or all are wrong, it reaches by the rule of three.
    """
    x = np.asarray(values, float)
    found, reach = paired_difference(x, np.zeros_like(x), clusters), 3 / len(x)
    if x.min() == x.max() and x[0] in (0.0, 1.0):
        low, high = max(0.0, float(x[0]) - reach), min(1.0, float(x[0]) + reach)
        return Interval(float(x[0]), found.se, low, high)
    return found


def change_of_means(
    first: ArrayLike, first_clusters: ArrayLike, second: ArrayLike, second_clusters: ArrayLike
) -> Interval:
    """Return the mean of first - second where the tasks differ; clusters in both are paired."""
    sides = []
    for values, clusters in ((first, first_clusters), (second, second_clusters)):
        x, names = np.asarray(values, float), np.asarray(clusters)
        sides.append({name: x[names == name].mean() for name in np.unique(names)})
    shared = sorted(set(sides[0]) & set(sides[1]))
    means = [[side[name] for name in shared] for side in sides]
    return paired_difference(means[0], means[1], shared)


def above(
    interval: Interval, bound: float, repeats: int, agents: Sequence[str] = (), *, of: str = "it"
) -> Evidence:
    """Judge that a quantity exceeds a bound: the whole interval must lie above it.

    >>> above(Interval(2.0, 1.0, 0.5, 3.5), 0, 10).outcome
    'stands'
    >>> above(Interval(2.0, 1.0, -0.5, 4.5), 0, 10).needed
    16
    """
    rule = f"{of} is above {bound:g}"
    if interval.low > bound:
        return Evidence(STANDS, rule, interval, repeats, None, tuple(agents))
    if interval.high < bound:
        return Evidence(FALLS, rule, interval, repeats, None, tuple(agents))
    return _undecided(rule, interval, abs(interval.estimate - bound), repeats, agents)


def below(
    interval: Interval, bound: float, repeats: int, agents: Sequence[str] = (), *, of: str = "it"
) -> Evidence:
    """Judge that a quantity is less than a bound."""
    mean, se, low, high = interval
    turned = above(Interval(-mean, se, -high, -low), -bound, repeats, agents)
    return dataclasses.replace(turned, rule=f"{of} is below {bound:g}", interval=interval)


def within(
    interval: Interval, low: float, high: float, repeats: int, agents: Sequence[str] = (), *,
    of: str = "it",
) -> Evidence:  # fmt: skip
    """Judge that a quantity lies in a range: its whole interval must."""
    rule = f"{of} is in [{low:.5g}, {high:.5g}]"
    if low <= interval.low and interval.high <= high:
        return Evidence(STANDS, rule, interval, repeats, None, tuple(agents))
    if interval.high < low or interval.low > high:
        return Evidence(FALLS, rule, interval, repeats, None, tuple(agents))
    distance = min(abs(interval.estimate - low), abs(interval.estimate - high))
    return _undecided(rule, interval, distance, repeats, agents)


def every(parts: Iterable[Evidence]) -> Evidence:
    """Judge that all parts stand; one that falls decides, and the weakest is what is shown."""
    found = list(parts)
    for outcome in (FALLS, UNDECIDED, STANDS):
        own = [part for part in found if part.outcome == outcome]
        if own:
            shown = min(own, key=lambda part: part.interval.estimate)
            agents = tuple(dict.fromkeys(name for part in own for name in part.agents))
            needed = [part.needed for part in own if part.needed is not None]
            return dataclasses.replace(shown, needed=max(needed, default=None), agents=agents)
    raise ValueError("no parts")


def best(
    differences: Mapping[str, Interval], repeats: int, agents: Sequence[str] = (), *,
    of: str = "measure",
) -> Evidence:  # fmt: skip
    """Judge that one is ahead of every other; a tie with any of them leaves it undecided.

    Parameters
    ----------
    differences : the one less each other, by the other's name.
    """
    return every(
        above(found, 0, repeats, (*agents, name), of=f"{of}: the lead over {name}")
        for name, found in differences.items()
    )


def at_least(count: int, parts: Sequence[Evidence], *, of: str) -> Evidence:
    """Judge that no fewer than `count` of the parts stand."""
    outcomes = [part.outcome for part in parts]
    rule = f"at least {count} of {len(parts)} {of}"
    share = Interval(float(outcomes.count(STANDS)), math.nan, outcomes.count(STANDS),
                     len(parts) - outcomes.count(FALLS))  # fmt: skip
    repeats = min(part.repeats for part in parts)
    agents = tuple(dict.fromkeys(name for part in parts for name in part.agents))
    if share.low >= count:
        return Evidence(STANDS, rule, share, repeats, None, agents)
    if share.high < count:
        return Evidence(FALLS, rule, share, repeats, None, agents)
    open_ = sorted(part.needed for part in parts if part.needed is not None)
    lacking = min(count - int(share.low), len(open_))
    return Evidence(UNDECIDED, rule, share, repeats, open_[lacking - 1] if open_ else None, agents)


def fact(holds: bool, rule: str) -> Evidence:
    """Judge what no luck enters."""
    return Evidence(STANDS if holds else FALLS, rule)


def constructed(rule: str) -> Evidence:
    """Mark what was fitted, or read back from settings: it is no evidence."""
    return Evidence(CONSTRUCTED, rule)


def joined(
    recorded: Mapping[str, Evidence | None] | None,
    published: Mapping[str, Evidence | None] | None,
) -> tuple[Statement, ...]:
    """Join the outcomes of both protocols, by text."""
    own, code = recorded or {}, published or {}
    texts = dict.fromkeys([*own, *code])
    return tuple(Statement(text, own.get(text), code.get(text)) for text in texts)


def counts(outcomes: Iterable[str | None]) -> dict[str, int]:
    """Count outcomes, those that are None left out."""
    found = list(outcomes)
    return {outcome: found.count(outcome) for outcome in OUTCOMES}


def verdict(statements: Sequence[Mapping[str, str | int | None]]) -> str:
    """Return the verdict on an item from its statements, with its counts.

    >>> verdict([{"recorded": "stands", "published": None}])
    'reproduced (1 stands)'
    """
    own, code = (counts(one[side] for one in statements) for side in ("recorded", "published"))  # type: ignore[misc]
    told = " (" + "; in the published protocol ".join(filter(None, map(_told, (own, code)))) + ")"
    if not statements:
        return "nothing to judge"
    if not _judged(own):
        if _judged(code):
            return "not run on recordings" + (
                f" (in the published protocol {_told(code)})" if not _told(own) else told
            )
        return ("by construction" if own[CONSTRUCTED] or code[CONSTRUCTED] else "not run") + (
            told if _told(own) or _told(code) else ""
        )
    fell = [one for one in statements if one["recorded"] == FALLS]
    if fell:
        only = not code[FALLS] and all(one["published"] == STANDS for one in fell)
        word = "reproduced only in the published protocol" if only else "not reproduced"
    else:
        word = "undecided" if own[UNDECIDED] else "reproduced"
    return word + told


def _judged(found: Mapping[str, int]) -> int:
    return sum(found[outcome] for outcome in (STANDS, FALLS, UNDECIDED))


def _told(found: Mapping[str, int]) -> str:
    words = dict(zip(OUTCOMES, ("stands", "falls", "undecided", "by construction"), strict=True))
    plural = {STANDS: "stand", FALLS: "fall"}
    return ", ".join(
        f"{number} {plural.get(outcome, words[outcome]) if number > 1 else words[outcome]}"
        for outcome, number in found.items()
        if number
    )


def _undecided(
    rule: str, interval: Interval, distance: float, repeats: int, agents: Sequence[str]
) -> Evidence:
    """Leave it undecided, with the repeats whose interval would not reach the bound."""
    reach, needed = interval.high - interval.estimate, None
    if math.isfinite(reach) and distance > 0:
        needed = max(math.ceil(repeats * (reach / distance) ** 2), repeats + 1)
    return Evidence(UNDECIDED, rule, interval, repeats, needed, tuple(agents))
