"""The page of `--web`: everything under a secret, for this host and origin, and for nobody else."""

import http.client
import io
import os
import re
import signal
import subprocess
import sys
import threading
import urllib.parse
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image as png

from meal_bayes.viewer import WebViewer, send_recording, web
from meal_bayes.viewer.feed import Feed
from meal_bayes.viewer.web import HERE, Asset, Page

ROOT = Path(web.__file__).resolve().parents[2]
CONTENT = bytes(range(256)) * 4000
ASSETS = {
    "": Asset("text/html", b"<html>"),
    "re_viewer_bg.wasm": Asset("application/wasm", CONTENT),
}


@pytest.fixture
def feed():
    made = Feed()
    made.append(b"rrd" * 1000)
    yield made
    made.close()


@pytest.fixture
def page(feed):
    made = Page(ASSETS, feed)
    yield made
    made.close()


def ask(page, path, *, method="GET", host=None, **headers):
    """Send one request and return the answer, with its content."""
    place = urllib.parse.urlsplit(page.address)
    connection = http.client.HTTPConnection(HERE, place.port, timeout=20)
    connection.putrequest(method, path, skip_host=True)
    for name in [place.netloc] if host is None else host:
        connection.putheader("Host", name)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    answer.content = answer.read()
    connection.close()
    return answer


def home(page):
    return urllib.parse.urlsplit(page.address).path


def test_the_page_and_its_files_are_given_under_the_policy(page):
    for name, asset in ASSETS.items():
        found = ask(page, f"{home(page)}{name}?x=1", Origin=page.origin)
        assert (found.status, found.content) == (200, asset.content)
        assert found.headers["Content-Type"] == asset.media_type
        policy = found.headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'")
        assert not re.findall(r"https?:|\*", policy)
        assert found.headers["Referrer-Policy"] == "no-referrer"
        assert found.headers["Cache-Control"] == "no-store"
    assert ask(page, f"{home(page)}none").status == 404


def test_the_address_names_page_and_recording_with_the_secret(page, feed):
    shown = urllib.parse.urlsplit(page.address)
    assert shown.hostname == HERE
    assert len(home(page).strip("/")) >= 32
    (url,) = urllib.parse.parse_qs(shown.query)["url"]
    assert url == f"{page.origin}{home(page)}run.rrd"
    other = Page(ASSETS, feed)
    other.close()
    assert home(other) != home(page)


@pytest.mark.parametrize("name", ["", "re_viewer_bg.wasm", "run.rrd", "none"])
@pytest.mark.parametrize("method", ["GET", "HEAD", "POST", "OPTIONS", "PUT", "DELETE", "PATCH"])
def test_strangers_are_refused_everything(page, feed, name, method):
    feed.end()
    path, port = f"{home(page)}{name}", page.origin.rpartition(":")[2]
    for host in ([f"localhost:{port}"], ["evil.example"], [f"evil.example:{port}"], [],
                 [f"{HERE}:{port}", "evil.example"], [HERE]):  # fmt: skip
        assert ask(page, path, method=method, host=host).status == 403
    for origin in ("http://evil.example", "null", f"http://localhost:{port}", page.origin + "0"):
        assert ask(page, path, method=method, Origin=origin).status == 403
    for guess in ("/", f"/{name}", f"/{'x' * 32}/{name}", path[1:], path.upper(), f"/%2e{path}"):
        found = ask(page, guess, method=method)
        assert found.status == 403
        assert b"rrd" not in found.content


def test_other_methods_are_not_for_anybody(page):
    assert ask(page, home(page), method="POST").status == 405


def test_a_recording_is_given_while_it_grows(page, feed):
    place, seen = urllib.parse.urlsplit(page.address), []
    connection = http.client.HTTPConnection(HERE, place.port, timeout=20)
    connection.request("GET", f"{home(page)}run.rrd")
    answer = connection.getresponse()
    seen.append(answer.read(3000))
    feed.append(b"more")
    seen.append(answer.read(4))
    feed.end()
    seen.append(answer.read())
    connection.close()
    assert seen == [b"rrd" * 1000, b"more", b""]
    assert ask(page, f"{home(page)}run.rrd").content == b"rrd" * 1000 + b"more"


