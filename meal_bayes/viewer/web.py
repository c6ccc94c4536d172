"""The viewer as a page in a browser of this machine.

Rerun's web viewer sends telemetry from within the browser, which no setting of ours reaches, and
its servers answer any client. So rerun's program serves its page once, and is ended. From then on
a server of our own sends page and recording, under a secret path, to requests of this host and
origin only, with a content security policy by which the browser connects the page to nothing else.
"""

import secrets
import threading
import urllib.error
import urllib.request
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple, Self

from meal_bayes.viewer.feed import Feed
from meal_bayes.viewer.window import HERE, Viewer, ViewerError, free_ports

_NAMES = ("", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico", "apple-touch-icon.png")
_RECORDING = "run.rrd"
_BLOCK = 1 << 18  # bytes sent at once
_TIMEOUT = 30.0  # s
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "worker-src 'self' blob:; connect-src 'self' data: blob:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # it would disclose the secret
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class Asset(NamedTuple):
    """A file of the page, and its media type."""

    media_type: str
    content: bytes


class WebViewer:
    """The page and its recording, served to this machine while the `with` block runs.

    Attributes
    ----------
    recording : what the page shows; it may grow while it is shown.
    """

    def __init__(self) -> None:
        self.recording = Feed()
        self._page: Page | None = None

    @property
    def address(self) -> str:
        """Address of the page, to be opened in a browser of this machine; it holds the secret."""
        return "" if self._page is None else self._page.address

    def __enter__(self) -> Self:
        self._page = Page(_assets(), self.recording)
        return self

    def __exit__(self, *error: object) -> None:
        self.recording.close()
        if self._page is not None:
            self._page.close()

    def wait(self) -> None:
        """Wait for Ctrl-C."""
        threading.Event().wait()


class Page:
    """A server on this machine for one page and its recording.

    Parameters
    ----------
    assets : files of the page by name; "" is the page itself.
    recording : what it shows.
    """

    def __init__(self, assets: Mapping[str, Asset], recording: Feed) -> None:
        secret = secrets.token_urlsafe(24)
        self._server = _Server(assets, recording, f"/{secret}/")
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self.origin = f"http://{self._server.host}"
        home = f"{self.origin}/{secret}/"
        shown = urllib.request.quote(f"{home}{_RECORDING}", safe="")  # type: ignore[attr-defined]
        self.address = f"{home}?url={shown}"

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, assets: Mapping[str, Asset], recording: Feed, home: str) -> None:
        super().__init__((HERE, 0), _Handler)
        self.assets, self.recording, self.home = assets, recording, home
        self.host = f"{HERE}:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        """Send a file to an allowed request."""
        name = self._allowed()
        if name is None:
            self._answer(HTTPStatus.FORBIDDEN)
        elif name == _RECORDING:
            self._stream()
        elif name in self.server.assets:
            asset = self.server.assets[name]
            self._answer(HTTPStatus.OK, asset.media_type, len(asset.content))
            self._send(asset.content)
        else:
            self._answer(HTTPStatus.NOT_FOUND)

    def _refuse(self) -> None:
        allowed = self._allowed() is not None
        self._answer(HTTPStatus.METHOD_NOT_ALLOWED if allowed else HTTPStatus.FORBIDDEN)

    do_HEAD = do_POST = do_PUT = do_DELETE = do_OPTIONS = do_PATCH = _refuse

    def _allowed(self) -> str | None:
        """Return the name of the file; None where host, origin or secret are not ours."""
        server = self.server
        if self.headers.get_all("Host") != [server.host]:  # another name may lead here (DNS)
            return None
        if self.headers.get("Origin", f"http://{server.host}") != f"http://{server.host}":
            return None
        path = self.path.partition("?")[0]
        home, name = path[: len(server.home)], path[len(server.home) :]
        return name if secrets.compare_digest(home.encode(), server.home.encode()) else None

    def _answer(
        self, status: HTTPStatus, media_type: str = "text/plain", size: int | None = 0
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", media_type)
        if size is not None:
            self.send_header("Content-Length", str(size))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()

    def _stream(self) -> None:
        """Send the recording, while it grows."""
        self._answer(HTTPStatus.OK, "application/octet-stream", None)
        sent = 0
        while block := self.server.recording.read(sent, _BLOCK):
            if not self._send(block):
                return
            sent += len(block)

    def _send(self, data: bytes) -> bool:
        try:
            self.wfile.write(data)
        except (ConnectionError, TimeoutError):  # the browser went away
            self.close_connection = True
            return False
        return True

    def log_message(self, *message: Any) -> None:
        """Print nothing."""


def _assets() -> dict[str, Asset]:
    """Read the page from rerun's program, which serves it on this machine meanwhile."""
    (port,) = free_ports(1)
    # given a recording's address it serves the page alone, and no data
    arguments = [
        f"http://{HERE}:{port}/{_RECORDING}",
        "--serve-web",
        "--web-viewer-port",
        str(port),
    ]
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # never by a proxy
    found = {}
    with Viewer(arguments, port=port) as rerun:
        rerun.wait_until_ready()
        for name in _NAMES:
            address = f"http://{HERE}:{port}/{name}"
            try:
                with opener.open(address, timeout=_TIMEOUT) as answer:
                    found[name] = Asset(answer.headers.get_content_type(), answer.read())
            except urllib.error.HTTPError as fault:  # an icon, perhaps
                fault.close()
            except OSError as fault:
                raise ViewerError(
                    f"The viewer's program does not serve {address}: {fault}."
                ) from None
    if "" not in found:
        raise ViewerError("The viewer's program serves no page; install rerun-sdk again.")
    return found
