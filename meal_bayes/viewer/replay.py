"""Trials -> a rerun recording: into a file, or to a viewer, also while they are written."""

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun_bindings

from meal_bayes.errors import SettingsError
from meal_bayes.files import draft_of
from meal_bayes.robots.robot import Frame
from meal_bayes.trial_log import Follower
from meal_bayes.trials import Trial, TrialOutcomes
from meal_bayes.viewer.blueprint import blueprint
from meal_bayes.viewer.recorder import Clock, Recorder, Time
from meal_bayes.viewer.run_view import RunView
from meal_bayes.viewer.scene import Scene, add_robot

APPLICATION = "meal_bayes"
_BATCH = 100  # trials sent together
_POLL = 0.5  # s

Target = Path | str  # an .rrd file, or the address of a viewer (rerun+http://...)


class Replay:
    """A recording to which trials are added one by one.

    Parameters
    ----------
    stream : rr.RecordingStream
        Stream that is connected to a file or a viewer.
    header : Mapping[str, object]
        Configuration of the run, as in the header of its log.
    only : int | None
        Number of the only trial that is shown step by step. By default all trials are shown. The
        plots of the run contain all trials in either case.
    """

    def __init__(
        self, stream: rr.RecordingStream, header: Mapping[str, object], *, only: int | None = None
    ) -> None:
        self._stream = stream
        self._only = only
        self._recorder = Recorder(stream)
        self._scene = Scene(self._recorder)
        self._run = RunView(self._recorder, header)
        self._clock = Clock()
        self._shows_robot = False
        self.trials = 0

    def add(self, trial: Trial, frames: Sequence[Frame] = ()) -> None:
        """Add the next trial, with the frames of its robot, if there are any."""
        number = self.trials
        self.trials = self.trials + 1
        clock = self._clock
        begin = Time(number, clock.row, clock.seconds)
        end = begin
        if self._only is None or self._only == number:
            for frame in clock.frames(number, trial):
                self._scene.add(frame)
                end = frame.time
            self._scene.close(trial, Time(number, clock.row - 1, clock.seconds))
            if frames:
                add_robot(self._recorder, trial, frames, begin)
                self._shows_robot = True
        self._run.add(TrialOutcomes.of([trial]), [end])
        if self.trials % _BATCH == 0:
            self._recorder.flush()

    def add_outcomes(self, outcomes: TrialOutcomes) -> None:
        """Add trials without steps, as in a compact log; each is a row in the run's plots."""
        clock = self._clock
        ends = enumerate(np.cumsum(outcomes.cost).tolist())
        times = [Time(self.trials + i, clock.row + i, clock.seconds + end) for i, end in ends]
        self._run.add(outcomes, times)
        self.trials += len(times)
        clock.row = clock.row + len(times)
        clock.seconds = times[-1].sim_time

    def flush(self) -> None:
        """Send the rows so far, and the measures of the run."""
        if self.trials:
            self._run.flush()
        self._recorder.flush()
        self._stream.flush()

    def send_layout(self, *, live: bool = False) -> None:
        """Send the layout that fits the trials so far."""
        single = self._only is not None or (self.trials == 1 and not live)
        self._stream.send_blueprint(
            blueprint(
                single=single,
                attributes=len(self._scene.attributes),
                live=live,
                robot=self._shows_robot,
            )
        )


@contextlib.contextmanager
def recording(name: str, to: Target) -> Iterator[rr.RecordingStream]:
    """Yield a new stream into a file or a viewer; rerun's global state stays untouched."""
    if isinstance(to, str) and "://" not in to:
        raise SettingsError(
            f"to is {to!r:.60}; give the Path of an .rrd file, or a viewer's address, such as "
            "rerun+http://127.0.0.1:9876/proxy."
        )
    stream = rr.RecordingStream(APPLICATION, recording_id=name, make_default=False)
    try:
        if isinstance(to, Path):
            stream.save(to)
        else:
            stream.connect_grpc(to)
        yield stream
    finally:
        stream.flush()
        stream.disconnect()
        # Rerun leaves the threads running of recordings that nobody holds any more.
        rerun_bindings.flush_and_cleanup_orphaned_recordings()


def write_recording(
    trials: Iterable[Trial | TrialOutcomes],
    path: str | Path,
    header: Mapping[str, object],
    *,
    name: str = "run",
    only: int | None = None,
    frames: Sequence[Frame] = (),
) -> int:
    """Write an .rrd file that shows trials in the rerun viewer (``rerun FILE.rrd``).

    An existing file is replaced when the new one is complete.

    Parameters
    ----------
    trials : Iterable[Trial | TrialOutcomes]
        Trials with their steps. Outcomes without steps, as in a compact log, are shown only in the
        plots of the whole run.
    path : str | Path
        File to write.
    header : Mapping[str, object]
        Settings of the run, as in the header of a log. Pass an empty mapping if there are none.
    name : str
        Name of the recording in the viewer.
    only : int | None
        Number of the only trial to show. None shows all trials.
    frames : Sequence[Frame]
        Geometry of the robot and its surroundings in the first trial.

    Returns
    -------
    int
        Number of trials in the file.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from meal_bayes import ask, write_recording
    >>> trial = ask("heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", logs=None)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_recording([trial], Path(folder, "trial.rrd"), {})
    1
    """
    with draft_of(path) as draft:
        return send_recording(trials, draft, header, name=name, only=only, frames=frames)


def send_recording(
    trials: Iterable[Trial | TrialOutcomes],
    to: Target,
    header: Mapping[str, object],
    *,
    name: str = "run",
    only: int | None = None,
    frames: Sequence[Frame] = (),
) -> int:
    """Send trials to an .rrd file or the address of a viewer, and return their number.

    Parameters
    ----------
    trials : Iterable[Trial | TrialOutcomes]
        Trials with their steps. Outcomes without steps, as in a compact log, are shown only in the
        plots of the run.
    header, only
        As for `Replay`.
    frames : Sequence[Frame]
        Geometry of the robot and its surroundings in the first trial.
    """
    with recording(name, to) as stream:
        replay = Replay(stream, header, only=only)
        for trial in trials:
            if isinstance(trial, TrialOutcomes):
                replay.add_outcomes(trial)
            else:
                replay.add(trial, () if replay.trials else frames)
        replay.flush()
        replay.send_layout()
        return replay.trials


def follow(
    path: str | Path,
    to: Target,
    *,
    watching: Callable[[], bool],
    on_trials: Callable[[int], None] | None = None,
) -> Follower:
    """Send the trials of a growing log, or of all logs of a folder, to a viewer (or a file).

    Parameters
    ----------
    path : str | Path
        A file, also under the name that it has while it is written, or a folder. It need not exist
        yet.
    watching : Callable[[], bool]
        Function that is called again and again. Following ends when it returns False, or when all
        files have ended.
    on_trials : Callable[[int], None] | None
        Called with the number of trials so far, when there are new ones.

    Returns
    -------
    Follower
        The follower; its `problems` are the faults of the files.
    """
    follower = Follower(path)
    replay = None
    with contextlib.closing(follower), recording(str(follower.path), to) as stream:
        while watching():
            trials = list(follower.poll())
            if trials:
                begins = replay is None
                replay = replay or Replay(stream, follower.header or {})
                for trial in trials:
                    replay.add(trial)
                replay.flush()
                if begins:
                    replay.send_layout(live=True)
                if on_trials is not None:
                    on_trials(replay.trials)
            if follower.finished:
                break
            time.sleep(_POLL)
    return follower
