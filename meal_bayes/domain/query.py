"""A query: the attributes a robot is asked about, and the table of all their values."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, plain_fields
from meal_bayes.domain.event import Event, Payoffs
from meal_bayes.domain.words import denied
from meal_bayes.errors import QueryError

DO_NOT_KNOW = "I do not know"  # the answer that abstains, wherever it is written
_TABLE_LIMIT = 2**20  # value vectors in a table; more would not fit in memory


@lru_cache(maxsize=256)  # every step of a trial asks
def _variables(attributes: int, groups: tuple[tuple[int, ...], ...]) -> tuple[tuple[int, ...], ...]:
    grouped = {index for group in groups for index in group}
    alone = ((index,) for index in range(attributes) if index not in grouped)
    return tuple(sorted((*groups, *alone)))


@lru_cache(maxsize=256)
def _sizes(attributes: int, groups: tuple[tuple[int, ...], ...]) -> tuple[int, ...]:
    return tuple(max(2, len(indices)) for indices in _variables(attributes, groups))


def value_table(attributes: int, groups: tuple[tuple[int, ...], ...]) -> NDArray[np.bool_]:
    """Return all value vectors (Y,N); the first variable is the most significant."""
    sizes = _sizes(attributes, groups)
    digits = np.unravel_index(np.arange(math.prod(sizes)), sizes)
    return freeze(_bits(attributes, groups, digits).T, np.bool_)


def _bits(
    attributes: int, groups: tuple[tuple[int, ...], ...], digits: Sequence[Any]
) -> NDArray[np.bool_]:
    """Return the attributes' values (N,...) of a digit (...) for each variable."""
    bits = np.zeros((attributes, *np.shape(digits[0])), bool)
    for indices, digit in zip(_variables(attributes, groups), digits, strict=True):
        # The digit of a group is its true attribute's; of one alone 0 is false and 1 true.
        for number, index in enumerate(indices, start=len(indices) == 1):
            bits[index] = digit == number
    return bits


