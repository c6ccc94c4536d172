"""A run in progress, shown while its trials are written."""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from meal_bayes.trial_log import Follower
from meal_bayes.viewer.replay import Replay, Target, recording

_POLL = 0.5  # s


def follow(
    path: str | Path,
    to: Target,
    *,
    watching: Callable[[], bool],
    on_trials: Callable[[int], None] | None = None,
) -> Follower:
    """Send the trials of a growing log, or of all logs of a folder, to a viewer.

    Parameters
    ----------
    path : str | Path
        File (also under the name it has while it is written) or folder; it may still be to come.
    to : Target
        An .rrd file, or the address of a viewer.
    watching : Callable[[], bool]
        Polled; following ends when it returns False, or when all files have ended.
    on_trials : Callable[[int], None] | None
        Called with the number of trials so far, when there are new ones.

    Returns
    -------
    Follower
        Its `problems` are what was wrong with the files.
    """
    follower, replay = Follower(path), None
    with contextlib.closing(follower), recording(str(follower.path), to) as stream:
        while watching():
            trials = list(follower.poll())
            for trial in trials:
                if replay is None:
                    replay = Replay(stream, follower.header or {})
                replay.add(trial)
                if replay.trials == 1:
                    replay.flush()
                    replay.send_layout(live=True)
            if trials and replay is not None:
                replay.flush()
                if on_trials is not None:
                    on_trials(replay.trials)
            if follower.finished:
                break
            time.sleep(_POLL)
    return follower
