"""Viewer: logged trials as a rerun recording with a layout of our own.

In: trials and the header of their run. Out: an .rrd file, a window, a page or a picture, also of a
run in progress. Everything that is shown comes from the log.
"""

from meal_bayes.viewer.replay import Replay, follow, send_recording, write_recording
from meal_bayes.viewer.window import Viewer, ViewerError, take_picture

__all__ = [
    "Replay", "Viewer", "ViewerError", "follow", "send_recording", "take_picture",
    "write_recording",
]  # fmt: skip
