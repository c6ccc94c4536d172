"""Pictures with labels: beliefs as bars, and the confusion matrices of a behavior."""

from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from meal_bayes.display import level_names, percent
from meal_bayes.momdp import MOMDP
from meal_bayes.viewer.labels import plain_text
from meal_bayes.viewer.palette import GRAY, GREEN, ORANGE, SKY, TEXT, WHITE, Color, unpacked
from meal_bayes.viewer.trial_frames import TrialFrame

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
        lane[: int(full)] = unpacked(color)
        if full < _BAR:  # the pixel in which the bar ends
            lane[int(full)] = rest * np.array(unpacked(color)) + (1 - rest) * lane[int(full)]
        lane[_BAR // 2] = unpacked(GRAY)
        lane[min(int(before * _BAR), _BAR - 1)] = unpacked(ORANGE)
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
        known = self._known[action]
        if sampled is None:  # as wide as the others, so that the view does not move
            width = self._momdp.levels * _cell_width(self._momdp.levels)
            margin = ((0, 0), (0, _GAP + width), (0, 0))
            return Picture(np.pad(known.pixels, margin), known.labels)
        return _with_band(known, sampled[:, :_SHOWN])

    def _draw(self, action: int) -> Picture:
        momdp = self._momdp
        n, k = min(len(momdp.query), _SHOWN), momdp.levels
        mean, sd = (rows[:n].reshape(2 * n, k) for rows in truth_rows(momdp, action))
        blocks = [(f"{plain_text(momdp.behavior_names[action])}: mean", mean, 1.0)]
        blocks.append(("sd (exact)" if not sd.any() else "sd", sd, _SD_FULL))
        if self._counts is not None:  # fractions of counted percepts; nan of none
            counts = self._counts[:n, action].reshape(2 * n, k)
            total = counts.sum(axis=-1, keepdims=True)
            point = np.where(total > 0, counts / np.maximum(total, 1), np.nan)
            blocks.append(("paper: counts only", point, 1.0))
        # A wide picture is shown smaller; its rows must still be as high as a label.
        width, high = k * _cell_width(k), _CELL_HIGH
        pixels = np.zeros((2 * n * high, len(blocks) * (width + _GAP) - _GAP, 4), np.uint8)
        labels = [
            Label(f"{prefix}{plain_text(name)}", -5.0, (2 * i + t + _MIDDLE) * high, TEXT)
            for i, name in enumerate(momdp.query.attributes[:n])
            for t, prefix in enumerate(("not ", ""))
        ]
        for number, (title, values, full) in enumerate(blocks):
            left = number * (width + _GAP)
            colors = viridis(_BRIGHTEST * values / full).repeat(high, 0).repeat(_cell_width(k), 1)
            pixels[:, left : left + width, :3] = colors
            pixels[:, left : left + width, 3] = 255
            labels += _block_labels(title, values, left, high)
        return Picture(pixels, tuple(labels))


def _with_band(matrices: Picture, sampled: NDArray[np.float64]) -> Picture:
    """Draw rows (M,N,K) of sampled MOMDPs to the right of the matrices, a lane for each of them."""
    m, n, k = sampled.shape
    tall = 2 * _CELL_HIGH  # of an attribute, as its two rows beside it
    lanes = np.sort(sampled, axis=0)[np.arange(tall) * m // tall]  # (tall,N,K)
    pixels = np.zeros((len(matrices.pixels), _GAP + k * _cell_width(k), 4), np.uint8)
    colors = viridis(_BRIGHTEST * lanes.transpose(1, 0, 2).reshape(n * tall, k))
    pixels[: n * tall, _GAP:, :3] = colors.repeat(_cell_width(k), 1)
    pixels[: n * tall, _GAP:, 3] = 255
    left = matrices.pixels.shape[1] + _GAP
    labels = [Label(f"{m} sampled MOMDPs", left + k * _cell_width(k) / 2, -1.3 * _CELL_HIGH, TEXT)]
    for i, z in np.ndindex(n, k):
        at = left + (z + 0.5) * _cell_width(k)
        for most, row in ((sampled[:, i, z].min(), 2 * i), (sampled[:, i, z].max(), 2 * i + 1)):
            labels.append(Label(f"{most:.2f}", at, (row + _MIDDLE) * _CELL_HIGH, WHITE))
    labels += _level_labels(k, left, 2 * n * _CELL_HIGH)
    return Picture(np.concatenate([matrices.pixels, pixels], axis=1), (*matrices.labels, *labels))


def _block_labels(title: str, values: NDArray[np.float64], left: int, high: int) -> list[Label]:
    rows, k = values.shape
    labels = [Label(title, left + k * _cell_width(k) / 2, -1.3 * high, TEXT)]
    for row, z in np.ndindex(rows, k):
        text = "-" if np.isnan(values[row, z]) else f"{values[row, z]:.2f}"
        at = left + (z + 0.5) * _cell_width(k), (row + _MIDDLE) * high
        labels.append(Label(text, *at, WHITE))
    return labels + _level_labels(k, left, rows * high)


def _cell_width(k: int) -> int:
    """Return the width of a cell of K levels, pixels; a block of 2 is as wide as one of 4."""
    return max(4, _BLOCK_WIDE // k)


def _level_labels(k: int, left: float, y: float) -> list[Label]:
    """Return the names of the levels below the columns of a block, long ones in two rows."""
    rows = 1 if k == 2 else 2
    return [
        Label(name, left + (z + 0.5) * _cell_width(k), y + (_MIDDLE + z % rows) * _CELL_HIGH, TEXT)
        for z, name in enumerate(level_names(k))
    ]


def truth_rows(momdp: MOMDP, action: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute mean and sd of a new object's rows by its truth, (N,2,K) each.

    Its latent class is drawn by Pr(class given truth), its row Dirichlet about the class's.
    """
    prob = momdp.latent_classes[..., None]  # (N,2,C,1)
    rows = momdp.confusion[:, None, action]  # (N,1,C,K)
    precision = momdp.precision[:, None, action, :, None]
    mean = (prob * rows).sum(axis=2)
    square = (prob * (rows**2 + rows * (1 - rows) / (1 + precision))).sum(axis=2)
    return mean, np.sqrt(np.maximum(square - mean**2, 0.0))


def viridis(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Map values in [0, 1] to colors, (..., 3)."""
    colors = colormaps["viridis"](np.nan_to_num(values), bytes=True)
    return np.asarray(colors[..., :3], np.uint8)
