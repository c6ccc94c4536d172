"""Read questions: find the attributes and groups that a sentence or a list names.

A yes-or-no question joins attributes by "and" or by "or", and may contain "not".
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from meal_bayes.domain.domain import Domain
from meal_bayes.domain.event import Event, Payoffs
from meal_bayes.domain.query import Query
from meal_bayes.domain.tables import load_domain
from meal_bayes.domain.words import JOINING_WORDS, NOT, UNCLEAR_WORDS, contracts_not, fold, unknown
from meal_bayes.errors import QueryError

_FUNCTION_TEXT = (
    "a about an and any are as at be been being both but by can check color colored colour "
    "coloured contain containing contains content contents could describe described do does "
    "feel find for from full-of has have having hold holding holds how i if in inside is "
    "it it's item its itself kind know like look made made-of me object of on one out please "
    "possible robot say see seem so some something sort tell that that's the then there these "
    "thing think this those to too us was we weight well were what what's whether which with "
    "would you your also will shall should may might must did am were they he she my much show "
    "determine verify identify want now going gonna wonder wondering wondered curious interested "
    "let lets let's sure guess guessing figure learn i'd i'm we'd hey hello hi ok okay yet already "
    "still currently really actually got question"
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
_OR_NOT = re.compile(r"(?<=\bwhether) or not\b|,? or not(?=\W*$)")  # "Is it full or not?"
_KINDS = {"kind", "sort"}  # "what kind of object"
# Signs that say something. "!" and "-" do where a word begins with them, not where they end one.
_SIGN = r"!(?=[\w(=])|(?<![\w-])-(?=\w)|&+|\|+|[~^=<>+*/\\()\[\]{}]"
BRACKETS = set("()[]{}")
JOINING_SIGNS = {"&", "&&", "+"}


def vocabulary_of(question: object, domain: Domain) -> dict[str, str]:
    """Return the attribute or group of each word; raise an error if this is not a question."""
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
    """Build the query of attributes and groups.

    The name of a group, or two of its values, ask for the whole group. A single value is queried
    like any attribute, also in yes-or-no questions (see `_of_literals`).
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
    """Split a sentence into words and signs, without splitting names of the domain.

    If two values of one group are adjacent ("half full"), the first one is meant; three or more
    adjacent values are a list without commas. "How full" asks for the group that contains "full". A
    word that is used as a verb ("Can you see ...") does not name an attribute.
    """
    text = " ".join(fold(question).replace("\N{RIGHT SINGLE QUOTATION MARK}", "'").split())
    text = _OR_NOT.sub("", text)
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
    for before, *two in zip(["", *words], words, words[1:], strict=False):
        if two == ["out", "of"] and before != "made":
            raise QueryError(
                'The question says "out of", which may deny what follows; say "not", or "made of".'
            )
    # "weigh" asks for the weight, unless an attribute is called so.
    asks = {"weigh"} if vocabulary.get("weigh") == "weight" else set[str]()
    kept = [w for i, w in enumerate(words) if w in asks or not _is_verb(words, i)]
    return _how(kept, vocabulary, domain)


def _how(words: Sequence[str], vocabulary: Mapping[str, str], domain: Domain) -> list[str]:
    """Return words, in which a value after "how" is replaced by its group."""
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
    """Return whether the words around a word make it a verb, or the "kind" of "what kind"."""
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


_ALTERNATIVES = {"or", "either", "xor"}
_NEGATIONS = (JOINING_WORDS | UNCLEAR_WORDS) - _ALTERNATIVES - {"and", "but"}  # and all with n't
_REFERENTS = {"object", "thing", "item", "one"}  # how a sentence names the object asked about


