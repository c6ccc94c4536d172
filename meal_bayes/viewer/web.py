"""The viewer as a page in a browser, kept at home.

Rerun's web viewer reports to its makers from within the browser, and no setting of ours reaches it
there; and its servers answer whoever asks. So rerun's program serves us its page once, and is
ended. From then on everything comes from a server of our own: page and recording lie under a
secret path, are given to requests of this host and origin only, and under a policy (CSP) by which
the browser lets the page talk to nobody else.
"""

import secrets
import threading
import urllib.error
import urllib.request
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, NamedTuple, Self

from meal_bayes.viewer.feed import Feed
from meal_bayes.viewer.window import HERE, Viewer, ViewerError, free_ports

_NAMES = ("", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico", "apple-touch-icon.png")
_RECORDING = "run.rrd"
_BLOCK = 1 << 18  # bytes handed on at once
_PATIENCE = 30.0  # s
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "worker-src 'self' blob:; connect-src 'self' data: blob:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # it would tell the secret
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class Asset(NamedTuple):
    """A file of the page."""

    kind: str  # media type
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
        """Of the page, to be opened in a browser of this machine; who knows it can see all."""
        return "" if self._page is None else self._page.address

    def __enter__(self) -> Self:
        self._page = Page(_assets(), self.recording)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        fault: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
        """Send what is asked for, to those who may have it."""
        name = self._allowed()
        if name is None:
            self._answer(HTTPStatus.FORBIDDEN)
        elif name == _RECORDING:
            self._stream()
        elif name in self.server.assets:
            asset = self.server.assets[name]
            self._answer(HTTPStatus.OK, asset.kind, len(asset.content))
            self._send(asset.content)
        else:
            self._answer(HTTPStatus.NOT_FOUND)

    def _refuse(self) -> None:
        allowed = self._allowed() is not None
        self._answer(HTTPStatus.METHOD_NOT_ALLOWED if allowed else HTTPStatus.FORBIDDEN)

    do_HEAD = do_POST = do_PUT = do_DELETE = do_OPTIONS = do_PATCH = _refuse

    def _allowed(self) -> str | None:
        """Name what is asked for; nothing where host, origin or secret are not ours."""
        server = self.server
        if self.headers.get_all("Host") != [server.host]:  # another name may lead here (DNS)
            return None
        if self.headers.get("Origin", f"http://{server.host}") != f"http://{server.host}":
            return None
        path = self.path.partition("?")[0]
        home, name = path[: len(server.home)], path[len(server.home) :]
        return name if secrets.compare_digest(home.encode(), server.home.encode()) else None

    def _answer(self, status: HTTPStatus, kind: str = "text/plain", size: int | None = 0) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if size is not None:
            self.send_header("Content-Length", str(size))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()

    def _stream(self) -> None:
        """Send the recording, and go on while it grows."""
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

    def log_message(self, *told: Any) -> None:
        """Say nothing."""


def _assets() -> dict[str, Asset]:
    """Fetch the page from rerun's program, which serves it on this machine for a moment."""
    (port,) = free_ports(1)
    # given a recording's address it serves the page alone, and no data
    words = [f"http://{HERE}:{port}/{_RECORDING}", "--serve-web", "--web-viewer-port", str(port)]
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # never by a proxy
    found = {}
    with Viewer(words, port=port) as rerun:
        rerun.wait_until_ready()
        for name in _NAMES:
            address = f"http://{HERE}:{port}/{name}"
            try:
                with opener.open(address, timeout=_PATIENCE) as answer:
                    kind = answer.headers.get_content_type()
                    found[name] = Asset(kind, answer.read())
            except urllib.error.HTTPError as fault:  # an icon, perhaps
                fault.close()
            except OSError as fault:
                raise ViewerError(
                    f"The viewer's program does not serve {address}: {fault}."
                ) from None
    if "" not in found:
        raise ViewerError("The viewer's program serves no page; install rerun-sdk again.")
    return found