@dataclass(frozen=True, slots=True)
class Query:
    """A question: the queried attributes, the groups to which they belong, and the payoffs.

    Attributes
    ----------
    attributes : tuple[str, ...]
        (N,) names of the queried attributes.
    groups : tuple[tuple[int, ...], ...]
        For each group, the indices of the attributes that are its values. Exactly one value of a
        group is true. Every other attribute is true or false on its own.
    group_names : tuple[str, ...]
        Name of each group; by default a list of its values, such as "empty, half or full".
    event : Event | None
        Event about which a yes-or-no question asks; None if the question asks for the values of
        attributes.
    payoffs : Payoffs | None
        Payoffs of a yes-or-no question or of a question about one attribute; None if the question
        has no payoffs of its own.

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
    event: Event | None = field(default=None, repr=False)
    payoffs: Payoffs | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        plain_fields(self)
        if not self.attributes:
            raise QueryError("The query names no attribute; name at least one.")
        for name in self.attributes:
            if self.attributes.count(name) > 1:
                raise QueryError(f"The query names {name!r} twice; name each attribute once.")
        # Groups come in the order of their first attributes, and equal queries compare equal.
        named = zip_longest(map(tuple[int, ...], map(sorted, self.groups)), self.group_names)
        by_index = sorted((group or (), name or "") for group, name in named)
        object.__setattr__(self, "groups", tuple(group for group, _ in by_index))
        indices = [index for group in self.groups for index in group]
        distinct = len(set(indices)) == len(indices) and set(indices) <= set(range(len(self)))
        if not distinct or not all(len(group) > 1 for group in self.groups):
            raise QueryError(
                f"Groups are {self.groups}; expected two or more indices below {len(self)} in "
                "each, none of them twice."
            )
        names = tuple(name or self._alternatives(group) for group, name in by_index)
        object.__setattr__(self, "group_names", names)
        if self.event is not None:
            self.event.check(self.attributes, self.variables)
        if self.payoffs is not None and not self.yes_or_no:
            raise QueryError(
                f"Payoffs do not apply to a question about {len(self)} attributes; ask a yes-or-no "
                "question, or a question about one attribute."
            )

    def _alternatives(self, indices: Iterable[int]) -> str:
        """Name a group by its values."""
        *first, last = (self.attributes[index] for index in indices)
        return f"{', '.join(first)} or {last}"

    def __len__(self) -> int:
        """Return N, the number of queried attributes."""
        return len(self.attributes)

    @property
    def variables(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the attributes of each variable: of each group or single attribute."""
        return _variables(len(self), self.groups)

    @property
    def questions(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """Name and indices of each queried group and each queried single attribute.

        >>> Query(("metal", "empty", "half"), ((1, 2),), ("fill",)).questions
        (('metal', (0,)), ('fill', (1, 2)))
        """
        names = dict(zip(self.groups, self.group_names, strict=True))
        return tuple(
            (names.get(indices, self.attributes[indices[0]]), indices) for indices in self.variables
        )

    @property
    def yes_or_no(self) -> bool:
        """Whether the answer is yes or no: the question is about an event or one attribute."""
        return self.event is not None or len(self) == 1

    @property
    def text(self) -> str:
        """Text of the question, such as "metal, fill?", or "metal and not full?" for yes or no."""
        if self.event is not None:
            return f"{self.event.text(self.attributes, self.variables)}?"
        return f"{', '.join(name for name, _ in self.questions)}?"

    @property
    def value_names(self) -> tuple[str, ...]:
        """Names of the N attributes with their groups, as in "fill: half"."""
        names = list(self.attributes)
        for question, indices in zip(self.group_names, self.groups, strict=True):
            for index in indices:
                names[index] = f"{question}: {names[index]}"
        return tuple(names)

    @classmethod
    def named(cls, value_names: Sequence[str]) -> "Query":
        """Return the query that has these `value_names`.

        >>> Query.named(["metal", "fill: empty", "fill: half"]).text
        'metal, fill?'
        """
        parts = [name.rpartition(": ") for name in value_names]
        indices_of: dict[str, list[int]] = {}
        for index, (question, _, _) in enumerate(parts):
            indices_of.setdefault(question, []).append(index)
        # One name alone with a colon in it is an attribute's own.
        groups = {name: tuple(of) for name, of in indices_of.items() if name and len(of) > 1}
        grouped = {index for group in groups.values() for index in group}
        attributes = (
            parts[index][2] if index in grouped else name for index, name in enumerate(value_names)
        )
        return cls(tuple(attributes), tuple(groups.values()), tuple(groups))

    def by_question(self, values: Sequence[Any] | NDArray[Any]) -> dict[str, Any]:
        """Return the N values of the attributes as a dictionary, in which a group is one entry.

        The entry of a group is its true value, or None if the true value is unknown.
        """
        answers: dict[str, Any] = {}
        for question, indices in self.questions:
            row = [values[index] for index in indices]
            names = [self.attributes[index] for index in indices]
            if len(indices) == 1:
                answers[question] = row[0]
            elif all(value is None or isinstance(value, bool) for value in row):
                answers[question] = next((n for n, v in zip(names, row, strict=True) if v), None)
            else:
                answers[question] = dict(zip(names, row, strict=True))
        return answers

    @property
    def _sizes(self) -> tuple[int, ...]:
        """Numbers of values of the variables."""
        return _sizes(len(self), self.groups)

    @property
    def n_values(self) -> int:
        """Number Y of combinations of values, which is 2^N without groups."""
        return math.prod(self._sizes)

    @property
    def values(self) -> NDArray[np.bool_]:
        """All combinations of values, (Y,N); at most 2^20. The first variable changes slowest."""
        if self.n_values > _TABLE_LIMIT:
            raise QueryError(
                f"2^{len(self)} value vectors do not fit in a table; ask fewer attributes."
            )
        return value_table(len(self), self.groups)

    @property
    def n_reports(self) -> int:
        """Number of possible reports: Y, or 2 for yes or no."""
        return self.n_values if self.event is None else 2

    def report_of(self, index: int) -> NDArray[np.bool_]:
        """Return the report with an index: N truth values, or whether the answer is yes, (1,)."""
        if self.event is None:
            return self.values_of(index)
        return freeze([index == 1], np.bool_)

    @property
    def report_size(self) -> int:
        """Number of truth values in a report, which is N, or 1 for yes or no."""
        return len(self) if self.event is None else 1

    def report_index(self, report: Sequence[bool] | NDArray[np.bool_]) -> int:
        """Return the index of a report among the possible reports."""
        return self.index_of(report) if self.event is None else int(report[0])

    def report_truth(self, truth: NDArray[np.int8]) -> NDArray[np.int8]:
        """Return the right report for N labels: 1 true, 0 false, -1 unknown."""
        if self.event is None:
            return truth
        return freeze([self.event.holds(truth, self.variables)], np.int8)

    def index_of(self, values: Sequence[bool] | NDArray[np.bool_]) -> int:
        """Return the number of a combination's row in `values`, even if `values` is too large."""
        # y in mixed radix: a digit for each variable, the first most significant
        row = 0
        for indices, size in zip(self.variables, self._sizes, strict=True):
            true = [number for number, index in enumerate(indices) if values[index]]
            if len(indices) > 1 and len(true) != 1:
                names = [self.attributes[index] for index in indices]
                raise QueryError(f"{len(true)} of {names} are true; exactly one must be.")
            row = size * row + (true[0] if len(indices) > 1 else len(true))
        return row

    def values_of(self, index: int) -> NDArray[np.bool_]:
        """Return row y of `values`, (N,), even if `values` is too large."""
        digits = []
        for size in reversed(self._sizes):
            index, digit = divmod(index, size)
            digits.append(digit)
        return freeze(_bits(len(self), self.groups, digits[::-1]), np.bool_)

    def report_name(self, values: Sequence[bool] | NDArray[np.bool_] | None) -> str:
        """Return the text of a report: yes, no, or the values; None means "I do not know"."""
        if values is None:
            return DO_NOT_KNOW
        if self.event is not None:
            return "yes" if values[0] else "no"
        grouped = {index for group in self.groups for index in group}
        return ", ".join(
            name if value else denied(name)
            for index, (name, value) in enumerate(zip(self.attributes, values, strict=True))
            if value or index not in grouped
        )

    @property
    def report_names(self) -> tuple[str, ...]:
        """Texts of all reports, in their order; no and yes for a yes-or-no question."""
        reports = self.values if self.event is None else [[False], [True]]
        return tuple(self.report_name(row) for row in reports)