def test_a_feed_has_no_name_and_ends(feed, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    own = Feed()
    own.append(b"x" * 100_000)
    assert list(tmp_path.iterdir()) == []
    assert own.size == 100_000
    reader = threading.Thread(target=own.read, args=(100_000, 1))
    reader.start()
    own.close()
    reader.join(20)
    assert not reader.is_alive()
    assert own.read(0, 1) == b""
    own.append(b"after the end")
    assert own.size == 100_000


@pytest.fixture(scope="module")
def viewing(tmp_path_factory):
    """`view --web` as a process of its own, behind a proxy that would answer anything."""
    folder = tmp_path_factory.mktemp("viewing")
    environment = {
        **os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(folder),
        "http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9", "no_proxy": "",
    }  # fmt: skip
    sample = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
    command = [sys.executable, "-m", "meal_bayes", "view", str(sample), "--web"]
    with subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        address = process.stdout.readline().removeprefix("open ").strip()
        yield process, address, folder
        process.kill()


def listening():
    """Local addresses on which anybody accepts connections, as the kernel writes them."""
    rows = [line.split() for table in ("tcp", "tcp6")
            for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]]  # fmt: skip
    return {row[1] for row in rows if row[3] == "0A"}


def test_rerun_s_own_page_is_what_is_served(viewing):
    _, address, _ = viewing
    page = type("Served", (), {"address": address, "origin": address.rpartition("/")[0]})
    assert b"re_viewer" in ask(page, home(page)).content
    assert ask(page, f"{home(page)}re_viewer_bg.wasm").content[:4] == b"\0asm"
    assert ask(page, f"{home(page)}run.rrd").content[:3] == b"RRF"


def test_nothing_listens_or_remains_after_a_kill(viewing):
    process, address, folder = viewing
    mine = f"0100007F:{urllib.parse.urlsplit(address).port:04X}"
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    assert children == []  # rerun has ended
    assert mine in listening()
    assert not any(place.startswith("00000000:" + mine[-4:]) for place in listening())
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert mine not in listening()
    assert list(folder.iterdir()) == []


@pytest.mark.long
def test_a_browser_shows_the_trials(trials):
    """Chromium draws the page: every view of the layout, in colors."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="pip install 'meal-bayes[view]'")
    chromium = next((p for p in map(Path, ("/usr/bin/chromium",)) if p.is_file()), None)
    if chromium is None:
        reason = "no browser: apt-get install --no-install-recommends chromium"
        if os.environ.get("MEAL_BAYES_REQUIRE_VIEW") == "1":
            pytest.fail(f"required but missing: {reason}")
        pytest.skip(reason)
    options = ["--no-sandbox", "--headless=new", "--use-angle=swiftshader",
               "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]  # fmt: skip
    with WebViewer() as viewer, sync_api.sync_playwright() as browsers:
        send_recording(trials, viewer.recording, {})
        browser = browsers.chromium.launch(executable_path=chromium, args=options)
        page = browser.new_page(viewport={"width": 1200, "height": 800})
        asked, answered, said = [], [], []
        page.on("request", lambda request: asked.append(request.url))
        page.on("requestfinished", lambda request: answered.append(request.url))
        page.on("console", lambda message: said.append(message.text))
        page.goto(f"{viewer.address}&renderer=webgl")
        colors = 0
        for _ in range(60):  # until the layout is drawn
            page.wait_for_timeout(1000)
            if any("has finished" in text for text in said):
                pixels = png.imread(io.BytesIO(page.screenshot(timeout=120_000)))[..., :3]
                colors = len(np.unique((pixels * 8).astype(np.uint8).reshape(-1, 3), axis=0))
                if colors > 60:
                    break
        browser.close()
        assert colors > 60
        assert all(url.startswith(viewer.address.partition("?")[0]) for url in answered)
        assert any(url.endswith("run.rrd") for url in asked)
