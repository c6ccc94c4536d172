"""Colors for rerun, of the one table of names and colors, on dark and on light grounds."""

from meal_bayes import look

Color = tuple[int, int, int, int]  # red, green, blue, opacity


def rgba(color: str) -> Color:
    """Return a color such as "#0072B2" as four numbers.

    >>> rgba("#0072B2")
    (0, 114, 178, 255)
    """
    red, green, blue = (int(color[start : start + 2], 16) for start in (1, 3, 5))
    return red, green, blue, 255


ORANGE = rgba(look.ORANGE)
GREEN = rgba(look.GREEN)
SKY = rgba(look.SKY)
RED = rgba(look.VERMILION)
GRAY = (128, 128, 128, 255)
DIM = (96, 96, 96, 255)
TEXT = (150, 150, 150, 255)
WHITE = (255, 255, 255, 255)


def agent_color(name: str) -> Color:
    """Return the color of an agent, the same as in every figure; black is gray, to be seen."""
    color = look.agent_style(name).color
    return GRAY if color == look.BLACK else rgba(color)


def attribute_color(index: int) -> Color:
    """Return the color of an attribute by its place in a question."""
    return rgba(look.attribute_color(index))


def level_color(level: int, levels: int) -> Color:
    """Return the color of a percept level, which nothing else has."""
    return rgba(look.level_color(level, levels))
