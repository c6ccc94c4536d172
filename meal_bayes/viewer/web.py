"""The viewer's page in a browser, kept at home.

Rerun's web viewer reports to its makers from within the browser, and no setting of ours reaches it
there. So the page is handed on by a server of our own, with a policy (CSP) under which the browser
lets it talk to this machine and to nobody else.
"""

import threading
import urllib.error
import urllib.request
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

HERE = "127.0.0.1"
_BLOCK = 1 << 18  # bytes handed on at once
_PATIENCE = 30.0  # s


class Page:
    """A server on this machine that hands the viewer's page on.

    Parameters
    ----------
    behind : port where rerun serves the page.
    data : port of its data, the only other place that the page may ask.
    """

    def __init__(self, behind: int, data: int) -> None:
        home = f"http://{HERE}:{data}"
        policy = (
            "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; "
            "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
            f"worker-src 'self' blob:; connect-src 'self' data: blob: {home}; "
            "base-uri 'none'; form-action 'none'"
        )

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                _hand_on(self, f"http://{HERE}:{behind}{self.path}", policy)

            def log_message(self, *told: Any) -> None:
                """Say nothing."""

        self._server = ThreadingHTTPServer((HERE, 0), Handler)
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self.origin = f"http://{HERE}:{self._server.server_port}"
        self.address = f"{self.origin}/?url=rerun%2Bhttp%3A%2F%2F{HERE}%3A{data}%2Fproxy"

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()


def _hand_on(request: BaseHTTPRequestHandler, address: str, policy: str) -> None:
    try:
        with urllib.request.urlopen(address, timeout=_PATIENCE) as found:
            request.send_response(found.status)
            for name in ("Content-Type", "Content-Length"):
                if found.headers.get(name):
                    request.send_header(name, found.headers[name])
            request.send_header("Content-Security-Policy", policy)
            request.end_headers()
            while block := found.read(_BLOCK):
                request.wfile.write(block)
    except urllib.error.HTTPError as fault:
        request.send_error(fault.code)
    except (ConnectionError, TimeoutError, urllib.error.URLError):
        request.close_connection = True  # the browser or the viewer went away
