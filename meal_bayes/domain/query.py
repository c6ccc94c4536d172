"""A query: the attributes a robot is asked about, and the table of all their values."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze
from meal_bayes.domain.domain import Domain, fold, unknown
from meal_bayes.errors import QueryError

_TABLE_LIMIT = 20  # attributes; a table of all values beyond that would not fit in memory
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
    """The vector **p** of queried attributes (bit 0 is the most significant in `index_of`).

    >>> Query(("heavy", "beans")).report_names
    ('not heavy, not beans', 'not heavy, beans', 'heavy, not beans', 'heavy, beans')
    """

    attributes: tuple[str, ...]  # (N,)

    def __post_init__(self) -> None:
        if not self.attributes:
            raise QueryError("The query names no attribute; name at least one.")
        for name in self.attributes:
            if self.attributes.count(name) > 1:
                raise QueryError(f"The query names {name!r} twice; name each attribute once.")

    def __len__(self) -> int:
        """Return N, the number of queried attributes."""
        return len(self.attributes)

    @property
    def values(self) -> NDArray[np.bool_]:
        """All value vectors, (Y,N); for queries of at most 20 attributes."""
        if len(self) > _TABLE_LIMIT:
            raise QueryError(
                f"2^{len(self)} value vectors do not fit in a table; "
                f"work with the factored belief beyond {_TABLE_LIMIT} attributes."
            )
        bits = np.arange(2 ** len(self))[:, None] >> np.arange(len(self))[::-1]
        return freeze(bits & 1, np.bool_)

    def index_of(self, values: Sequence[bool] | NDArray[np.bool_]) -> int:
        """Return the row y of a value vector in `values`."""
        index = 0
        for value in values:
            index = 2 * index + int(value)
        return index

    def values_of(self, index: int) -> NDArray[np.bool_]:
        """Return the value vector of row y, (N,); any N."""
        return freeze([(index >> (len(self) - 1 - i)) & 1 for i in range(len(self))], np.bool_)

    def report_name(self, values: Sequence[bool] | NDArray[np.bool_]) -> str:
        """Format one report."""
        pairs = zip(self.attributes, values, strict=True)
        return ", ".join(name if value else f"not {name}" for name, value in pairs)

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

    Raises
    ------
    QueryError
        No attribute, an unknown one (the nearest are suggested), one named twice, a negation, or
        an alternative: the robot reports each attribute as it is.
    """
    known = domain.words
    listed = question.split(",") if isinstance(question, str) else question
    items = [fold(item) for item in listed]
    if not isinstance(question, str) or all(item in known for item in items):
        return Query(tuple(_resolve(item, known, domain) for item in items))
    found: list[str] = []
    for word in _words(question, known):
        if word in _NEGATIONS or word.endswith("n't"):
            raise QueryError(
                f"The question says {word!r}; ask the plain attribute, "
                "and the report will say whether it holds."
            )
        if word in _ALTERNATIVES - known.keys():
            raise QueryError(
                f'The question says {word!r}; name each attribute (with "and" or commas), and '
                "the report will say which of them hold."
            )
        if word in known or word not in _FUNCTION_WORDS:
            _resolve(word, known, domain)
            found.append(word)
    found = [word for word in found if word not in _REFERENTS] or found
    if not found:
        raise QueryError(
            f"No attribute found in {question!r}; expected some of: {', '.join(domain.attributes)}."
        )
    return Query(tuple(known[word] for word in found))


def _resolve(word: str, known: Mapping[str, str], domain: Domain) -> str:
    if word not in known:
        raise QueryError(unknown("attribute", word, (*domain.attributes, *domain.synonyms)))
    return known[word]


def _words(question: str, known: Mapping[str, str]) -> list[str]:
    """Split a sentence into words; names of the domain with spaces or hyphens stay whole."""
    text = fold(question).replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    compound = sorted((name for name in known if not name.isalnum()), key=len, reverse=True)
    pattern = "|".join([*(rf"(?<!\w){re.escape(n)}(?!\w)" for n in compound), r"[\w'-]+"])
    words = (match.strip("'-") for match in re.findall(pattern, text))
    return [word for word in words if word]
