"""The cache of compiled code: the user's own and closed, or none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from meal_bayes import cache

ROOT = Path(cache.__file__).resolve().parents[1]
SAMPLE = Path(__file__).resolve().parents[1] / "logs" / "sample.mcap"


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A cache folder of one's own, and what was remembered of another forgotten."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr("numba.core.config.CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("MEAL_BAYES_CACHE_WARNED", raising=False)
    cache.private_folder.cache_clear()
    yield tmp_path / "cache"
    cache.private_folder.cache_clear()


def test_the_folder_is_the_user_s_alone(home):
    folder = cache.private_folder("numba")
    assert folder == home / "meal_bayes" / "numba"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert folder.parent.stat().st_mode & 0o777 == 0o700
    assert folder.stat().st_uid == os.getuid()
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("way", ["link", "link above", "open", "foreign", "file"])
def test_a_folder_that_others_can_fill_is_not_used(home, way, caplog, monkeypatch):
    folder = home / "meal_bayes" / "numba"
    if way == "file":
        home.write_text("no folder")
    elif way.startswith("link"):
        (home / "elsewhere").mkdir(parents=True, mode=0o700)
        link = folder if way == "link" else folder.parent
        link.parent.mkdir(exist_ok=True, mode=0o700)
        link.symlink_to(home / "elsewhere")
    else:
        folder.mkdir(parents=True, mode=0o700)
        folder.parent.chmod(0o700)
        if way == "open":
            folder.chmod(0o777)
        else:
            monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    assert cache.private_folder("numba") is None
    (record,) = caplog.records
    assert "no cache of compiled code" in record.message
    cache.private_folder.cache_clear()
    assert cache.private_folder("numba") is None
    assert len(caplog.records) == 1  # told once
    assert cache.compile_kernel(add_one, nogil=True)(1) == 2


def test_a_link_of_the_user_s_own_to_another_disk_is_followed(home, tmp_path):
    (tmp_path / "disk").mkdir(mode=0o700)
    home.symlink_to(tmp_path / "disk")
    assert cache.private_folder("numba") == home / "meal_bayes" / "numba"


def test_a_user_without_a_home_has_no_cache_and_one_warning(home, caplog, monkeypatch):
    """As of a number without an account, in a container, where nothing names a home."""

    def nowhere(*_, **__):
        raise RuntimeError("could not determine the home directory")

    monkeypatch.setattr(cache, "user_cache_path", nowhere)
    assert cache.cache_root() is None
    assert cache.private_folder("numba") is None
    (record,) = caplog.records
    assert "this user has no home folder" in record.getMessage()
    assert cache.compile_kernel(add_one)(1) == 2


def add_one(x):
    return x + 1


def test_kernels_are_kept_in_it_and_numba_s_own_setting_stays(home):
    from numba import config  # noqa: PLC0415  slow

    before = config.CACHE_DIR
    assert cache.compile_kernel(add_one, nogil=True)(1) == 2
    assert before == config.CACHE_DIR
    assert list((home / "meal_bayes" / "numba").rglob("*add_one*.nbi"))


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("content", [b"", b"\x80\x04torn", b"no pickle"])
def test_torn_files_of_the_cache_are_made_anew(home, ending, content):
    cache.compile_kernel(add_one)(1)
    (file,) = home.rglob(f"*add_one*.{ending}")
    whole = len(file.read_bytes())
    file.write_bytes(content)
    for _ in range(2):
        assert cache.compile_kernel(add_one)(1) == 2
    # Names in it count what was compiled before, so that lengths differ by some bytes.
    assert any(len(cached.read_bytes()) > whole / 2 for cached in home.rglob(f"*add_one*.{ending}"))


@pytest.mark.long
def test_a_log_is_told_of_without_any_cache(tmp_path):
    """As in a container: the package cannot be written, and there is no home."""
    environment = {
        **os.environ, "PYTHONPATH": str(ROOT), "HOME": "/dev/null/home",
        "XDG_CACHE_HOME": "/dev/null/cache",
        "NUMBA_CACHE_LOCATOR_CLASSES": "UserWideCacheLocator",  # as if the package were read-only
    }  # fmt: skip
    for name in ("MEAL_BAYES_CACHE_WARNED", "NUMBA_CACHE_DIR"):
        environment.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-m", "meal_bayes", "log", "info", str(SAMPLE)],
        env=environment, cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "5 trials" in done.stdout
    assert done.stderr.count("\n") <= 1


TWO = """
import sys
import time
from pathlib import Path
from numba.core import event
from meal_bayes.cache import compile_kernel
from test_cache_kernel import add_one
folder = Path(sys.argv[1])
class Watch(event.Listener):
    def on_start(self, compiling):
        with (folder / "compiled").open("a") as file:
            file.write("once\\n")
        while len(list(folder.glob("here*"))) < 2:  # until the other is about to compile, too
            time.sleep(0.01)
    def on_end(self, compiling):
        pass
kernel = compile_kernel(add_one)
(folder / ("here" + sys.argv[2])).touch()
with event.install_listener("numba:compile", Watch()):
    print(kernel(1))
"""


@pytest.mark.long
def test_of_two_programs_at_once_one_compiles_and_the_other_loads(tmp_path):
    (tmp_path / "test_cache_kernel.py").write_text("def add_one(x):\n    return x + 1\n")
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)]),
    }
    programs = [
        subprocess.Popen(
            [sys.executable, "-c", TWO, str(tmp_path), number],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for number in "12"
    ]
    for program in programs:
        assert program.communicate(timeout=100)[0] == "2\n"
    assert (tmp_path / "compiled").read_text() == "once\n"
