"""What the paper states, judged by intervals: it stands, it falls, or it is undecided.

A statement has parts, each an effect that has to lie in a range. It stands where the interval of
every part lies inside, and falls where that of one part lies outside. All statements of an item
under one protocol are a family: each is judged at its level by Holm [Holm1979].
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from fnmatch import fnmatch
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.evaluation import Estimate
from paper_repro.inference import LEVEL, holm, level_above, level_below, needed

STANDS = "stands"
FALLS = "falls"
UNDECIDED = "undecided"
CONSTRUCTED = "by construction"
OUTCOMES = (STANDS, FALLS, UNDECIDED, CONSTRUCTED)
THEIRS = "theirs"
RECORDED = "recorded"
PROTOCOLS = (THEIRS, RECORDED)


class Part(NamedTuple):
    """An effect that has to lie in a range."""

    of: str
    effect: Estimate
    low: float = -math.inf
    high: float = math.inf

    @property
    def inside(self) -> float:
        """The smallest level at which its interval lies inside."""
        return max(level_above(self.effect, self.low), level_below(self.effect, self.high))

    @property
    def outside(self) -> float:
        """The smallest level at which its interval lies outside."""
        return min(
            level_below(self.effect, self.low) if self.low > -math.inf else 2.0,
            level_above(self.effect, self.high) if self.high < math.inf else 2.0,
        )

    @property
    def room(self) -> float:
        """How many standard errors lie between the estimate and the nearest end."""
        nearest = min(abs(self.effect.estimate - end) for end in (self.low, self.high))
        return nearest / self.effect.se if self.effect.se > 0 else 0.0

    @property
    def rule(self) -> str:
        """When it stands, in words."""
        if self.high == math.inf:
            return f"{self.of} is above {self.low:.5g}"
        if self.low == -math.inf:
            return f"{self.of} is below {self.high:.5g}"
        return f"{self.of} is in [{self.low:.5g}, {self.high:.5g}]"

    def needed(self, level: float) -> int | None:
        """Return the splits that would decide it at 80 % power; None where no number would."""
        ends = [end for end in (self.low, self.high) if math.isfinite(end)]
        nearest = min(ends, key=lambda end: abs(self.effect.estimate - end))
        return needed(self.effect, nearest, level)


@dataclasses.dataclass(frozen=True, slots=True)
class Evidence:
    """What a statement rests on under one protocol: parts, or a fact.

    Attributes
    ----------
    parts : that have to hold; none where a fact decides.
    outcome, rule : of a fact, or of what is by construction.
    shown, at : what a fact rests on, and the level of its interval.
    """

    parts: tuple[Part, ...] = ()
    outcome: str = UNDECIDED
    rule: str = ""
    shown: Estimate | None = None
    at: float = LEVEL

    @property
    def level(self) -> float:
        """The smallest level at which it is decided: all parts inside, or any one outside."""
        return min(self._inside, self._outside)

    @property
    def _inside(self) -> float:
        # All have to hold: an intersection-union test, which needs no correction for their number.
        return max(part.inside for part in self.parts)

    @property
    def _outside(self) -> float:
        # Any one may fail: the chance of a false one grows with their number (Bonferroni).
        return len(self.parts) * min(part.outside for part in self.parts)

    def judge(self, level: float) -> dict[str, Any]:
        """Judge it at a level; the part that decides it, or keeps it open, is shown."""
        if not self.parts:
            facts: dict[str, Any] = dict.fromkeys(
                ("estimate", "interval", "units", "level", "needed", "smallest")
            )
            facts |= {"outcome": self.outcome, "rule": self.rule, "method": "a fact", "parts": 0}
            return facts | _told(self.shown, self.at)
        inside = self._inside
        outside = self._outside
        tested = {"parts": len(self.parts), "smallest": self.level}
        if outside <= level and outside < inside:
            part = min(self.parts, key=lambda part: part.outside)
            told = _told(part.effect, level / len(self.parts))
            return {"outcome": FALLS, "rule": part.rule, **told, **tested, "needed": None}
        # The weakest part is shown; by its room, where several are inside at a level of 0.
        part = max(self.parts, key=lambda part: (part.inside, -part.room))
        if part.outside <= level:  # a statement of many parts falls at a part's own level alone
            level /= len(self.parts)
        rule = part.rule
        if len(self.parts) > 1:
            rule += f", and {len(self.parts) - 1} more"
        stands = inside <= level
        units = None if stands else part.needed(level)
        return {
            "outcome": STANDS if stands else UNDECIDED,
            "rule": rule,
            **_told(part.effect, level),
            **tested,
            "needed": f"{units} {part.effect.cluster}" if units else None,
        }


def above(effect: Estimate, bound: float, *, of: str = "it") -> Evidence:
    """State that a quantity exceeds a bound.

    >>> above(Estimate(2.0, 0.1, 10), 0).judge(0.05)["outcome"]
    'stands'
    """
    return Evidence((Part(of, effect, low=bound),))


def below(effect: Estimate, bound: float, *, of: str = "it") -> Evidence:
    """State that a quantity is less than a bound."""
    return Evidence((Part(of, effect, high=bound),))


def within(effect: Estimate, low: float, high: float, *, of: str = "it") -> Evidence:
    """State that a quantity lies in a range."""
    return Evidence((Part(of, effect, low, high),))


def every(statements: Sequence[Evidence]) -> Evidence:
    """State that all of them hold."""
    return Evidence(tuple(part for entry in statements for part in entry.parts))


def best(differences: Mapping[str, Estimate], *, of: str) -> Evidence:
    """State that one is ahead of every other, from its differences by their names."""
    return every(
        [above(effect, 0, of=f"{of}: the lead over {n}") for n, effect in differences.items()]
    )


def fact(holds: bool, rule: str) -> Evidence:
    """Judge what no luck enters."""
    return Evidence(outcome=STANDS if holds else FALLS, rule=rule)


def constructed(rule: str) -> Evidence:
    """Mark what was fitted, is read back from settings, or is chance: it is no evidence."""
    return Evidence(outcome=CONSTRUCTED, rule=rule)


def placed(
    values: ArrayLike, printed: float, *, of: str, at_most: bool = False, level: float = LEVEL
) -> Evidence:
    """Judge one split of the paper by the 95 % prediction interval of one more of ours.

    It falls outside, and stays undecided inside: a single one contradicts or does not, it proves
    nothing.

    Parameters
    ----------
    values : (S,) one of each of our splits; nan where a split has none.
    printed : what the paper shows.
    of : what it is, for the rule.
    at_most : the paper shows this or less, so that an interval above it alone contradicts.
    level : of the interval; less than .05 where several are placed at once.
    """
    x = np.asarray(values, float)
    x = x[~np.isnan(x)]
    mean = float(x.mean()) if len(x) else math.nan
    # One more split differs from the mean of these by its own spread and by the mean's error.
    spread = float(x.std(ddof=1)) * math.sqrt(1 + 1 / len(x)) if len(x) > 1 else math.nan
    effect = Estimate(
        mean,
        spread,
        len(x),
        cluster="splits",
        method="prediction interval of one split",
    )
    _, _, low, high = effect.interval(1 - level)
    outcome = FALLS if printed < low or (printed > high and not at_most) else UNDECIDED
    number = f"{printed:.3g} at most" if at_most else f"{printed:.3g}"
    rule = f"{of} is {number}, as one more of our splits might give"
    return Evidence(outcome=outcome, rule=rule, shown=effect, at=level)


def placed_below(splits: Mapping[str, ArrayLike], printed: float, *, of: str) -> Evidence:
    """Judge that the paper shows no more than a number of several in one split.

    Each is placed among our splits at its part of 5 %; the one whose interval begins highest is
    shown, and decides.

    Parameters
    ----------
    splits : (S,) of each by its name, one of each of our splits.
    printed : what none exceeds in the paper.
    of : what they are, for the rule.
    """
    level = LEVEL / len(splits)  # Bonferroni: any one of them contradicts
    parts = [
        placed(values, printed, of=f"{name}'s {of}", at_most=True, level=level)
        for name, values in splits.items()
    ]
    first = max(parts, key=lambda part: part.shown.interval(1 - level).low if part.shown else 0.0)
    return dataclasses.replace(first, rule=f"{first.rule}, and {len(parts) - 1} more")


def judged(
    evidence: Mapping[str, Mapping[str, Evidence | None]], central: Sequence[str], where: str
) -> list[dict[str, Any]]:
    """Judge the statements of an item, protocol by protocol, as results/ keep them.

    Parameters
    ----------
    evidence : of statements by their text, by protocol; None where it is not run.
    central : patterns of the texts on which the verdict rests.
    where : the paper has them.
    """
    rows = []
    for protocol, statements in evidence.items():
        # A family of Holm's: the statements of one column that an interval decides.
        tested = [entry.level for entry in statements.values() if entry is not None and entry.parts]
        levels = iter(holm(tested))
        for text, entry in statements.items():
            if entry is None:
                facts: dict[str, Any] = {"outcome": None}
            elif entry.parts:
                facts = entry.judge(float(next(levels)))
            else:
                facts = entry.judge(LEVEL)  # a fact, or by construction: no level enters
            row = {
                "text": text,
                "where": where,
                "protocol": protocol,
                "central": any(fnmatch(text, pattern) for pattern in central),
            }
            rows.append(row | facts)
    return rows


def verdict(statements: Sequence[Mapping[str, Any]]) -> str:
    """Return the verdict on an item: that of its central statements, with its counts.

    A statement is judged on recordings; a printed number under the paper's own settings alone.
    Where all that is decided is arithmetic on what the paper prints, the word is "consistent".

    >>> entry = {"text": "a", "protocol": "recorded", "central": True, "method": "Student's t"}
    >>> verdict([entry | {"outcome": "stands"}])
    'reproduced (1 stands)'
    """
    recorded = {row["text"] for row in statements if row["protocol"] == RECORDED}
    central = [
        row
        for row in statements
        if row["central"] and (row["protocol"] == RECORDED or row["text"] not in recorded)
    ]
    deciding = [row["outcome"] for row in central]
    number = {outcome: deciding.count(outcome) for outcome in OUTCOMES}
    told = ", ".join(f"{n} {_counted(n, outcome)}" for outcome, n in number.items() if n)
    if told and None in deciding:
        told += f", {deciding.count(None)} not run"
    if not deciding:
        return "nothing central" if statements else "nothing to judge"
    word = _verdict_word(number, complete=None not in deciding)
    tested = [row for row in central if row["outcome"] not in {CONSTRUCTED, None}]
    checked = [row["method"] == "a fact" for row in tested]
    if checked and all(checked):  # arithmetic on printed numbers, no run of anybody's
        word = {"reproduced": "consistent", "not reproduced": "not consistent"}.get(word, word)
    return f"{word} ({told})" if told else word


def _verdict_word(number: Mapping[str, int], *, complete: bool) -> str:
    """Return the word for an item of so many central statements of each outcome."""
    if number[FALLS]:
        return "reproduced in part" if number[STANDS] else "not reproduced"
    if not complete:
        return "run in part" if any(number.values()) else "not run"
    if number[UNDECIDED]:
        return "reproduced in part" if number[STANDS] else "undecided"
    return "reproduced" if number[STANDS] else CONSTRUCTED


def _told(effect: Estimate | None, level: float) -> dict[str, Any]:
    """Return what an interval is made of: of a fraction its cases, of a difference two sides."""
    if effect is None:
        return {"error": None, "cases": None, "sides": None}
    _, _, low, high = effect.interval(1 - level)
    return {
        "method": effect.method,
        "estimate": effect.estimate,
        "interval": [low, high],
        "units": f"{effect.clusters} {effect.cluster}",
        "level": level,
        "error": effect.se,
        "cases": effect.cases if effect.fraction else None,
        "sides": [[side.estimate, side.cases] for side in effect.sides] if effect.sides else None,
    }


def _counted(number: int, outcome: str) -> str:
    if number == 1:
        return outcome
    return {STANDS: "stand", FALLS: "fall"}.get(outcome, outcome)
