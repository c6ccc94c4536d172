"""The viewer's program: a window, a page for a browser, or a picture without a display.

It listens on 127.0.0.1 only, is started with its telemetry off, and ends with this process. The
page is rerun's own: any program of this machine can open it, and within the browser rerun's
telemetry is on until it is switched off in the page's settings.
"""

import contextlib
import importlib.util
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, NoReturn, Self, TypeVar
from urllib.parse import quote

from rerun.experimental import ViewerClient

from meal_bayes.errors import LogError, MealBayesError
from meal_bayes.files import checked_path
from meal_bayes.processes import start

Result = TypeVar("Result")

HERE = "127.0.0.1"
_SIZE = (1920, 1080)
_START = 60.0  # s until a viewer answers, until its picture no longer changes
_SETTLE = 90.0
_NOTICE = 5.0  # s that a picture must stay equal, as the viewer's own notices fade after 4
_POLL = 0.3  # s
_OTHER_WAYS = "give --web for a page in the browser, or --save FILE.rrd for another machine"
_DYING = 5.0  # s that a program which broke off a connection may take to end


class ViewerError(MealBayesError):
    """Error raised if the viewer does not start, or shows nothing."""


class Viewer:
    """The viewer as a process of its own, which ends with the `with` block.

    The viewer opens a window, serves a page (`web`), or does neither (`headless`). A headless
    viewer needs a Vulkan driver, for example one in software.

    Parameters
    ----------
    arguments : Sequence[str | Path]
        Files to open and options of rerun's command line.
    headless : bool
        Whether the viewer runs without a window, for pictures.
    web : bool
        Whether the viewer serves a page for a browser.
    size : tuple[int, int]
        Width and height of the picture of a headless viewer, pixels.

    Attributes
    ----------
    url, address : str
        Address to which recordings are sent, and address of the page, or "" without a page.
    """

    def __init__(
        self,
        arguments: Sequence[str | Path] = (),
        *,
        headless: bool = False,
        web: bool = False,
        size: tuple[int, int] = _SIZE,
    ) -> None:
        with socket.socket() as first, socket.socket() as second:  # ports that nobody listens on
            for free in (first, second):
                free.bind((HERE, 0))
            data = first.getsockname()[1]
            page = second.getsockname()[1]
        self._port = page if web else data  # the one that opens last
        self._command = [str(viewer_program()), *map(str, arguments)]
        self._command += ["--bind", HERE, "--port", str(data), "--hide-welcome-screen"]
        self.url = f"rerun+http://{HERE}:{data}/proxy"
        self.address = ""
        if web:
            self._command += ["--serve-web", "--web-viewer-port", str(self._port)]
            self.address = f"http://{HERE}:{self._port}/?url={quote(self.url, safe='')}"
        if headless:
            self._command += ["--headless", "--window-size", f"{size[0]}x{size[1]}"]

    def __enter__(self) -> Self:
        # Telemetry is off where CI is set; a program in a CI reports to nobody.
        environment = {**os.environ, "CI": "1", "RUST_LOG": os.environ.get("RUST_LOG", "error")}
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # a full pipe would stop it
        self._process = start(
            self._command,
            environment=environment,
            output=subprocess.DEVNULL,
            errors=self._errors,
        )
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait()
        self._errors.close()

    @property
    def running(self) -> bool:
        """Whether the process of the viewer runs."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Wait until the user closes the viewer; raise a `ViewerError` if it fails."""
        if not self._process.wait():
            return
        self._errors.seek(0)
        text = " ".join(self._errors.read().decode(errors="replace").split())
        panic = text.partition("panicked at ")[2]
        reason = f"The viewer ended with an error ({(panic or text[-300:])[:300] or 'no message'});"
        if panic:  # the program itself failed: a driver was found
            pass
        elif "adapter" in text or "render context" in text:
            driver = "mesa-vulkan-drivers has one in software, for machines without a screen too"
            reason = f"The viewer finds no graphics driver (Vulkan); install one ({driver}), or"
        elif sys.platform == "linux" and not any(
            map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))
        ):
            reason = "The viewer cannot open a window, as there is no display;"
        raise ViewerError(f"{reason} {_OTHER_WAYS}.")

    def wait_until_ready(self) -> None:
        """Wait until the viewer accepts connections; errors as for `wait`."""
        self._until(lambda: socket.create_connection((HERE, self._port), timeout=1).close())

    def client(self) -> ViewerClient:
        """Return a client that controls the viewer, once it is ready; errors as for `wait`."""
        self.wait_until_ready()
        client = self._until(lambda: ViewerClient.connect(self.url))
        self._until(client.get_state)
        return client

    def _until(self, act: Callable[[], Result]) -> Result:
        """Call until nothing is raised any more, for as long as a start may take."""
        end = time.monotonic() + _START
        while True:
            try:
                return act()
            except Exception as fault:  # whatever the transport raises while it is not up yet
                if not self.running or time.monotonic() > end:
                    self.explain(fault)
                time.sleep(_POLL)

    def explain(self, fault: Exception) -> NoReturn:
        """Raise an error that says why the viewer ended, or that it does not answer."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_DYING)
            self.wait()
        if isinstance(fault, TimeoutError):
            raise ViewerError(
                "The viewer started, but did not answer in time. Try again when the machine is "
                f"less busy; or {_OTHER_WAYS}."
            ) from fault
        raise ViewerError(f"The viewer cannot be controlled: {fault}.") from fault


def take_picture(recording: str | Path, *, row: int = 0, size: tuple[int, int] = _SIZE) -> bytes:
    """Return a picture (PNG) of a recording at a row of the timeline `step`, without a window.

    `size` is the width and height of the picture in pixels.

    A `ViewerError` is raised if the viewer does not start (without a Vulkan driver), or if the
    picture never stops changing.
    """
    path = checked_path("The recording", recording).resolve()
    with Viewer(headless=True, size=size) as viewer:
        client = viewer.client()
        try:
            client.open(str(path))
            client.set_time("step", sequence=row, play_state="paused")
            return _stable_picture(client, _NOTICE)
        except (ConnectionError, TimeoutError) as fault:
            viewer.explain(fault)


def _stable_picture(client: ViewerClient, quiet: float) -> bytes:
    """Return the picture once it has not changed for so many seconds."""
    end = time.monotonic() + _SETTLE
    since = time.monotonic()
    last = b""
    while time.monotonic() < end:
        time.sleep(_POLL)
        if client.get_state().loading:
            continue
        picture = client.take_screenshot()
        if picture != last:
            last = picture
            since = time.monotonic()
        elif time.monotonic() - since >= quiet:
            return picture
    raise ViewerError(
        f"The viewer's picture still changes after {_SETTLE:.0f} s. Try again when the machine is "
        "less busy, or give --save FILE.rrd and open the file with: rerun FILE.rrd."
    )


def viewer_program() -> Path:
    """Return the path of rerun's binary, as its Python wrapper leaves it running when killed."""
    spec = importlib.util.find_spec("rerun_cli")
    for folder in (spec and spec.submodule_search_locations) or ():
        for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun"):
            program = Path(folder, name)
            if program.is_file():
                return program
    raise ViewerError(
        "The viewer's program is missing; install it with: pip install --force-reinstall rerun-sdk"
    )


def check_recording_name(path: Path) -> Path:
    """Check that the name of a recording ends in .rrd, and return it."""
    if path.suffix != ".rrd":
        raise LogError(f"A recording's name ends in .rrd; found {path.name!r}.")
    return path
