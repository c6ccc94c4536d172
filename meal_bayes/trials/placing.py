"""Sizes and colors of a picture of a trial, and where words stand: none over another."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from meal_bayes.arrays import Floats
from meal_bayes.palette import attribute_color, lightened, readable

LETTER = 0.64  # width of a letter, of the size of the font
HEIGHT = 1.35  # of a line of text, of the size of the font


class Look(NamedTuple):
    """Sizes and colors: inches, points, and the ink on the page's own ground."""

    width: float
    height: float
    font: float
    ink: str
    soft: str
    block: str
    margins: tuple[float, float]  # left and right of the axis of seconds, of the width
    bands: tuple[float, float, float]  # heights
    dark: bool
    narrow: bool  # for a phone

    @property
    def label_rows(self) -> int:
        """Lines of a label at an end of a belief: its name and number, in two where narrow."""
        return 2 if self.narrow else 1

    @property
    def title_lines(self) -> int:
        """Lines of the answer in the title, at most."""
        return 2 if self.narrow else 1

    @property
    def title_font(self) -> float:
        """Size of the title, points."""
        return self.font * (1.05 if self.narrow else 1.25)

    def color(self, index: int) -> str:
        """Return the color of an attribute, which is lighter on a dark ground."""
        color = attribute_color(index)
        return lightened(color) if self.dark else color

    def text_color(self, index: int) -> str:
        """Return the color in which text names an attribute."""
        return readable(self.color(index), dark=self.dark)


def look_of(*, dark: bool, narrow: bool) -> Look:
    """Return the look of a picture on a dark or light ground, wide or for a phone."""
    ink, soft, block = (
        ("#E8EBEF", "#A9B2BD", "#3A4450") if dark else ("#1C2430", "#5D6876", "#E4E8ED")
    )
    wide = Look(
        width=12.0,
        height=4.8,
        font=12.0,
        ink=ink,
        soft=soft,
        block=block,
        margins=(0.125, 0.15),
        bands=(1.05, 2.2, 1.0),
        dark=dark,
        narrow=False,
    )
    if not narrow:
        return wide
    return wide._replace(
        width=4.0,
        height=5.6,
        font=9.0,
        margins=(0.19, 0.2),
        bands=(1.3, 2.5, 1.0),
        narrow=True,
    )


def top_of(look: Look) -> float:
    """Return where the bands end below the title, as a fraction of the height."""
    # Question, answer and the caption of the first band, in lines of the font.
    lines = 5.4 if look.narrow else 4.1
    return 1 - lines * look.font * HEIGHT / 72 / look.height


def bottom_of(look: Look) -> float:
    """Return where the bands begin above the label of seconds, as a fraction of the height."""
    return 2.3 * look.font * HEIGHT / 72 / look.height


class Words:
    """Writes words near points, where no other word stands."""

    def __init__(self, ax: Axes, font: float) -> None:
        self._ax = ax
        self._font = font
        self._across = 1 / points_a_second(ax)  # s a point
        self._up = 1.2 / points_high(ax)  # of the axis a point
        self._boxes = list[tuple[float, float, float, float]]()

    def write(
        self, word: str, point: tuple[float, float], room: float, color: str, *, up: bool
    ) -> None:
        """Write a word over the block before its point, else behind it, above or below."""
        x, y = point
        wide = LETTER * self._font * len(word) * self._across
        high = self._font * self._up
        gap = 5 * self._across
        # The twelve places that are tried, in order; the first that is free is taken.
        before = x - wide - gap
        behind = x + gap
        lefts = [before, behind] if wide < room + 2 * gap and before >= 0 else [behind, before]
        rises = [0.45 * high, -1.35 * high] if up else [-1.35 * high, 0.45 * high]
        shifts = [rise + extra for extra in (0.0, 1.2 * high, -1.2 * high) for rise in rises]
        end = self._ax.get_xlim()[1]
        for shift in shifts:
            for left in lefts:
                low = y + shift
                box = (left, low, left + wide, low + high)
                inside = low >= -0.08 and low + high <= 1.14 and left >= 0 and box[2] <= end
                if inside and not any(_overlap(box, other) for other in self._boxes):
                    self._boxes.append(box)
                    self._ax.text(
                        left,
                        low + high / 2,
                        word,
                        color=color,
                        size=self._font,
                        va="center",
                        ha="left",
                        style="italic",
                    )
                    return


def _overlap(box: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]


def heights_apart(values: Floats, gap: float) -> Floats:
    """Return heights near values (N,) that are at least a gap apart."""
    order = np.argsort(values)
    heights = np.array(values, float)
    for lower, upper in pairwise(order.tolist()):
        heights[upper] = max(heights[upper], heights[lower] + gap)
    excess = max(float(heights.max()) - 1.06, 0.0)
    return np.asarray(heights - excess)


def points_a_second(ax: Axes) -> float:
    """Return the points of the figure that a second of the axis takes."""
    figure: Any = ax.figure
    return float(ax.get_position().width * figure.get_figwidth() * 72 / ax.get_xlim()[1])


def points_high(ax: Axes) -> float:
    """Return the height of the axes in points."""
    figure: Any = ax.figure
    return float(ax.get_position().height * figure.get_figheight() * 72)
