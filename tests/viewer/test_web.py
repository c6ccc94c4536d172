"""The page of `--web`: handed on whole, under a policy that names this machine and nobody else."""

import re
import threading
import urllib.error
import urllib.request
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from meal_bayes.viewer.web import HERE, Page

CONTENT = bytes(range(256)) * 4000


class Behind(BaseHTTPRequestHandler):
    """Stands for rerun's own server."""

    def do_GET(self):
        if self.path != "/re_viewer.wasm?x=1":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "application/wasm")
        self.send_header("Content-Length", str(len(CONTENT)))
        self.end_headers()
        self.wfile.write(CONTENT)

    def log_message(self, *told):
        pass


@pytest.fixture
def page():
    server = ThreadingHTTPServer((HERE, 0), Behind)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    made = Page(server.server_port, 4321)
    yield made
    made.close()
    server.shutdown()
    server.server_close()


def test_the_page_is_handed_on_under_the_policy(page):
    with urllib.request.urlopen(f"{page.origin}/re_viewer.wasm?x=1", timeout=10) as found:
        assert found.read() == CONTENT
        assert found.headers["Content-Type"] == "application/wasm"
        policy = found.headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'")
    assert re.findall(r"https?://\S+", policy) == ["http://127.0.0.1:4321;"]
    assert "*" not in policy
    assert page.origin.startswith("http://127.0.0.1:")
    assert page.address == f"{page.origin}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A4321%2Fproxy"


def test_what_is_not_there_is_not_there(page):
    with pytest.raises(urllib.error.HTTPError, match="404") as fault:
        urllib.request.urlopen(f"{page.origin}/secret", timeout=10)
    fault.value.close()
