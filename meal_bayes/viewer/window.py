"""The viewer's program: a window, or a picture without a display.

It listens on 127.0.0.1 only, is started with its telemetry off, and ends with this process.
"""

import importlib.util
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Self

from rerun.experimental import ViewerClient

from meal_bayes.errors import LogError, MealBayesError
from meal_bayes.files import write_whole
from meal_bayes.processes import start

HERE = "127.0.0.1"
_SIZE = (1920, 1080)
_START, _SETTLE = 60.0, 90.0  # s until a viewer answers, until its picture no longer changes
_NOTICE = 5.0  # s that a picture must stay equal, as the viewer's own notices fade after 4
_POLL = 0.3  # s
_ERROR_LENGTH = 4000  # characters of a viewer's error output


class ViewerError(MealBayesError):
    """The viewer does not start, or shows nothing."""


class Viewer:
    """The viewer as a process of its own, which ends with the `with` block.

    Parameters
    ----------
    arguments : files to open and options of rerun's command line.
    headless : without a window; needs a Vulkan driver, which may be one in software.
    port : on which it is known to be ready; a free one for its data by default.
    """

    def __init__(
        self,
        arguments: Sequence[str | Path] = (),
        *,
        headless: bool = False,
        port: int | None = None,
    ) -> None:
        (data,) = free_ports(1)
        self._port = data if port is None else port
        self._command = [str(viewer_program()), *map(str, arguments)]
        self._command += ["--bind", HERE, "--port", str(data), "--hide-welcome-screen"]
        self.url = f"rerun+http://{HERE}:{data}/proxy"
        if headless:
            self._command += ["--headless", "--window-size", f"{_SIZE[0]}x{_SIZE[1]}"]
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: IO[bytes]

    def __enter__(self) -> Self:
        # Telemetry is off where CI is set; a program in a CI reports to nobody.
        environment = {**os.environ, "CI": "1", "RUST_LOG": os.environ.get("RUST_LOG", "error")}
        self._errors = tempfile.TemporaryFile()  # a pipe that nobody empties would stop it
        self._process = start(
            self._command, env=environment, stdout=subprocess.DEVNULL, stderr=self._errors
        )
        return self

    def __exit__(self, *error: object) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._errors.close()

    @property
    def running(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    def wait(self) -> None:
        """Wait until the user closes it.

        Raises
        ------
        ViewerError : it ended with an error, such as on a machine without a display.
        """
        if self._process is None:
            return
        if self._process.wait():
            self._errors.seek(0)
            raise ViewerError(_error_message(self._errors.read()))

    def wait_until_ready(self) -> None:
        """Wait until it listens; raises as `wait` does."""
        end = time.monotonic() + _START
        while time.monotonic() < end:
            if not self.running:
                self.wait()
                raise ViewerError("The viewer ended before it could show anything.")
            try:
                socket.create_connection((HERE, self._port), timeout=1).close()
            except OSError:
                time.sleep(_POLL)
            else:
                return
        raise ViewerError(f"The viewer does not answer after {_START:.0f} s.")

    def client(self) -> ViewerClient:
        """Return a client that controls it, once it is ready."""
        self.wait_until_ready()
        client, end = ViewerClient.connect(self.url), time.monotonic() + _START
        while True:
            try:
                client.get_state()
            except Exception as fault:  # whatever the transport raises while it is not up yet
                if not self.running or time.monotonic() > end:
                    raise ViewerError(f"The viewer cannot be controlled: {fault}.") from fault
                time.sleep(_POLL)
            else:
                return client


def take_picture(
    recording: str | Path, path: str | Path | None = None, *, row: int = 0
) -> tuple[bytes, Any]:
    """Return a picture (PNG) of a recording in a viewer without a window, and the viewer's state.

    Parameters
    ----------
    recording : .rrd file.
    path : file to write the picture to, if any.
    row : on the timeline `step`.

    Raises
    ------
    ViewerError : the viewer does not start (no Vulkan driver), or its picture never settles.
    """
    with Viewer(headless=True) as viewer:
        client = viewer.client()
        client.open(str(Path(recording).resolve()))
        client.set_time("step", sequence=row, play_state="paused")
        picture = _stable_picture(client, _NOTICE)
        state = client.get_state()
    if path is not None:
        write_whole(path, picture)
    return picture, state


def _stable_picture(client: ViewerClient, quiet: float) -> bytes:
    """Return the picture once it has not changed for so many seconds."""
    end, since, last = time.monotonic() + _SETTLE, time.monotonic(), b""
    while time.monotonic() < end:
        time.sleep(_POLL)
        if client.get_state().loading:
            continue
        picture = client.take_screenshot()
        if picture != last:
            last, since = picture, time.monotonic()
        elif time.monotonic() - since >= quiet:
            return picture
    raise ViewerError(f"The viewer's picture still changes after {_SETTLE:.0f} s.")


def viewer_program() -> Path:
    """Return the path of rerun's binary, as its Python wrapper leaves it running when killed."""
    found = importlib.util.find_spec("rerun_cli")
    places = list(found.submodule_search_locations or ()) if found is not None else []
    for place in map(Path, places):
        for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun"):
            if (place / name).is_file():
                return place / name
    raise ViewerError(
        "The viewer's program is missing; install it with: pip install 'rerun-sdk>=0.41,<0.42'"
    )


def free_ports(count: int) -> list[int]:
    """Return ports that nobody listens on."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for one in sockets:
            one.bind((HERE, 0))
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()


def check_recording_name(path: Path) -> Path:
    """Check that the name of a recording ends in .rrd, and return it."""
    if path.suffix != ".rrd":
        raise LogError(f"A recording's name ends in .rrd; found {path.name!r}.")
    return path


def _error_message(output: bytes) -> str:
    text = " ".join(output.decode(errors="replace")[-_ERROR_LENGTH:].split())
    way = "give --web for a page in the browser, or --save FILE.rrd for another machine"
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return f"The viewer cannot open a window, as there is no display; {way}."
    if "adapter" in text:
        return f"The viewer finds no graphics driver (Vulkan); {way}."
    return f"The viewer ended with an error ({text[-300:] or 'no message'}); {way}."
