"""Words of a domain: how they are compared, and what is said of one that is not known."""

import difflib
import unicodedata
from collections.abc import Iterable

from meal_bayes.look import listed

NOT = {"not", "no", "non", "without"}  # deny what is named next
# Words that join or deny what a question names, and so name nothing themselves.
JOINING_WORDS = {*NOT, "neither", "nor", "and", "but", "or", "either"}
UNCLEAR_WORDS = {"never", "isnt", "doesnt", "xor"}  # so do these, but of what is not clear
# Signs without width, but for those that join letters of some scripts: also of the direction of
# writing.
_UNSEEN = str.maketrans(
    "", "", "\u00ad\u061c\u200b\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2060\u2061\u2062"
    "\u2063\u2064\u2066\u2067\u2068\u2069\ufeff"
)  # fmt: skip
_SHOWN = 24  # names that a message lists at most; of more, the nearest
_LONGEST = 60  # letters of an unknown name that a message repeats


def denied(name: str) -> str:
    """Return what is said of an attribute that is false, in questions, answers and labels."""
    return f"not {name}"


def contracts_not(word: str) -> bool:
    """Return whether a folded word ends in a contracted "not", as "isn't" does."""
    return word.endswith("n't")


def fold(word: str) -> str:
    """Write a word so that case and the way its accents are coded play no part."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", word).casefold()).strip()


def look(name: str) -> str:
    r"""Write a name so that what a person cannot see plays no part.

    That is how accents are coded, which blanks there are and how many, and signs without width.

    >>> look("a\u00a0 b\u200b")
    'a b'
    """
    return " ".join(unicodedata.normalize("NFC", name).translate(_UNSEEN).split())


def twin(name: str, names: Iterable[str]) -> str:
    """Return another of some names that looks the same as one; "" where there is none."""
    seen = look(name)
    return next((other for other in names if other != name and look(other) == seen), "")


def doubled(kind: str, names: Iterable[str]) -> str:
    """Return what is wrong with names of which two are, or look, the same; "" where none are."""
    seen = dict[str, str]()
    for name in names:
        other = seen.get(look(name))
        if other == name:
            return f"The {kind} {name!r} is listed twice; names must be unique."
        if other is not None:
            return (
                f"The {kind} names {other!a:.60} and {name!a:.60} look the same (accents, blanks, "
                "or signs without width); rename one."
            )
        seen[look(name)] = name
    return ""


def unknown(kind: str, name: object, candidates: Iterable[str]) -> str:
    """Build the message that a name is unknown, with the most similar known names."""
    names = list(candidates)
    name = name if isinstance(name, str) else repr(name)
    if len(name) > _LONGEST:
        name = f"{name[:_LONGEST]}..."
    if other := twin(name, names):
        alike = f"{other!a} differs only in what cannot be seen (accents, blanks, signs)"
        return f"Unknown {kind} {name!a}: {alike}; write both in the same way."
    few = len(names) <= _SHOWN
    by_fold = {fold(other): other for other in names}  # case is no difference
    cutoff = 0.5 if few else 0.0
    near = [by_fold[word] for word in difflib.get_close_matches(fold(name), by_fold, 3, cutoff)]
    hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
    rest = f"expected one of: {listed(names, _SHOWN)}." if few else f"There are {len(names)}."
    return f"Unknown {kind} {name!r}: {hint}{rest}"