def read_query(
    question: str | Sequence[str], domain: str | Path | Mapping[str, Any] | Domain
) -> Query:
    """Read a query from a sentence, a comma-separated list, or a list of attribute names.

    Upper and lower case and the Unicode form of accents do not matter. The domain's synonyms are
    understood: in ROC36, "red" means "brown". Attributes are queried in the order in which the text
    names them. A domain may have an attribute "object" or "thing". In a list, the word then means
    this attribute; in a sentence with other attributes, it means the object itself.

    A question that names a group ("What color is it?"), or two values of a group, asks which value
    the object has. A question that names one value ("Is the color red?", "Is it half full?") asks
    whether the object has this value.

    Raises
    ------
    QueryError
        The question names no attribute, an unknown attribute, or the same attribute twice; or it
        contains "not" or "or", which only yes-or-no questions may contain.

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
    """Read a question about values, or a yes-or-no question, with its payoffs.

    Parameters
    ----------
    question : str | Sequence[str]
        A sentence, or names of attributes and groups.
    domain : str, path, mapping or Domain
        Domain, as for `Learner`. The question may contain its attributes, groups and synonyms.
    answer : str
        Kind of answer: "values" or "yes or no".
    payoffs : Sequence[float] | None
        Rewards of a right yes, a wrong yes, a right no and a wrong no, s. By default they are those
        of the learner or the domain.

    Raises
    ------
    QueryError
        The kind of answer is unknown, or `read_query` or `read_event` raises the error.
    """
    kind: object = answer  # users give anything
    if not isinstance(kind, str) or kind not in ("values", "yes or no"):
        raise QueryError(f"answer is {answer!r:.60}; expected 'values' or 'yes or no'.")
    if kind == "yes or no":
        return read_event(question, domain, payoffs)
    query = read_query(question, domain)
    return query if payoffs is None else replace(query, payoffs=Payoffs.of(payoffs))


def _asked(question: str, vocabulary: Mapping[str, str], domain: Domain) -> list[str]:
    """Return the words of a sentence that name attributes, or are not known."""
    harmless = BRACKETS | JOINING_SIGNS
    words = [word for word in words_of(question, vocabulary, domain) if word not in harmless]
    for word in words:
        if word in _NEGATIONS | (_ALTERNATIVES - vocabulary.keys()) or (
            contracts_not(word) or (is_sign(word) and word not in vocabulary)
        ):
            raise QueryError(
                f'The question contains {word!r}. List the attributes, with "and" or commas, to '
                "get the value of each; or ask a yes-or-no question, with "
                'answer="yes or no" or the option --yes-no.'
            )
    asked = [word for word in words if word in vocabulary or word not in FUNCTION_WORDS]
    if not asked:
        raise QueryError(
            f"No attribute found in {question!r}; expected some of: {', '.join(domain.attributes)}."
        )
    return [word for word in asked if word not in _REFERENTS] or asked


# --- Questions of yes or no

_LASTING = NOT - {"not"}  # "without beans or rice" may mean that both are absent
_CONNECTIVES = {"or": "or", **dict.fromkeys(("and", "but", *JOINING_SIGNS), "and")}
_QUANTIFIERS = {"both": "not A or not B", "either": "neither A nor B"}  # what to say after a "not"


@dataclass
class _Reader:
    """State of the reader of a question."""

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
                f"{self.last_negation!r} may apply to one attribute or to more of them; "
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
            raise QueryError(
                f'"{self.negation} {word}": name an attribute after "{self.negation}".'
            )
        if self.neither and word in ("or", "nor"):
            self.nor = True
            self.connectives.add("and")
        elif self.neither and not self.nor:
            raise QueryError(f'"neither" is followed by {word!r}; say "neither A nor B".')
        elif word == "nor":
            if not self.literals or all(self.literals.values()):
                raise QueryError('"nor" needs "neither" or "not" before it; say "neither A nor B".')
            self.connectives.add("and")
            self.negation = word
        else:
            self.neither = False
            self.joined = _CONNECTIVES[word]
            self.connectives.add(self.joined)

    def other(self, word: str, *, first: bool) -> None:
        """Read a word that does not name an attribute, or raise an error."""
        if self.negation and word in _QUANTIFIERS:
            raise QueryError(
                f'"{self.negation} {word}" may be misunderstood; say "{_QUANTIFIERS[word]}".'
            )
        conditional = word == "if" and (first or self.literals)  # not as in "tell me if"
        if conditional or is_sign(word) or word in UNCLEAR_WORDS or contracts_not(word):
            raise QueryError(f'The question says {word!r}; use "and", "or" and "not" alone.')
        if word not in FUNCTION_WORDS and word != "either":
            names = (*self.domain.attributes, *self.domain.synonyms)
            raise QueryError(unknown("attribute", word, names))

    def check_end(self) -> None:
        """Raise an error if the question is not complete, or mixes "and" with "or"."""
        if self.negation:
            raise QueryError('The question ends with a "not"; name an attribute after it.')
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
    """Read a yes-or-no question: attributes joined by *and* or by *or*, optionally with *not*.

    "not" (also "no", "without", "neither", "nor") negates only the next attribute. The items of a
    list are joined by *and*. For a question about one attribute, both kinds of answer are the same.

    Parameters
    ----------
    question : str | Sequence[str]
        Question, such as "Is it red and not empty?".
    domain : str, path, mapping or Domain
        Domain, as for `Learner`. The question may contain its attributes, groups and synonyms.
    payoffs : Sequence[float] | None
        Rewards of a right yes, a wrong yes, a right no and a wrong no, s. By default they are those
        of the learner or the domain.

    Raises
    ------
    QueryError
        The question mixes *and* with *or*, names a group without a value, has a *not* without an
        attribute, is always or never true, or `read_query` would raise the error.

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
    for number, word in enumerate(words):
        if word in domain.words:
            reader.attribute(domain.words[word])
        elif word in vocabulary:
            values = domain.groups[vocabulary[word]]
            # "Is the color red?" names a group and its value.
            if not {domain.words.get(other) for other in words} & {*values}:
                message = f"{word!r} is one of {', '.join(values)}; a question of yes or no"
                raise QueryError(f"{message} must name the value.")
        elif word in NOT or word == "neither":
            reader.negate(word)
        elif word in _CONNECTIVES or word == "nor":
            reader.join(word)
        else:
            reader.other(word, first=number == 0)
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
