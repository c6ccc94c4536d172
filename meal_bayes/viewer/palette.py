"""Colors of Okabe and Ito, which color-blind readers can distinguish, on dark and on light."""

Color = tuple[int, int, int, int]  # red, green, blue, opacity

BLUE, ORANGE, GREEN = (0, 114, 178, 255), (230, 159, 0, 255), (0, 158, 115, 255)
SKY, RED, PINK = (86, 180, 233, 255), (213, 94, 0, 255), (204, 121, 167, 255)
GRAY, DIM, TEXT = (128, 128, 128, 255), (96, 96, 96, 255), (150, 150, 150, 255)
WHITE = (255, 255, 255, 255)
SERIES = (
    BLUE, ORANGE, GREEN, PINK, SKY, RED, (183, 165, 0, 255), (136, 102, 204, 255),
    (68, 170, 153, 255), (190, 80, 120, 255), (221, 204, 119, 255), (153, 153, 51, 255),
)  # fmt: skip

_LEVELS = (BLUE, SKY, ORANGE, RED)  # from "surely no" to "surely yes"


def series_color(index: int) -> Color:
    """Return the color of the i-th of several series."""
    return SERIES[index % len(SERIES)]


def level_color(level: int, levels: int) -> Color:
    """Return the color of a percept level: blue for no, orange for yes."""
    if levels == 2:
        return (BLUE, RED)[level]
    return _LEVELS[min(int(level * len(_LEVELS) / levels), len(_LEVELS) - 1)]
