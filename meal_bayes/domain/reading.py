"""Questions in words: which attributes and groups a sentence or a list names."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from meal_bayes.domain.domain import Domain
from meal_bayes.domain.event import Payoffs
from meal_bayes.domain.event_reading import read_event
from meal_bayes.domain.query import Query
from meal_bayes.domain.sentence import (
    BRACKETS,
    FUNCTION_WORDS,
    JOINING_SIGNS,
    is_sign,
    query_of,
    vocabulary_of,
    words_of,
)
from meal_bayes.domain.tables import load_domain
from meal_bayes.domain.words import JOINING_WORDS, UNCLEAR_WORDS, contracts_not, fold, unknown
from meal_bayes.errors import QueryError

_ALTERNATIVES = {"or", "either", "xor"}
_NEGATIONS = (JOINING_WORDS | UNCLEAR_WORDS) - _ALTERNATIVES - {"and", "but"}  # and all with n't
_REFERENTS = {"object", "thing", "item", "one"}  # how a sentence names the object asked about


def read_query(
    question: str | Sequence[str], domain: str | Path | Mapping[str, Any] | Domain
) -> Query:
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
    domain = load_domain(domain)
    vocabulary = vocabulary_of(question, domain)
    listed = question.split(",") if isinstance(question, str) else question
    asked = [fold(item) for item in listed]
    if isinstance(question, str) and not all(item in vocabulary for item in asked):
        asked = _asked(question, vocabulary, domain)
    for word in asked:
        if word not in vocabulary:
            names = (*domain.attributes, *domain.synonyms, *domain.groups)
            raise QueryError(unknown("attribute", word, names))
    return query_of([vocabulary[word] for word in asked], domain)


def read_question(
    question: str | Sequence[str],
    domain: str | Path | Mapping[str, Any] | Domain,
    answer: str = "values",
    payoffs: Sequence[float] | None = None,
) -> Query:
    """Read a question to be answered by "values", or by "yes or no", with payoffs of its own.

    Parameters
    ----------
    question : str | Sequence[str]
        A sentence, or names of attributes and groups.
    domain : str, path, mapping or Domain
        As a `Learner` takes it; whose words are read.
    answer : str
        "values", or "yes or no".
    payoffs : Sequence[float] | None
        What a right yes, a wrong yes, a right no and a wrong no earn, s; by default what the
        learner or the domain says.

    Raises
    ------
    QueryError
        Another kind of answer; and as `read_query` and `read_event` do.
    """
    kind: object = answer  # users give anything
    if not isinstance(kind, str) or kind not in ("values", "yes or no"):
        raise QueryError(f"answer is {answer!r:.60}; expected 'values' or 'yes or no'.")
    if kind == "yes or no":
        return read_event(question, domain, payoffs)
    query = read_query(question, domain)
    return query if payoffs is None else replace(query, payoffs=Payoffs.of(payoffs))


def _asked(question: str, vocabulary: Mapping[str, str], domain: Domain) -> list[str]:
    """Return the words of a sentence that name what is asked, or should."""
    harmless = BRACKETS | JOINING_SIGNS
    words = [word for word in words_of(question, vocabulary, domain) if word not in harmless]
    for word in words:
        if word in _NEGATIONS | (_ALTERNATIVES - vocabulary.keys()) or (
            contracts_not(word) or (is_sign(word) and word not in vocabulary)
        ):
            raise QueryError(
                f'The question says {word!r}; ask the plain attributes (with "and" or commas), and '
                "the report will say which of them hold. A question to be answered by yes or no "
                'may say so (answer="yes or no"; --yes-no).'
            )
    asked = [word for word in words if word in vocabulary or word not in FUNCTION_WORDS]
    if not asked:
        raise QueryError(
            f"No attribute found in {question!r}; expected some of: {', '.join(domain.attributes)}."
        )
    return [word for word in asked if word not in _REFERENTS] or asked
