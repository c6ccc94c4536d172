"""Fetching from a folder or a local server: checksums, offline, the way out in every error."""

import functools
import hashlib
import http.server
import threading

import pytest

from meal_bayes.datasets import load_dataset, sources
from meal_bayes.datasets.sources import fetch, registry, verify
from meal_bayes.domain import load_domain
from meal_bayes.errors import DownloadError, SettingsError

HOME = "shiqizhang6/perception_pomdp/4ab4abf1a47ce184f0327d3c143533d482c2604c/data/icra2014"


@pytest.fixture
def mirror(tmp_path, monkeypatch):
    """Make a mirror of two files, whose checksums stand in the registry."""
    folder = tmp_path / "mirror"
    rows = {}
    for name, text in (("objects.txt", "light_brown_rice"), ("sub/a.txt", "1,2")):
        path = folder / HOME / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        rows[f"{HOME}/{name}"] = hashlib.sha256(text.encode()).hexdigest()
    monkeypatch.setattr(sources, "registry", lambda _data: rows)
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", str(folder))
    monkeypatch.delenv("MEAL_BAYES_OFFLINE", raising=False)
    return folder


@pytest.fixture
def server(mirror):
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format, *args):
            pass

    with http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Quiet, directory=str(mirror))
    ) as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{running.server_port}"
        running.shutdown()
        thread.join()


def states():
    return [state for _, state in verify("roc36")]


@pytest.mark.parametrize("kind", ["folder", "address", "server"])
def test_a_mirror_fills_the_cache(kind, server, mirror, tmp_path, monkeypatch):
    url = {"folder": f"{mirror}/", "address": f"file://{mirror}", "server": server}[kind]
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", url)
    assert states() == ["missing", "missing"]
    assert fetch("roc36") == tmp_path / "cache"
    assert states() == ["ok", "ok"]
    assert (tmp_path / "cache" / HOME / "sub" / "a.txt").read_text() == "1,2"


def test_what_is_cached_is_not_fetched_again(mirror, monkeypatch):
    fetch("roc36")
    (mirror / HOME / "objects.txt").unlink()
    fetch("roc36")
    monkeypatch.setenv("MEAL_BAYES_OFFLINE", "1")
    fetch("roc36")


def test_damaged_cache_is_mended(mirror, tmp_path):
    fetch("roc36")
    (tmp_path / "cache" / HOME / "objects.txt").write_text("light_brown_mice")
    assert sorted(states()) == ["changed", "ok"]
    fetch("roc36")
    assert states() == ["ok", "ok"]


def test_wrong_checksum_names_file_digests_and_way_out(mirror, tmp_path):
    (mirror / HOME / "objects.txt").write_text("heavy_blue_rice")
    digest = hashlib.sha256(b"heavy_blue_rice").hexdigest()[:12]
    expected = hashlib.sha256(b"light_brown_rice").hexdigest()[:12]
    with pytest.raises(DownloadError) as caught:
        fetch("roc36")
    message = str(caught.value)
    for part in ("objects.txt", digest, expected, "MEAL_BAYES_DATA_URL"):
        assert part in message
    assert "\n" not in message
    assert not (tmp_path / "cache" / HOME / "objects.txt").exists()
    assert not any((tmp_path / "cache").rglob("tmp*"))


@pytest.mark.parametrize("kind", ["folder", "server", "http://127.0.0.1:9"])  # nobody is there
def test_what_a_mirror_lacks_is_told_with_the_way_out(kind, server, mirror, monkeypatch):
    urls = {"folder": str(mirror), "server": server}
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", urls.get(kind, kind))
    (mirror / HOME / "sub" / "a.txt").unlink()
    says = r"Cannot get .*txt .*set MEAL_BAYES_DATA_URL to a mirror .*embedded percepts"
    with pytest.raises(DownloadError, match=says):
        fetch("roc36")


@pytest.mark.usefixtures("mirror")
def test_offline_forbids_the_network(monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_OFFLINE", "1")
    with pytest.raises(DownloadError, match=r"is missing .2 files of roc36 in all.*unset it"):
        load_dataset("roc36")
    monkeypatch.setenv("MEAL_BAYES_OFFLINE", "0")
    fetch("roc36")


def test_registry_lists_every_file_the_domains_need():
    for data, separator, others in (("roc36", "-", 3), ("ispy32", "_", 2), ("cy101", "_", 2)):
        listed = registry(data)
        contexts = [f"{separator.join(names)}.txt" for names in load_domain(data).contexts]
        assert len(listed) == len(contexts) + others
        for name in contexts:
            assert sum(path.endswith(f"/{name}") for path in listed) == 1
        assert all(len(digest) == 64 for digest in listed.values())


def test_unknown_data_set():
    with pytest.raises(SettingsError, match="did you mean 'roc36'"):
        registry("rock36")


@pytest.mark.real_data
def test_registry_agrees_with_the_recordings(recordings):
    for data in ("roc36", "ispy32", "cy101"):
        for name, digest in registry(data).items():
            assert hashlib.sha256((recordings / name).read_bytes()).hexdigest() == digest
