"""Sentences of a domain: what can be asked by which word, and what a question is made of."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from meal_bayes.domain.domain import Domain
from meal_bayes.domain.query import Query
from meal_bayes.domain.words import fold
from meal_bayes.errors import QueryError

_FUNCTION_TEXT = (
    "a about an and any are as at be been being both but by can check color colored colour "
    "coloured contain containing contains content contents could describe described do does "
    "feel find for from full-of has have having hold holding holds how i if in inside is "
    "it it's item its itself kind know like look made made-of me object of on one out please "
    "possible robot say see seem so some something sort tell that that's the then there these "
    "thing think this those to too us was we weight well were what what's whether which with "
    "would you your also will shall should may might must did am were they he she my much show "
    "determine verify identify want now"
)
FUNCTION_WORDS = set(_FUNCTION_TEXT.split())
# A word of these that is an attribute, too, is a verb where the words around it make it one.
_AUXILIARIES = {
    "can", "could", "will", "would", "shall", "should", "may", "might", "must", "do", "does", "did",
}  # fmt: skip
_VERBS = {
    "look", "feel", "seem", "hold", "contain", "have", "be", "see", "tell", "say", "find", "check",
    "describe", "think", "know", "show", "like", "weigh", "determine", "verify", "identify",
}  # fmt: skip
_SUBJECTS = {
    "i", "you", "we", "it", "they", "he", "she", "one", "someone", "this", "that", "these", "those",
    "the", "its", "robot", "object", "thing", "item", "please", "there",
}  # fmt: skip
_ARTICLES = {
    "a", "an", "the", "any", "some", "another", "this", "that", "its", "no", "your", "my",
}  # fmt: skip
_KINDS = {"kind", "sort"}  # "what kind of object"
# Signs that say something. "!" and "-" do where a word begins with them, not where they end one.
_SIGN = r"!(?=[\w(=])|(?<![\w-])-(?=\w)|&+|\|+|[~^=<>+*/\\()\[\]{}]"
BRACKETS = set("()[]{}")
JOINING_SIGNS = {"&", "&&", "+"}


def vocabulary_of(question: object, domain: Domain) -> dict[str, str]:
    """Return attributes and groups by each word for them; refuse what is no question."""
    named: Any = question  # users give anything
    if not isinstance(named, str | Sequence) or not all(isinstance(name, str) for name in named):
        raise QueryError(f"A question is a sentence or names; found {question!r:.60}.")
    plural = {fold(name) + "s": name for name in domain.groups}
    named_by = plural | {fold(name): name for name in domain.groups} | domain.words
    spelled = {
        word.replace(*pair): name
        for pair in (("colour", "color"), ("color", "colour"))
        for word, name in named_by.items()
    }
    weighing = {"weigh": named_by["weight"]} if "weight" in named_by else {}
    return weighing | spelled | named_by


def query_of(names: Sequence[str], domain: Domain) -> Query:
    """Build the query of attributes and groups; a group is whole, or one of its values is asked.

    One value alone is an attribute like others, and its percepts alone count, in a question of yes
    or no too (`event_reading._of_literals`, which needs no event then).
    """
    Query(tuple(names))  # raises where one is named twice, as `_Reader.attribute` does
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


def words_of(question: str, vocabulary: Mapping[str, str], domain: Domain) -> list[str]:
    """Split a sentence into words and signs; names of the domain stay whole, whatever is in them.

    Of two values of one group that stand side by side ("half full") the first is meant. More are a
    list without commas. "How full" asks for the value of the group that "full" is of. A word that
    is a verb where it stands ("Can you see ...") names no attribute there.
    """
    text = " ".join(fold(question).replace("\N{RIGHT SINGLE QUOTATION MARK}", "'").split())
    # The longest first, as a pattern takes the first alternative that fits.
    compound = sorted((name for name in vocabulary if not name.isalnum()), key=len, reverse=True)
    whole = [rf"(?<!\w){re.escape(name)}(?!\w)" for name in compound]
    pattern = "|".join([*whole, _SIGN, r"[\w'-]+"])
    runs: list[list[str]] = []  # words, but values of one group side by side are together
    end = 0
    for match in re.finditer(pattern, text):
        word = match.group() if is_sign(match.group()) else match.group().strip("'-")
        adjoins = bool(runs) and text[end : match.start()].isspace()
        group = domain.group_of(vocabulary.get(runs[-1][-1], "")) if adjoins else ()
        if word and vocabulary.get(word) in group:
            runs[-1].append(word)
        elif word:
            runs.append([word])
        end = match.end()
    words = [word for run in runs for word in (run[:1] if len(run) == 2 else run)]
    return _how([w for i, w in enumerate(words) if not _is_verb(words, i)], vocabulary, domain)


def _how(words: Sequence[str], vocabulary: Mapping[str, str], domain: Domain) -> list[str]:
    """Return words with the group in place of a value behind "how"."""
    read = list[str]()
    for before, word in zip(("", *words), words, strict=False):
        group = next(
            (g for g, values in domain.groups.items() if vocabulary.get(word) in values), ""
        )
        names = (fold(group), f"{fold(group)}s")  # a value may be called as its group
        named = [name for name in names if vocabulary.get(name) == group and group]
        read.append(named[0] if before == "how" and named else word)
    return read


def _is_verb(words: Sequence[str], place: int) -> bool:
    """Return whether a word is a verb by the words around it, or the "kind" of "what kind"."""
    word = words[place]
    before = words[place - 1] if place else ""
    after = words[place + 1] if place + 1 < len(words) else ""
    if before in _ARTICLES and before not in ("this", "that"):
        return False  # "a can"
    if word in _AUXILIARIES:
        return after in _SUBJECTS | _VERBS | {"not"} and before not in ("is", "are")
    if word in _VERBS:
        helped = any(other in _AUXILIARIES for other in words[:place])
        return helped and before in _SUBJECTS | _AUXILIARIES
    return word in _KINDS and before in ("what", "which")


def is_sign(word: str) -> bool:
    """Return whether a word of a question is a sign, such as "!" or "|"."""
    return not any(letter.isalnum() or letter == "_" for letter in word)
