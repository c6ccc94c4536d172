"""Questions in words: which attributes and groups a sentence or a list names."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from meal_bayes.domain.domain import Domain
from meal_bayes.domain.event import Event, Payoffs
from meal_bayes.domain.query import Query
from meal_bayes.domain.words import fold, unknown
from meal_bayes.errors import QueryError

_NOT = {"not", "no", "non", "without", "neither", "nor"}  # of the next attribute, in an event
_NEGATIONS = {*_NOT, "never", "isnt", "doesnt"}  # and all that end with n't: no values are asked so
_ALTERNATIVES = {"or", "either", "xor"}
_UNCLEAR = {"never", "isnt", "doesnt", "xor"}  # in an event: not of one attribute
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
_EVENT_FUNCTION_WORDS = {*_FUNCTION_WORDS, "either"}  # "either red or blue" is an event


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
    vocabulary = _vocabulary(question, domain)
    listed = question.split(",") if isinstance(question, str) else question
    asked = [fold(item) for item in listed]
    if isinstance(question, str) and not all(item in vocabulary for item in asked):
        asked = _asked(question, vocabulary, domain)
    for word in asked:
        if word not in vocabulary:
            names = (*domain.attributes, *domain.synonyms, *domain.groups)
            raise QueryError(unknown("attribute", word, names))
    return _query([vocabulary[word] for word in asked], domain)


def read_event(
    question: str | Sequence[str], domain: Domain, payoffs: Sequence[float] | None = None
) -> Query:
    """Read a question of yes or no: attributes joined by *and* or by *or*, perhaps with *not*.

    "not" (also "no", "without", "neither", "nor") is of the next attribute alone. A list joins by
    *and*. Of one attribute, values and yes or no are the same question.

    Parameters
    ----------
    question : str | Sequence[str]
        Such as "Is it red and not empty?".
    domain : Domain
        Its attributes, groups and synonyms are understood.
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
    vocabulary = _vocabulary(question, domain)
    sentence = question if isinstance(question, str) else " and ".join(question)
    literals: dict[str, bool] = {}
    connectives: set[str] = set()
    positive = True
    for word in _words(sentence, vocabulary, domain):
        if word in domain.words:
            name = domain.words[word]
            if name in literals:
                raise QueryError(f"The question names {name!r} twice; name each attribute once.")
            literals[name] = positive
            positive = True
        elif word in vocabulary:
            values = ", ".join(domain.groups[vocabulary[word]])
            raise QueryError(f"{word!r} is one of {values}; a question of yes or no says which.")
        elif word in _NOT:
            positive = False
            connectives |= {"and"} if word == "nor" else set()
        elif word in ("and", "but", "or"):
            connectives.add("or" if word == "or" else "and")
        elif word in _UNCLEAR or word.endswith("n't"):
            raise QueryError(f'The question says {word!r}; use "and", "or" and "not" alone.')
        elif word not in _EVENT_FUNCTION_WORDS:
            raise QueryError(unknown("attribute", word, (*domain.attributes, *domain.synonyms)))
    if not positive:
        raise QueryError('The question ends with a "not" that is of no attribute.')
    if len(connectives) > 1:
        raise QueryError(
            'The question mixes "and" with "or"; ask two questions, or with one of them alone.'
        )
    if not literals:
        _asked(sentence, {}, domain)
    four = None if payoffs is None else Payoffs.of(payoffs)
    return _of_literals(literals, domain, four, disjunction="or" in connectives)


def read_question(
    question: str | Sequence[str],
    domain: Domain,
    answer: str = "values",
    payoffs: Sequence[float] | None = None,
) -> Query:
    """Read a question to be answered by "values", or by "yes or no", with payoffs of its own.

    Parameters
    ----------
    question : str | Sequence[str]
        A sentence, or names of attributes and groups.
    domain : Domain
        Whose words are read.
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
    if answer == "yes or no":
        return read_event(question, domain, payoffs)
    if answer != "values":
        raise QueryError(f"answer is {answer!r:.60}; expected 'values' or 'yes or no'.")
    query = read_query(question, domain)
    return query if payoffs is None else replace(query, payoffs=Payoffs.of(payoffs))


def _of_literals(
    literals: Mapping[str, bool], domain: Domain, payoffs: Payoffs | None, *, disjunction: bool
) -> Query:
    """Build the query of an event; of a disjunction the conjunction of the negations fails."""
    asked = _query(list(literals), domain)
    if literals == {asked.attributes[0]: True}:
        return Query(asked.attributes, payoffs=payoffs)
    grouped = {place for group in asked.groups for place in group}
    allowed = [place in grouped for place in range(len(asked))]
    for name, positive in literals.items():
        place = asked.attributes.index(name)
        needed = positive != disjunction  # by De Morgan
        members = next((group for group in asked.groups if place in group), (place,))
        if len(members) > 1 and needed:
            for other in members:
                allowed[other] = allowed[other] and other == place
        else:
            allowed[place] = needed
    event = Event(tuple(allowed), disjunction)
    return Query(asked.attributes, asked.groups, asked.group_names, event, payoffs)


def _vocabulary(question: object, domain: Domain) -> dict[str, str]:
    """Return attributes and groups by each word for them; refuse what is no question."""
    named: Any = question  # users give anything
    if not isinstance(named, str | Sequence) or not all(isinstance(name, str) for name in named):
        raise QueryError(f"A question is a sentence or names; found {question!r:.60}.")
    plural = {fold(name) + "s": name for name in domain.groups}
    return plural | {fold(name): name for name in domain.groups} | domain.words


def _asked(question: str, vocabulary: Mapping[str, str], domain: Domain) -> list[str]:
    """Return the words of a sentence that name what is asked, or should."""
    words = _words(question, vocabulary, domain)
    for word in words:
        if word in _NEGATIONS | (_ALTERNATIVES - vocabulary.keys()) or word.endswith("n't"):
            raise QueryError(
                f'The question says {word!r}; ask the plain attributes (with "and" or commas), and '
                "the report will say which of them hold."
            )
    asked = [word for word in words if word in vocabulary or word not in _FUNCTION_WORDS]
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


def _words(question: str, vocabulary: Mapping[str, str], domain: Domain) -> list[str]:
    """Split a sentence into words; names of the domain with spaces or hyphens stay whole.

    Of two values of one group that stand side by side ("half full") the first is meant.
    """
    text = fold(question).replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    # The longest first, as a pattern takes the first alternative that fits.
    compound = sorted((name for name in vocabulary if not name.isalnum()), key=len, reverse=True)
    whole = [rf"(?<!\w){re.escape(name)}(?!\w)" for name in compound]
    pattern = "|".join([*whole, r"[\w'-]+"])
    words: list[str] = []
    end = 0
    for match in re.finditer(pattern, text):
        word = match.group().strip("'-")
        before = vocabulary.get(words[-1], "") if words else ""
        beside = words and text[end : match.start()].isspace()
        second = beside and vocabulary.get(word) in domain.group_of(before)
        if word and not second:
            words.append(word)
        end = match.end()
    return words
