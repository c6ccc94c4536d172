"""Percepts and probabilities in words, for whatever shows a log."""

_LEVELS = {2: ("no", "yes"), 4: ("surely no", "no", "yes", "surely yes")}
_ROUNDED = 0.0005  # probabilities nearer to 0 or 1 would print as certain


def level_words(levels: int) -> tuple[str, ...]:
    """Name the K levels of a percept; the upper half speaks for "true".

    >>> level_words(4)
    ('surely no', 'no', 'yes', 'surely yes')
    """
    return _LEVELS.get(levels) or tuple(f"level {z}" for z in range(levels))


def percent(p: float) -> str:
    """Round a probability, but never to certainty.

    >>> percent(0.5), percent(0.99999)
    ('50.0 %', '>99.9 %')
    """
    if 0 < p < _ROUNDED or 1 - _ROUNDED < p < 1:
        return "<0.1 %" if p < _ROUNDED else ">99.9 %"
    return f"{100 * p:.1f} %"
