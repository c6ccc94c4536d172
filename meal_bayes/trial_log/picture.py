"""Confusion matrices of a behavior as a small picture that any viewer of MCAP files shows.

A row for each attribute and truth, first "not"; a column for each percept level. Left the means,
right the standard deviations of a new object's rows; numbers are percent.
"""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from meal_bayes.momdp import MOMDP
from meal_bayes.trial_log.schema import ImageMessage

_WIDE, _HIGH, _GAP = 14, 9, 6  # pixels of a cell; between the two halves
_SHOWN = 8  # attributes
_MEMORY = 4096  # pictures that are kept
_SD_FULL = 0.5  # the sd with the brightest color; no row's can be larger
_DARK = 0.6  # values below it are written in white
# Five anchors of the viridis map.
_VIRIDIS = np.array([(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)])
# Digits of 3 x 5 pixels, row by row.
_DIGITS = (
    "111101101101111", "010110010010111", "111001111100111", "111001111001111", "101101111001001",
    "111100111001111", "111100111101111", "111001010010010", "111101111101111", "111101111001111",
)  # fmt: skip


class ConfusionPictures:
    """Pictures as messages without their time, each drawn once."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, int], bytes] = {}

    def of(self, momdp: MOMDP, number: int, action: int) -> bytes:
        """Draw the picture of a behavior; `number` is the MOMDP's in its file."""
        found = self._known.get((number, action))
        if found is None:
            if len(self._known) >= _MEMORY:
                self._known.clear()
            picture = png(confusion_picture(momdp, action))
            message = ImageMessage(format="png", data=picture, frame_id="confusion")
            found = self._known[number, action] = message.SerializeToString()
        return found


def confusion_picture(momdp: MOMDP, action: int) -> NDArray[np.uint8]:
    """Draw the rows of a behavior's confusion matrices, (h,w) positions in the palette."""
    n, k = min(len(momdp.query), _SHOWN), momdp.levels
    mean, sd = (rows[:n].reshape(2 * n, k) for rows in truth_rows(momdp, action))
    gap = np.full((2 * n * _HIGH, _GAP), _BLACK, np.uint8)
    return np.concatenate([_cells(mean, 1.0), gap, _cells(sd, _SD_FULL)], axis=1)


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Pack positions in the palette as a PNG file with the colors that occur."""
    used = np.flatnonzero(np.bincount(pixels.ravel(), minlength=len(_PALETTE)))
    place = np.zeros(len(_PALETTE), np.uint8)
    place[used] = np.arange(len(used))
    lines = np.pad(place[pixels], ((0, 0), (1, 0))).tobytes()  # each line begins with its filter, 0
    height, width = pixels.shape
    head = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)  # 8 bits, palette
    colors, packed = _PALETTE[used].tobytes(), zlib.compress(lines)
    parts = ((b"IHDR", head), (b"PLTE", colors), (b"IDAT", packed), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    )


def truth_rows(momdp: MOMDP, action: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute mean and sd of a new object's rows by its truth, (N,2,K) each.

    The object is of a latent class by Pr(class given truth), and its row Dirichlet about the
    class's.
    """
    prob = momdp.latent_classes[..., None]  # (N,2,C,1)
    rows = momdp.confusion[:, None, action]  # (N,1,C,K)
    precision = momdp.precision[:, None, action, :, None]
    mean = (prob * rows).sum(axis=2)
    square = (prob * (rows**2 + rows * (1 - rows) / (1 + precision))).sum(axis=2)
    return mean, np.sqrt(np.maximum(square - mean**2, 0.0))


def viridis(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Map values in [0, 1] to colors, (..., 3)."""
    at = np.clip(np.nan_to_num(values), 0, 1) * (len(_VIRIDIS) - 1)
    below = np.minimum(at.astype(int), len(_VIRIDIS) - 2)
    part = (at - below)[..., None]
    return np.asarray(_VIRIDIS[below] * (1 - part) + _VIRIDIS[below + 1] * part, np.uint8)


def _cells(values: NDArray[np.float64], full: float) -> NDArray[np.uint8]:
    bright = np.clip(values / full, 0, 1)
    level = np.rint(bright * (_SHADES - 1)).astype(np.uint8)
    ink = np.where(bright < _DARK, _WHITE, _BLACK).astype(np.uint8)
    written = _NUMBERS[np.rint(100 * values).astype(int)]  # (rows,k,h,w)
    cells = np.where(written, ink[..., None, None], level[..., None, None])
    rows, k = values.shape
    return cells.swapaxes(1, 2).reshape(rows * _HIGH, k * _WIDE)


def _number(percent: int) -> NDArray[np.bool_]:
    """Draw a number into a cell, (h,w)."""
    cell, text = np.zeros((_HIGH, _WIDE), bool), f"{percent:02d}"
    y, x = (_HIGH - 5) // 2, (_WIDE - 4 * len(text) + 1) // 2
    for place, digit in enumerate(text):
        bits = [bit == "1" for bit in _DIGITS[int(digit)]]
        cell[y : y + 5, x + 4 * place : x + 4 * place + 3] = np.reshape(bits, (5, 3))
    return cell


_NUMBERS = np.array([_number(percent) for percent in range(101)])
_SHADES, _WHITE, _BLACK = 250, 250, 251  # positions in the palette
_PALETTE = np.concatenate(
    [viridis(np.linspace(0, 1, _SHADES)), np.array([(255, 255, 255), (0, 0, 0)], np.uint8)]
)
