"""Names, order, colors and markers: one table for terminal, pages, figures and viewer.

A color belongs to a name, never to a place in a list, so that one agent looks the same wherever it
is drawn. Colors of agents and of attributes are Okabe and Ito's, which color-blind readers can
distinguish, and never share a picture; levels of percepts have colors that nothing else has.
"""

import zlib
from collections.abc import Iterable
from typing import NamedTuple

BLUE = "#0072B2"
SKY = "#56B4E9"
VERMILION = "#D55E00"
ORANGE = "#E69F00"
GREEN = "#009E73"
PINK = "#CC79A7"
VIOLET = "#8866CC"
GRAY = "#999999"
LINE_GRAY = "#7A7A7A"  # of axes through zero and of intervals beside those that are judged
INK = "#444444"
BLACK = "#000000"
ATTRIBUTES = (BLUE, VERMILION, GREEN, PINK, ORANGE, SKY, VIOLET, "#B7A500")
LEVELS = ("#5E3C99", "#B2ABD2", "#FDB863", "#E66101")  # from the surest "no" to the surest "yes"
READABLE = 4.5  # contrast of text with its ground, at least
GROUNDS = ("#f5f6f8", "#1e2430")  # of light and of dark pages: the one nearest to the text's colors


class Style(NamedTuple):
    """How an agent is drawn: color, marker and line, by the names that matplotlib has for them."""

    color: str
    marker: str
    dash: str = "-"


# In the order in which tables and legends name them: the paper's first, then ours.
_AGENTS = {
    "morc": Style(VERMILION, "^"),
    "iterative_morc": Style(VERMILION, "^"),
    "morc_itrs": Style(ORANGE, "v"),
    "iterative_random_legal": Style(INK, "+"),
    "random": Style(GRAY, "x"),
    "random_legal": Style(INK, "+"),
    "predefined": Style(GREEN, "D"),
    "predefined_plus": Style(GREEN, "d"),
    "greedy": Style(PINK, "P"),
    "olfc": Style(PINK, "X"),
    "bayes": Style(BLUE, "o"),
    "bayes_memory": Style(SKY, "s"),
}
_FAMILIES = {  # of variants, whose names begin like these
    "iterative_morc": Style(VERMILION, "^", "--"),
    "morc_itrs": Style(ORANGE, "v", "--"),
    "morc": Style(ORANGE, "v", "--"),
    "bayes_memory": Style(SKY, "s", "--"),
    "bayes": Style(BLUE, "o", "--"),
    "iterative_random": Style(INK, "+", "--"),
    "random": Style(GRAY, "x", "--"),
    "predefined": Style(GREEN, "D", "--"),
    "greedy": Style(PINK, "P", "--"),
    "olfc": Style(PINK, "X", "--"),
}
_OWN = (VIOLET, BLACK)  # of people's own agents
_OWN_DASHES = ("-", "--", "-.", ":")
REFERENCES = ("morc", "iterative_morc")  # the paper's, which others are compared with


def agent_style(name: str) -> Style:
    """Return how an agent is drawn, whatever else is drawn beside it.

    >>> agent_style("bayes").color, agent_style("bayes_no_bonus").dash
    ('#0072B2', '--')
    """
    if name in _AGENTS:
        return _AGENTS[name]
    for family, style in _FAMILIES.items():
        if name.startswith(f"{family}_"):
            return style
    number = zlib.crc32(name.encode())  # of the name alone, the same in every process
    return Style(_OWN[number % 2], "*", _OWN_DASHES[number // 2 % len(_OWN_DASHES)])


def ordered_agents(names: Iterable[str]) -> list[str]:
    """Return agents in the order of tables: the paper's, baselines, ours, people's own by name.

    >>> ordered_agents(["mine", "bayes", "morc"])
    ['morc', 'bayes', 'mine']
    """
    order = list(_AGENTS)

    def place(name: str) -> tuple[int, str]:
        family = next((prefix for prefix in _FAMILIES if name.startswith(f"{prefix}_")), "")
        near = name if name in _AGENTS else family
        return (order.index(near) if near in _AGENTS else len(order), name)

    return sorted(dict.fromkeys(names), key=place)


def reference_agent(names: Iterable[str]) -> str:
    """Return the agent that others are compared with: the paper's, else the first that is named.

    >>> reference_agent(["bayes", "random", "morc"]), reference_agent(["mine", "greedy"])
    ('morc', 'mine')
    """
    present = list(names)
    return next((name for name in REFERENCES if name in present), present[0])


def attribute_color(place: int) -> str:
    """Return the color of the attribute at a place of a question."""
    return ATTRIBUTES[place % len(ATTRIBUTES)]


def lightened(color: str, part: float = 0.4) -> str:
    """Return a color mixed with white, for a dark ground.

    >>> lightened("#0072B2")
    '#66aad1'
    """
    channels = (int(color[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{round(c + part * (255 - c)):02x}" for c in channels)


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two colors as WCAG 2 has it, 1 to 21.

    >>> contrast("#000000", "#ffffff"), round(contrast("#D55E00", "#ffffff"), 1)
    (21.0, 3.9)
    """
    low, high = sorted((_luminance(first), _luminance(second)))
    return (high + 0.05) / (low + 0.05)


def _luminance(color: str) -> float:
    parts = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    linear = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def readable(color: str, *, dark: bool = False) -> str:
    """Return a color in which text is read on any page, mixed with black, or white on a dark one.

    The contrast with the page is at least 4.5 to 1, as WCAG 2 asks of text (AA).

    >>> readable("#000000"), readable("#D55E00")
    ('#000000', '#b55000')
    """
    ground = GROUNDS[dark]
    for part in range(0, 100, 5):
        if dark:
            mixed = lightened(color, part / 100)
        else:
            channels = (int(color[at : at + 2], 16) for at in (1, 3, 5))
            mixed = "#" + "".join(f"{round(c * (1 - part / 100)):02x}" for c in channels)
        if contrast(mixed, ground) >= READABLE:
            return mixed
    return "#ffffff" if dark else BLACK


def level_color(level: int, levels: int) -> str:
    """Return the color of one of K levels of a percept, from "surely no" to "surely yes".

    >>> level_color(0, 2), level_color(1, 2)
    ('#5E3C99', '#E66101')
    """
    return LEVELS[round(level * (len(LEVELS) - 1) / max(levels - 1, 1))]
