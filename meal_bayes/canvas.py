"""matplotlib's classes that draw, whatever backend the environment names.

matplotlib raises at its first import where `MPLBACKEND` names no backend, as a notebook's may be
none in another process. Figures of ours need none, so every import of matplotlib stands here.
"""

import contextlib
import os
import sys

_first = "matplotlib" not in sys.modules
_backend = os.environ.pop("MPLBACKEND", None)
try:
    import matplotlib as mpl
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath
finally:
    if _backend is not None:
        os.environ["MPLBACKEND"] = _backend
if _backend and _first:
    with contextlib.suppress(ValueError):  # what the user's own figures are drawn with
        mpl.rcParams["backend"] = _backend

__all__ = ["Axes", "Figure", "FontProperties", "TextToPath", "colormaps", "mpl"]
