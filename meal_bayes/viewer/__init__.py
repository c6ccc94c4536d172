"""Viewer: shows logged trials in the rerun viewer.

The input is trials and the header of their run. The output is an .rrd file, a window, a page for a
browser, or a picture, also of a run in progress. All data that are shown come from the log.
"""

from meal_bayes.viewer.replay import Replay, follow, send_recording, write_recording
from meal_bayes.viewer.window import Viewer, ViewerError, take_picture

__all__ = [
    "Replay", "Viewer", "ViewerError", "follow", "send_recording", "take_picture",
    "write_recording",
]  # fmt: skip
