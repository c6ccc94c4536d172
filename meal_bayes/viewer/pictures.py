"""Pictures with labels: beliefs as bars, and the confusion matrices of a behavior."""

from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from meal_bayes.display import level_names, percent
from meal_bayes.momdp import MOMDP
from meal_bayes.viewer.labels import plain_text
from meal_bayes.viewer.palette import GRAY, GREEN, ORANGE, SKY, TEXT, WHITE, Color
from meal_bayes.viewer.recorder import TrialFrame

_SHOWN = 8  # attributes
_BAR, _LANE, _THICK = 50, 10, 6  # pixels: length of a bar, from bar to bar, of one bar
_BLOCK_WIDE, _CELL_HIGH, _GAP = 16, 4, 2  # pixels of the matrices; labels are as large as ever
_MIDDLE = 0.2  # where in a row its label is put: labels hang below their point
_BRIGHTEST = 0.6  # of the color scale: white numbers must be legible, in a light theme too
_BACK = (128, 128, 128, 60)  # behind a bar
_SD_FULL = 0.5  # the sd that has the brightest color; no row's can be larger


class Label(NamedTuple):
    """A text at a point of the picture, pixels."""

    text: str
    x: float
    y: float
    color: Color


class Picture(NamedTuple):
    """Pixels, (h,w,4) RGBA, and labels."""

    pixels: NDArray[np.uint8]
    labels: tuple[Label, ...]


def belief_bars(frame: TrialFrame) -> Picture:
    """Draw Pr(attribute is true) as bars from 0 to 100 %; a line marks it before the step."""
    names = frame.trial.task.query.attributes[:_SHOWN]
    pixels = np.zeros((len(names) * _LANE, _BAR, 4), np.uint8)
    labels = []
    for i, name in enumerate(names):
        now, before = float(frame.positive[i]), float(frame.before[i])
        top = i * _LANE + (_LANE - _THICK) // 2
        color = GREEN if now > 0.5 else SKY
        lane = np.tile(np.array(_BACK, float), (_BAR, 1))
        full, rest = divmod(now * _BAR, 1)
        lane[: int(full)] = color
        if full < _BAR:  # the pixel in which the bar ends
            lane[int(full)] = rest * np.array(color) + (1 - rest) * lane[int(full)]
        lane[_BAR // 2] = GRAY
        lane[min(int(before * _BAR), _BAR - 1)] = ORANGE
        pixels[top : top + _THICK] = lane
        middle = (i + _MIDDLE + 0.1) * _LANE
        labels.append(Label(plain_text(name), -12, middle, TEXT))
        labels.append(Label(percent(now), _BAR + 9, middle, color))
    return Picture(pixels, tuple(labels))


class Matrices:
    """Pictures of the confusion matrices of one MOMDP, each drawn once."""

    def __init__(self, momdp: MOMDP, counts: NDArray[np.float64] | None) -> None:
        self._momdp, self._counts = momdp, counts
        self._known: dict[int, Picture] = {}

    def of(self, action: int, sampled: NDArray[np.float64] | None = None) -> Picture:
        """Draw mean, sd and the paper's point estimate of a behavior's rows.

        Beside them stand, as lanes, the rows (M,N,K) of the object in the MOMDPs that were sampled
        for a decision, with the smallest and the largest probability of a level.
        """
        if action not in self._known:
            self._known[action] = self._draw(action)
        pixels, labels = self._known[action]
        if sampled is None:  # as wide as the others, so that the view does not move
            width = self._momdp.levels * _cell_width(self._momdp.levels)
            return Picture(np.pad(pixels, ((0, 0), (0, width), (0, 0))), labels)
        rows = sampled[:, :_SHOWN]
        m, n, k = rows.shape
        tall = 2 * _CELL_HIGH  # of an attribute, as its two rows beside it
        lanes = np.sort(rows, axis=0)[np.arange(tall) * m // tall].swapaxes(0, 1)  # (N,tall,K)
        ends = np.stack([rows.min(axis=0), rows.max(axis=0)], axis=1)  # (N,2,K)
        title, left = f"{m} sampled MOMDPs", pixels.shape[1]
        band = _block(title, ends.reshape(2 * n, k), lanes.reshape(n * tall, k), left)
        return Picture(np.concatenate([pixels, band.pixels], axis=1), (*labels, *band.labels))

    def _draw(self, action: int) -> Picture:
        momdp = self._momdp
        n, k = min(len(momdp.query), _SHOWN), momdp.levels
        # A new object's latent class is drawn by Pr(class given truth), its row Dirichlet about the
        # class's: mean and sd of its rows by its truth, (N,2,K).
        prob, rows = momdp.latent_classes[..., None], momdp.confusion[:, None, action]  # (N,2,C,K)
        mean = (prob * rows).sum(axis=2)
        precision = momdp.precision[:, None, action, :, None]
        square = (prob * (rows**2 + rows * (1 - rows) / (1 + precision))).sum(axis=2)
        sd = np.sqrt(np.maximum(square - mean**2, 0.0))
        blocks = [(f"{plain_text(momdp.behavior_names[action])}: mean", mean, 1.0)]
        blocks.append(("sd (exact)" if not sd.any() else "sd", sd, _SD_FULL))
        if self._counts is not None:  # fractions of counted percepts; nan of none
            counts = self._counts[:, action]
            total = counts.sum(axis=-1, keepdims=True)
            point = np.where(total > 0, counts / np.maximum(total, 1), np.nan)
            blocks.append(("paper: counts only", point, 1.0))
        labels = [
            Label(f"{prefix}{plain_text(name)}", -5.0, (2 * i + t + _MIDDLE) * _CELL_HIGH, TEXT)
            for i, name in enumerate(momdp.query.attributes[:n])
            for t, prefix in enumerate(("not ", ""))
        ]
        parts, gap = list[NDArray[np.uint8]](), ((0, 0), (0, _GAP), (0, 0))
        for title, values, full in blocks:
            left = sum(part.shape[1] for part in parts)
            numbers = values[:n].reshape(2 * n, k)
            block = _block(title, numbers, (numbers / full).repeat(_CELL_HIGH, 0), left)
            parts.append(np.pad(block.pixels, gap))
            labels += block.labels
        return Picture(np.concatenate(parts, axis=1), tuple(labels))


def _block(
    title: str, numbers: NDArray[np.float64], colors: NDArray[np.float64], left: int
) -> Picture:
    """Draw a block of numbers (R,K) on colors (R * 4,K) from 0 to 1, which begins at `left`."""
    k = numbers.shape[1]
    width = _cell_width(k)
    pixels = colormaps["viridis"](_BRIGHTEST * np.nan_to_num(colors), bytes=True).repeat(width, 1)
    labels = [Label(title, left + k * width / 2, -1.3 * _CELL_HIGH, TEXT)]
    for (row, z), value in np.ndenumerate(numbers):
        at = left + (z + 0.5) * width, (row + _MIDDLE) * _CELL_HIGH
        labels.append(Label("-" if np.isnan(value) else f"{value:.2f}", *at, WHITE))
    rows = 1 if k == 2 else 2  # of the levels' names below the columns, as some are long
    for z, name in enumerate(level_names(k)):
        y = (len(numbers) + _MIDDLE + z % rows) * _CELL_HIGH
        labels.append(Label(name, left + (z + 0.5) * width, y, TEXT))
    return Picture(pixels, tuple(labels))


def _cell_width(k: int) -> int:
    """Return the width of a cell of K levels, pixels; a block of 2 is as wide as one of 4."""
    return max(4, _BLOCK_WIDE // k)
