"""Words of a domain: how they are compared, and what is said of one that is not known."""

import difflib
import unicodedata
from collections.abc import Iterable

from meal_bayes.display import listed

NOT = {"not", "no", "non", "without"}  # deny what is named next
# Words that join or deny what a question names, and so name nothing themselves.
JOINING_WORDS = {*NOT, "neither", "nor", "and", "but", "or", "either"}
UNCLEAR_WORDS = {"never", "isnt", "doesnt", "xor"}  # so do these, but of what is not clear
_SHOWN = 24  # names that a message lists at most; of more, the nearest
_LONGEST = 60  # letters of an unknown name that a message repeats


def fold(word: str) -> str:
    """Write a word so that case and the way its accents are coded play no part."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", word).casefold()).strip()


def unknown(kind: str, name: str, candidates: Iterable[str]) -> str:
    """Build the message that a name is not known, with the known names nearest to it."""
    names = list(candidates)
    if len(name) > _LONGEST:
        name = f"{name[:_LONGEST]}..."
    coded = unicodedata.normalize("NFC", name)
    for other in names:
        if other != name and unicodedata.normalize("NFC", other) == coded:
            alike = f"{other!r} differs in how accents are coded alone (NFC or NFD)"
            return f"Unknown {kind} {name!r}: {alike}; write both alike."
    few = len(names) <= _SHOWN
    by_fold = {fold(other): other for other in names}  # case is no difference
    cutoff = 0.5 if few else 0.0
    near = [by_fold[word] for word in difflib.get_close_matches(fold(name), by_fold, 3, cutoff)]
    hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
    rest = f"expected one of: {listed(names, _SHOWN)}." if few else f"There are {len(names)}."
    return f"Unknown {kind} {name!r}: {hint}{rest}"
