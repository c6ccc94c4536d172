"""Colors of Okabe and Ito, which color-blind readers can distinguish, on dark and on light."""

Color = int  # red, green, blue, opacity: 8 bits each, as rerun packs them


def rgb(red: int, green: int, blue: int) -> Color:
    """Pack an opaque color."""
    return red << 24 | green << 16 | blue << 8 | 255


def unpacked(color: Color) -> tuple[int, int, int, int]:
    """Return red, green, blue and opacity of a color."""
    return color >> 24, color >> 16 & 255, color >> 8 & 255, color & 255


BLUE, ORANGE, GREEN = rgb(0, 114, 178), rgb(230, 159, 0), rgb(0, 158, 115)
SKY, RED, PINK = rgb(86, 180, 233), rgb(213, 94, 0), rgb(204, 121, 167)
GRAY, DIM, TEXT = rgb(128, 128, 128), rgb(96, 96, 96), rgb(150, 150, 150)
WHITE = rgb(255, 255, 255)
SERIES = (
    BLUE, ORANGE, GREEN, PINK, SKY, RED, rgb(183, 165, 0), rgb(136, 102, 204),
    rgb(68, 170, 153), rgb(190, 80, 120), rgb(221, 204, 119), rgb(153, 153, 51),
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
