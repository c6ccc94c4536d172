"""A query: the attributes a robot is asked about, and the table of all their values."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze
from meal_bayes.domain.domain import Domain, fold, unknown
from meal_bayes.errors import QueryError

_TABLE_LIMIT = 2**20  # value vectors in a table; more would not fit in memory
_NEGATIONS = {"not", "no", "non", "without", "never", "neither", "nor", "isnt", "doesnt"}  # and n't
_ALTERNATIVES = {"or", "either", "xor"}
_REFERENTS = {"object", "thing", "item", "one"}  # how a sentence names the object asked about
_FUNCTION_TEXT = (
    "a about an and any are as at be been being both but by can check color colored colour "
    "coloured contain containing contains content contents could describe described do does "
    "feel find for from full-of has have having hold holding holds how i if in inside is "
    "it it's item its itself kind know like look made made-of me object of on one out please "
    "possible robot say see seem so some something sort tell that that's the then there these "
    "thing think this those to too us was we weight well were what what's whether which with "
    "would you your also"
)
_FUNCTION_WORDS = set(_FUNCTION_TEXT.split())


@dataclass(frozen=True, slots=True)
class Query:
    """The vector **p** of queried attributes, and which of them are the values of one variable.

    Attributes
    ----------
    attributes : tuple[str, ...]
        (N,) names.
    groups : tuple[tuple[int, ...], ...]
        Places of attributes of which exactly one is true: the values of a group. An attribute
        outside is a variable of its own, true or false.
    group_names : tuple[str, ...]
        What each group is called; by default by its values, "empty, half or full".

    Examples
    --------
    >>> Query(("heavy", "beans")).report_names
    ('not heavy, not beans', 'not heavy, beans', 'heavy, not beans', 'heavy, beans')
    >>> Query(("metal", "empty", "half", "full"), ((1, 2, 3),)).report_names[-2:]
    ('metal, half', 'metal, full')
    """

    attributes: tuple[str, ...]
    groups: tuple[tuple[int, ...], ...] = field(default=(), repr=False)
    group_names: tuple[str, ...] = field(default=(), repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.attributes:
            raise QueryError("The query names no attribute; name at least one.")
        for name in self.attributes:
            if self.attributes.count(name) > 1:
                raise QueryError(f"The query names {name!r} twice; name each attribute once.")
        named = zip_longest(map(tuple[int, ...], map(sorted, self.groups)), self.group_names)
        by_place = sorted((group or (), name or "") for group, name in named)
        object.__setattr__(self, "groups", tuple(group for group, _ in by_place))
        places = [place for group in self.groups for place in group]
        distinct = len(set(places)) == len(places) and set(places) <= set(range(len(self)))
        if not distinct or not all(len(group) > 1 for group in self.groups):
            raise QueryError(
                f"Groups are {self.groups}; expected two or more places below {len(self)} in each, "
                "none of them twice."
            )
        names = tuple(name or self._alternatives(group) for group, name in by_place)
        object.__setattr__(self, "group_names", names)

    def _alternatives(self, places: Iterable[int]) -> str:
        """Name a group by its values."""
        *first, last = (self.attributes[place] for place in places)
        return f"{', '.join(first)} or {last}"

    def __len__(self) -> int:
        """Return N, the number of queried attributes."""
        return len(self.attributes)

    @property
    def variables(self) -> tuple[tuple[int, ...], ...]:
        """Places of each variable's attributes: a group, or an attribute alone; by first place."""
        grouped = {place for group in self.groups for place in group}
        alone = ((place,) for place in range(len(self)) if place not in grouped)
        return tuple(sorted((*self.groups, *alone)))

    @property
    def questions(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """Name and places of each thing asked: of a group, or of an attribute alone.

        >>> Query(("metal", "empty", "half"), ((1, 2),), ("fill",)).questions
        (('metal', (0,)), ('fill', (1, 2)))
        """
        names = dict(zip(self.groups, self.group_names, strict=True))
        return tuple((names.get(p, self.attributes[p[0]]), p) for p in self.variables)

    @property
    def text(self) -> str:
        """What is asked, as in "metal, fill?"."""
        return f"{', '.join(name for name, _ in self.questions)}?"

    @property
    def value_names(self) -> tuple[str, ...]:
        """Names of the attributes (N,), with their groups, as in "fill: half"."""
        names = list(self.attributes)
        for question, places in zip(self.group_names, self.groups, strict=True):
            for place in places:
                names[place] = f"{question}: {names[place]}"
        return tuple(names)

    @classmethod
    def named(cls, value_names: Sequence[str]) -> "Query":
        """Return the query of which these are the `value_names`.

        >>> Query.named(["metal", "fill: empty", "fill: half"]).text
        'metal, fill?'
        """
        parts = [name.rpartition(": ") for name in value_names]
        places: dict[str, list[int]] = {}
        for place, (question, _, _) in enumerate(parts):
            places.setdefault(question, []).append(place)
        groups = {name: tuple(of) for name, of in places.items() if name and len(of) > 1}
        grouped = {place for group in groups.values() for place in group}
        attributes = (
            parts[place][2] if place in grouped else name for place, name in enumerate(value_names)
        )
        return cls(tuple(attributes), tuple(groups.values()), tuple(groups))

    def by_question(self, values: Sequence[Any] | NDArray[Any]) -> dict[str, Any]:
        """Return values (N,) of the attributes by question; of a group by its attributes.

        Of truth values, which one of the group is true; None where that is not known.
        """
        answers: dict[str, Any] = {}
        for question, places in self.questions:
            row = [values[place] for place in places]
            names = [self.attributes[place] for place in places]
            if len(places) == 1:
                answers[question] = row[0]
            elif all(value is None or isinstance(value, bool) for value in row):
                answers[question] = next((n for n, v in zip(names, row, strict=True) if v), None)
            else:
                answers[question] = dict(zip(names, row, strict=True))
        return answers

    @property
    def _sizes(self) -> tuple[int, ...]:
        """Numbers of values of the variables."""
        return tuple(max(2, len(places)) for places in self.variables)

    @property
    def n_values(self) -> int:
        """Y, the number of value vectors: 2^N without groups."""
        return math.prod(self._sizes)

    @property
    def values(self) -> NDArray[np.bool_]:
        """All value vectors, (Y,N); at most 2^20. The first variable is the most significant."""
        if self.n_values > _TABLE_LIMIT:
            raise QueryError(
                f"2^{len(self)} value vectors do not fit in a table; ask fewer attributes."
            )
        digits = np.unravel_index(np.arange(self.n_values), self._sizes)
        return freeze(self._bits(digits).T, np.bool_)

    def _bits(self, digits: Sequence[Any]) -> NDArray[np.bool_]:
        """Return the attributes' values (N,...) of a digit (...) for each variable."""
        bits = np.zeros((len(self), *np.shape(digits[0])), bool)
        for places, digit in zip(self.variables, digits, strict=True):
            for number, place in enumerate(places, start=len(places) == 1):
                bits[place] = digit == number
        return bits

    def index_of(self, values: Sequence[bool] | NDArray[np.bool_]) -> int:
        """Return the row y of a value vector in `values`; any N."""
        index = 0
        for places, size in zip(self.variables, self._sizes, strict=True):
            true = [number for number, place in enumerate(places) if values[place]]
            if len(places) > 1 and len(true) != 1:
                names = [self.attributes[place] for place in places]
                raise QueryError(f"{len(true)} of {names} are true; exactly one value is.")
            index = size * index + (true[0] if len(places) > 1 else len(true))
        return index

    def values_of(self, index: int) -> NDArray[np.bool_]:
        """Return the value vector of row y, (N,); any N."""
        digits = []
        for size in reversed(self._sizes):
            index, digit = divmod(index, size)
            digits.append(digit)
        return freeze(self._bits(digits[::-1]), np.bool_)

    def report_name(self, values: Sequence[bool] | NDArray[np.bool_]) -> str:
        """Format one report; of a group the value that is true."""
        grouped = {place for group in self.groups for place in group}
        return ", ".join(
            name if value else f"not {name}"
            for place, (name, value) in enumerate(zip(self.attributes, values, strict=True))
            if value or place not in grouped
        )

    @property
    def report_names(self) -> tuple[str, ...]:
        """Words of all reports, (Y,)."""
        return tuple(self.report_name(row) for row in self.values)


def read_query(question: str | Sequence[str], domain: Domain) -> Query:
    """Read a query from a sentence, a comma list, or a list of attribute names.

    Case and the coding of accents play no part, and the domain's synonyms are understood (ROC36:
    RED is its "brown"). Word order gives the attributes' order. Where "object" or "thing" is an
    attribute, a sentence with other attributes means the object itself by it; a list means the
    attribute.

    The name of a group asks for its value, and so do two of its values; a single value ("Is the
    color red?", "Is it half full?") is asked as an attribute, true or false.

    Raises
    ------
    QueryError
        No attribute, an unknown one (the nearest are suggested), one named twice, a negation, or
        an alternative: the robot reports each attribute as it is.

    Examples
    --------
    >>> from meal_bayes.domain import load_domain
    >>> read_query("What color is it?", load_domain("roc36")).report_names
    ('brown', 'green', 'blue')
    """
    named: Any = question  # users give anything
    if not isinstance(named, str | Sequence) or not all(isinstance(name, str) for name in named):
        raise QueryError(f"A question is a sentence or names; found {question!r:.60}.")
    plural = {fold(name) + "s": name for name in domain.groups}
    known = plural | {fold(name): name for name in domain.groups} | domain.words
    listed = question.split(",") if isinstance(question, str) else question
    asked = [fold(item) for item in listed]
    if isinstance(question, str) and not all(item in known for item in asked):
        asked = _asked(question, known, domain)
    for word in asked:
        if word not in known:
            names = (*domain.attributes, *domain.synonyms, *domain.groups)
            raise QueryError(unknown("attribute", word, names))
    return _query([known[word] for word in asked], domain)


def _asked(question: str, known: Mapping[str, str], domain: Domain) -> list[str]:
    """Return the words of a sentence that name what is asked, or should."""
    words = _words(question, known, domain)
    for word in words:
        if word in _NEGATIONS | (_ALTERNATIVES - known.keys()) or word.endswith("n't"):
            raise QueryError(
                f'The question says {word!r}; ask the plain attributes (with "and" or commas), and '
                "the report will say which of them hold."
            )
    asked = [word for word in words if word in known or word not in _FUNCTION_WORDS]
    if not asked:
        raise QueryError(
            f"No attribute found in {question!r}; expected some of: {', '.join(domain.attributes)}."
        )
    return [word for word in asked if word not in _REFERENTS] or asked


def _query(names: Sequence[str], domain: Domain) -> Query:
    """Build the query of attributes and groups; a group is whole, or one of its values is asked."""
    Query(tuple(names))  # raises where one is named twice
    attributes: list[str] = []
    groups: list[tuple[int, ...]] = []
    group_names: list[str] = []
    group_of = {value: group for group, values in domain.groups.items() for value in values}
    for name in names:
        group = group_of.get(name, "") if name in domain.attributes else name
        members = domain.groups.get(group, ())
        values = [value for value in names if value in members]
        if len(values) == 1 or not members:
            attributes += [name] if name in domain.attributes else []
        elif members[0] not in attributes:
            groups.append(tuple(range(len(attributes), len(attributes) + len(members))))
            group_names.append(group)
            attributes += members
    return Query(tuple(attributes), tuple(groups), tuple(group_names))


def _words(question: str, known: Mapping[str, str], domain: Domain) -> list[str]:
    """Split a sentence into words; names of the domain with spaces or hyphens stay whole.

    Of two values of one group that stand side by side ("half full") the first is meant.
    """
    text = fold(question).replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    compound = sorted((name for name in known if not name.isalnum()), key=len, reverse=True)
    pattern = "|".join([*(rf"(?<!\w){re.escape(n)}(?!\w)" for n in compound), r"[\w'-]+"])
    words: list[str] = []
    end = 0
    for match in re.finditer(pattern, text):
        word, before = match.group().strip("'-"), known.get(words[-1], "") if words else ""
        beside = words and text[end : match.start()].isspace()
        if not (beside and known.get(word) in domain.group_of(before)) and word:
            words.append(word)
        end = match.end()
    return words
