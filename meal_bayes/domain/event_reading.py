"""Questions of yes or no in words: attributes joined by "and" or by "or", perhaps with "not"."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from meal_bayes.domain.domain import Domain
from meal_bayes.domain.event import Event, Payoffs
from meal_bayes.domain.query import Query
from meal_bayes.domain.sentence import (
    FUNCTION_WORDS,
    JOINING_SIGNS,
    is_sign,
    query_of,
    vocabulary_of,
    words_of,
)
from meal_bayes.domain.tables import load_domain
from meal_bayes.domain.words import NOT, UNCLEAR_WORDS, contracts_not, unknown
from meal_bayes.errors import QueryError

_LASTING = NOT - {"not"}  # "without beans or rice" may mean that both are absent
_CONNECTIVES = {"or": "or", **dict.fromkeys(("and", "but", *JOINING_SIGNS), "and")}
_QUANTIFIERS = {"both": "not A or not B", "either": "neither A nor B"}  # what to say after a "not"


@dataclass
class _Reader:
    """What has been read of a question so far."""

    domain: Domain
    literals: dict[str, bool] = field(default_factory=dict)
    connectives: set[str] = field(default_factory=set)  # `check_end` refuses both together
    negation: str = ""  # the word that negates the next attribute
    last_negation: str = ""  # that of the last attribute
    joined: str = ""  # "and" or "or" since then; "" where there was none
    neither: bool = False  # "neither" negates all attributes until the "and" after its "nor"
    nor: bool = False  # whether that has come

    def attribute(self, name: str) -> None:
        """Read an attribute."""
        if name in self.literals:
            raise QueryError(f"The question names {name!r} twice; name each attribute once.")
        if self.last_negation in _LASTING and not self.negation and self.joined != "and":
            raise QueryError(
                f"{self.last_negation!r} may be of one attribute or of more; "
                'say "neither A nor B", or "not A or B".'
            )
        self.literals[name] = not (self.negation or self.neither)
        self.last_negation = self.negation
        self.negation = ""
        self.joined = ""

    def negate(self, word: str) -> None:
        """Read a word that negates the next attribute, or all that follow."""
        if self.negation or self.neither:
            raise QueryError(f'The question says {word!r} after another "not"; say one of them.')
        if word == "neither":
            self.neither = True
            self.nor = False
        else:
            self.negation = word

    def join(self, word: str) -> None:
        """Read a word between attributes."""
        if self.negation:
            raise QueryError(f'"{self.negation} {word}": say what does not hold.')
        if self.neither and word in ("or", "nor"):
            self.nor = True
            self.connectives.add("and")
        elif self.neither and not self.nor:
            raise QueryError(f'"neither" is followed by {word!r}; say "neither A nor B".')
        elif word == "nor":
            if not self.literals or all(self.literals.values()):
                raise QueryError('"nor" follows what is not denied; say "neither A nor B".')
            self.connectives.add("and")
            self.negation = word
        else:
            self.neither = False
            self.joined = _CONNECTIVES[word]
            self.connectives.add(self.joined)

    def other(self, word: str) -> None:
        """Read a word of no attribute, or refuse it."""
        if self.negation and word in _QUANTIFIERS:
            raise QueryError(
                f'"{self.negation} {word}" may be misunderstood; say "{_QUANTIFIERS[word]}".'
            )
        conditional = word == "if" and self.literals
        if conditional or is_sign(word) or word in UNCLEAR_WORDS or contracts_not(word):
            raise QueryError(f'The question says {word!r}; use "and", "or" and "not" alone.')
        if word not in FUNCTION_WORDS and word != "either":
            names = (*self.domain.attributes, *self.domain.synonyms)
            raise QueryError(unknown("attribute", word, names))

    def check_end(self) -> None:
        """Refuse a question that is not whole, or mixes what joins attributes."""
        if self.negation:
            raise QueryError('The question ends with a "not" that is of no attribute.')
        if len(self.connectives) > 1:
            raise QueryError(
                'The question mixes "and" with "or"; ask two questions, or with one of them alone.'
            )
        if not self.literals:
            names = ", ".join(self.domain.attributes)
            raise QueryError(f"No attribute found in the question; expected some of: {names}.")


def read_event(
    question: str | Sequence[str],
    domain: str | Path | Mapping[str, Any] | Domain,
    payoffs: Sequence[float] | None = None,
) -> Query:
    """Read a question of yes or no: attributes joined by *and* or by *or*, perhaps with *not*.

    "not" (also "no", "without", "neither", "nor") is of the next attribute alone. A list joins by
    *and*. Of one attribute, values and yes or no are the same question.

    Parameters
    ----------
    question : str | Sequence[str]
        Such as "Is it red and not empty?".
    domain : str, path, mapping or Domain
        As a `Learner` takes it; its attributes, groups and synonyms are understood.
    payoffs : Sequence[float] | None
        Four: right yes, wrong yes, right no, wrong no; the learner's or domain's by default.

    Raises
    ------
    QueryError
        *and* mixed with *or*, a group without a value, a *not* without an attribute, what nothing
        can be, and all that `read_query` refuses of attributes.

    Examples
    --------
    >>> from meal_bayes.domain import load_domain
    >>> read_event("Is it red and not heavy?", load_domain("roc36")).text
    'brown and not heavy?'
    """
    domain = load_domain(domain)
    vocabulary = vocabulary_of(question, domain)
    sentence = question if isinstance(question, str) else " and ".join(question)
    words = words_of(sentence, vocabulary, domain)
    reader = _Reader(domain)
    for word in words:
        if word in domain.words:
            reader.attribute(domain.words[word])
        elif word in vocabulary:
            values = domain.groups[vocabulary[word]]
            # "Is the color red?" names a group and its value.
            if not {domain.words.get(other) for other in words} & {*values}:
                message = f"{word!r} is one of {', '.join(values)}; a question of yes or no says"
                raise QueryError(f"{message} which.")
        elif word in NOT or word == "neither":
            reader.negate(word)
        elif word in _CONNECTIVES or word == "nor":
            reader.join(word)
        else:
            reader.other(word)
    reader.check_end()
    four = None if payoffs is None else Payoffs.of(payoffs)
    return _of_literals(reader.literals, domain, four, disjunction="or" in reader.connectives)


def _of_literals(
    literals: Mapping[str, bool], domain: Domain, payoffs: Payoffs | None, *, disjunction: bool
) -> Query:
    """Build the query of an event; of a disjunction the conjunction of the negations fails."""
    asked = query_of(list(literals), domain)
    if literals == {asked.attributes[0]: True}:
        return Query(asked.attributes, payoffs=payoffs)
    grouped = {index for group in asked.groups for index in group}
    allowed = [index in grouped for index in range(len(asked))]
    for name, positive in literals.items():
        index = asked.attributes.index(name)
        needed = positive != disjunction  # by De Morgan
        members = next((group for group in asked.groups if index in group), (index,))
        if len(members) > 1 and needed:
            for other in members:
                allowed[other] = allowed[other] and other == index
        else:
            allowed[index] = needed
    event = Event(tuple(allowed), disjunction)
    return Query(asked.attributes, asked.groups, asked.group_names, event, payoffs)
