"""Trial logs -> a rerun recording: into a file, or to a viewer that is running."""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

from meal_bayes.agents.trial import Trial
from meal_bayes.files import draft_of
from meal_bayes.robots.frame import Frame
from meal_bayes.viewer.blueprint import blueprint
from meal_bayes.viewer.feed import Feed
from meal_bayes.viewer.recorder import Recorder, Time
from meal_bayes.viewer.robot_view import add_robot
from meal_bayes.viewer.run_view import RunView
from meal_bayes.viewer.scene import Scene
from meal_bayes.viewer.trial_frames import Clock

APPLICATION = "meal_bayes"
_BATCH = 100  # trials sent together

Target = Path | str | Feed


class Replay:
    """A recording to which trials are added one by one.

    Parameters
    ----------
    stream : of rerun, connected to a file or a viewer.
    header : configuration of the run, as the log holds it.
    only : the one trial that is shown step by step, by its position; all of them by default. The
        run's plots count every trial in either case.
    """

    def __init__(
        self, stream: rr.RecordingStream, header: Mapping[str, object], *, only: int | None = None
    ) -> None:
        self._stream, self._only = stream, only
        self._recorder = Recorder(stream)
        self._scene, self._run = Scene(self._recorder), RunView(self._recorder, header)
        self._clock = Clock()
        self._last: Time | None = None
        self._shows_robot = False
        self.trials = 0

    def add(self, trial: Trial, frames: Sequence[Frame] = ()) -> None:
        """Add the next trial, with the frames of its robot, if there are any."""
        number, self.trials = self.trials, self.trials + 1
        time = Time(number, self._clock.row, self._clock.seconds)
        if self._only is None or self._only == number:
            for frame in self._clock.frames(number, trial):
                self._scene.add(frame)
                time = Time.of(frame)
            self._scene.close(trial, Time(number, self._clock.row - 1, self._clock.seconds))
            if frames:
                add_robot(self._recorder, trial, frames, number=number)
                self._shows_robot = True
        self._run.add(number, trial, time)
        self._last = time
        if self.trials % _BATCH == 0:
            self.flush()

    def close(self) -> None:
        """Send the rest, and the table of the whole run."""
        self.flush()
        self._run.close()

    def flush(self) -> None:
        """Send the rows so far."""
        if self._last is not None:
            self._run.write_table(self._last)
        self._recorder.flush()

    def send_layout(self, *, run_first: bool = False, live: bool = False) -> None:
        """Send the layout that fits the trials so far, the run's tab in front where wanted."""
        layout = blueprint(
            single=self._only is not None or (self.trials == 1 and not live),
            attributes=self._scene.attributes,
            evidence=self._run.shows_evidence,
            run_first=run_first,
            live=live,
            robot=self._shows_robot,
        )
        _send_blueprint(self._stream, layout)


def _send_blueprint(stream: rr.RecordingStream, layout: rrb.Blueprint) -> None:
    """Send a layout as `stream.send_blueprint` does, without leaving two threads behind.

    These belong to a stream in memory that rerun 0.41 never disconnects.
    """
    made = rr.RecordingStream._from_native(
        rerun_bindings.new_blueprint(APPLICATION, make_default=False, make_thread_default=False)
    )
    made.set_time("blueprint", sequence=0)
    layout._log_to_stream(made)
    held = made.memory_recording()
    rerun_bindings.send_blueprint(held.storage, True, True, recording=stream.to_native())
    made.disconnect()


@contextlib.contextmanager
def recording(name: str, to: Target) -> Iterator[tuple[rr.RecordingStream, Callable[[], None]]]:
    """Yield a new stream, and a function that brings what was sent so far to the target.

    Rerun's global state stays untouched.

    Parameters
    ----------
    to : path of an .rrd file, address of a viewer (rerun+http://...), or a feed, which is ended.
    """
    stream = rr.RecordingStream(APPLICATION, recording_id=name, make_default=False)
    bring: Callable[[], None] = stream.flush
    if isinstance(to, Feed):
        bring = partial(_pump, rr.binary_stream(stream), to)
    elif isinstance(to, Path):
        stream.save(to)
    else:
        stream.connect_grpc(to)
    try:
        yield stream, bring
    finally:
        bring()
        stream.disconnect()
        if isinstance(to, Feed):
            to.end()


def _pump(binary: rr.BinaryStream, feed: Feed) -> None:
    feed.append(binary.read() or b"")


def write_recording(
    trials: Iterable[Trial],
    path: str | Path,
    header: Mapping[str, object],
    **options: Any,
) -> int:
    """Write trials into an .rrd file and return their number.

    Parameters
    ----------
    options : as of `send_recording`.

    Raises
    ------
    OutputError : the file cannot be written; one that was there stays.
    """
    with draft_of(path) as draft:
        return send_recording(trials, draft, header, **options)


def send_recording(
    trials: Iterable[Trial],
    to: Target,
    header: Mapping[str, object],
    *,
    name: str = "run",
    only: int | None = None,
    run_first: bool = False,
    frames: Sequence[Frame] = (),
) -> int:
    """Send trials to a file, a viewer or a feed, and return their number.

    Parameters
    ----------
    to : as of `recording`.
    header : configuration of the run, as the log holds it.
    name : of the recording.
    only : as of `Replay`.
    run_first : open the run's tab first.
    frames : of the robot in the first trial.
    """
    try:
        with recording(name, to) as (stream, bring):
            replay = Replay(stream, header, only=only)
            for number, trial in enumerate(trials):
                replay.add(trial, () if number else frames)
                if replay.trials % _BATCH == 0:
                    bring()
            replay.close()
            replay.send_layout(run_first=run_first)
            return replay.trials
    finally:
        clean_up()


def clean_up() -> None:
    """Stop the threads of recordings that nobody holds any more; rerun leaves them running."""
    rerun_bindings.flush_and_cleanup_orphaned_recordings()
