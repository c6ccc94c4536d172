"""Outputs: whole or not at all, never over an input; what others wrote is read within limits."""

import contextlib
import errno
import os
import resource
import stat
import subprocess
import sys
import tracemalloc
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from meal_bayes.cli.console import printable
from meal_bayes.datasets import load_dataset, load_percepts
from meal_bayes.datasets.csv_files import read_text
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError, LogError, MealBayesError, OutputError
from meal_bayes.files import (
    check_folder,
    check_output,
    command_line,
    draft_of,
    file_name,
    write_whole,
)
from meal_bayes.learner import Learner
from meal_bayes.posterior.idata import load_netcdf
from meal_bayes.trial_log import (
    Logs,
    TrialWriter,
    check_log,
    log_info,
    read_trials,
    recover_log,
)
from meal_bayes.trial_log.file import find_log, new_draft, stem_of
from meal_bayes.trial_log.folder import dated_name, log_files
from meal_bayes.untrusted import DEPTH_LIMIT, JSON_LIMIT, read_bytes, read_json


@contextlib.contextmanager
def small_disk(size):
    """Let no file grow beyond `size` bytes, as on a disk that is nearly full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_text_and_bytes_are_written_into_new_folders(tmp_path):
    write_whole(tmp_path / "a" / "b.txt", "Größe")
    write_whole(tmp_path / "a" / "c.bin", b"\0\1")
    assert (tmp_path / "a" / "b.txt").read_bytes() == "Größe".encode()
    assert (tmp_path / "a" / "c.bin").read_bytes() == b"\0\1"
    (tmp_path / "a" / "plain").touch()
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["b.txt", "c.bin", "plain"]
    assert len({path.stat().st_mode for path in (tmp_path / "a").iterdir()}) == 1


@pytest.mark.quick(12)
@pytest.mark.parametrize("kind", ["folder", "pipe", "device", "linked pipe"])
@pytest.mark.parametrize(
    "read",
    [
        load_netcdf,
        load_percepts,
        Learner.load,
        load_domain,
        load_dataset,
        lambda path: Learner("toy", posterior=path, logs=None),
        lambda path: list(read_trials(path)),
        check_log,
        read_text,
    ],
)
def test_what_is_no_regular_file_is_told_and_not_waited_for(tmp_path, kind, read):
    path = tmp_path / "file.npz"
    if kind == "folder":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        os.mkfifo(tmp_path / "pipe")
        path.symlink_to(tmp_path / "pipe")
    with pytest.raises(MealBayesError):
        read(path)


@pytest.mark.parametrize("read", [Learner.load, load_percepts])
def test_a_small_file_that_unpacks_to_gigabytes_is_refused_before_memory(tmp_path, read):
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("learner.json", "meta.npy"):
            archive.writestr(name, bytes(100 << 20))
    tracemalloc.start()
    try:
        with pytest.raises(DataError, match="claims to unpack"):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 10 << 20
    finally:
        tracemalloc.stop()


def test_a_full_disk_is_told_by_name_and_what_was_there_stays(tmp_path):
    path = tmp_path / "page.html"
    path.write_text("earlier")
    with small_disk(1000), pytest.raises(OutputError, match=r"page\.html cannot be written: "):
        write_whole(path, "x" * 5000)
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_a_fault_while_writing_leaves_what_was_there(tmp_path):
    path = tmp_path / "page.html"
    path.write_text("earlier")
    with pytest.raises(ZeroDivisionError), draft_of(path) as draft:
        draft.write_text(str(draft.write_text("half") / 0))
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_a_killed_writer_leaves_what_was_there(tmp_path):
    path = tmp_path / "page.html"
    path.write_text("earlier")
    code = (
        "import os, signal, sys\nfrom meal_bayes.files import draft_of\n"
        "with draft_of(sys.argv[1]) as draft:\n"
        "    draft.write_text('half')\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", code, str(path)], check=False).returncode == -9
    assert path.read_text() == "earlier"


def test_it_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    path = tmp_path / "page.html"
    seen = []
    sync = os.fsync

    def noted(descriptor):
        seen.append((Path(f"/proc/self/fd/{descriptor}").readlink(), path.exists()))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    write_whole(path, "text")
    (draft, there), (folder, renamed) = seen
    assert draft.name.startswith(".page.html.")
    assert not there
    assert (folder, renamed) == (tmp_path, True)


@pytest.mark.parametrize("way", ["name", "link", "hard link", "dots"])
def test_inputs_are_not_replaced(tmp_path, way):
    read = out = tmp_path / "read.csv"
    read.write_text("precious")
    if way != "name":
        out = tmp_path / ("x/../read.csv" if way == "dots" else way)
    if way == "link":
        out.symlink_to(read)
    elif way == "hard link":
        out.hardlink_to(read)
    for call, content in ((check_output, {}), (write_whole, {"content": "new"})):
        with pytest.raises(OutputError, match="is also an input"):
            call(out, **content, inputs=[read])
    assert read.read_text() == "precious"


@pytest.mark.parametrize("path", ["/dev/null", "/dev/full", "pipe", "folder"])
def test_only_regular_files_are_replaced(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    Path("folder").mkdir()
    kind = stat.S_IFMT(Path(path).stat().st_mode)
    with pytest.raises(OutputError, match="give the name of a"):
        write_whole(path, "page")
    assert stat.S_IFMT(Path(path).stat().st_mode) == kind


def test_links_and_permissions_stay(tmp_path):
    real = tmp_path / "real.html"
    link = tmp_path / "link.html"
    real.write_text("earlier")
    real.chmod(0o640)
    link.symlink_to(real)
    write_whole(link, "later")
    assert link.is_symlink()
    assert real.read_text() == "later"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


def test_a_place_is_tried_and_left_as_it_was(tmp_path):
    assert check_output(tmp_path / "new" / "a.html") == tmp_path / "new" / "a.html"
    assert list((tmp_path / "new").iterdir()) == []
    (tmp_path / "file").touch()
    for call in (check_output, check_folder):
        with pytest.raises(OutputError, match=r"cannot be written: .*; give another place"):
            call(tmp_path / "file" / "below")


@pytest.mark.parametrize("below", ["", "below", "below/it"])
@pytest.mark.parametrize("kind", ["a file", "a link to nowhere, which is not there"])
def test_what_stands_in_a_folder_s_way_is_named(tmp_path, kind, below):
    place = tmp_path / "logs"
    if kind == "a file":
        place.touch()
    else:
        place.symlink_to("nowhere")
    doors = [
        lambda: check_folder(place / below),
        lambda: check_output(place / below / "a.html"),
        lambda: write_whole(place / below / "a.html", "text"),
        lambda: TrialWriter(place / below / "a.mcap", {}).__enter__(),
    ]
    for door in doors:
        with pytest.raises(MealBayesError, match=r"cannot be written: .*another place") as caught:
            door()
        assert f"{place} is {kind}" in str(caught.value)
        assert "File exists" not in str(caught.value)
    assert len(list(tmp_path.iterdir())) == 1


DOORS = {
    "log": lambda path: Learner("roc36", logs=path),
    "save": lambda path: Learner("roc36", logs=None).save(path),
    "load": Learner.load,
    "resume": lambda path: Learner("roc36", logs=None).resume(path),
    "posterior": lambda path: Learner("roc36", logs=None, posterior=path),
    "root": lambda path: load_dataset("roc36", root=path),
    "Logs": Logs,
    "read_trials": lambda path: list(read_trials(path)),
    "check_log": check_log,
    "log_info": log_info,
    "recover_log": recover_log,
    "check_output": check_output,
    "check_folder": check_folder,
}


@pytest.mark.quick(18)
@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("kind", ["long", "loop", "closed", "half a character"])
def test_paths_that_the_system_refuses_are_our_errors(tmp_path, monkeypatch, door, kind):
    path = tmp_path / "it"
    if kind == "long":
        path = tmp_path / ("n" * 300)
    elif kind == "half a character":
        path = f"{tmp_path}/\ud800"
    elif kind == "loop":
        path.symlink_to(tmp_path / "other")
        (tmp_path / "other").symlink_to(path)
    else:  # root reads what is closed to others

        def closed(asked, **options):
            if asked == path:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return looked(asked, **options)

        looked = Path.stat
        monkeypatch.setattr(Path, "stat", closed)
    with pytest.raises(MealBayesError, match=r"another"):
        DOORS[door](path)


def test_long_names_have_drafts(tmp_path):
    path = tmp_path / ("n" * 250)
    write_whole(path, "text")
    assert path.read_text() == "text"


@pytest.mark.parametrize("depth", [DEPTH_LIMIT + 1, 900, 50_000, 1_000_000])
@pytest.mark.parametrize(("left", "inside", "right"), [("[", "", "]"), ('{"a":', "1", "}")])
def test_deep_json_is_refused(depth, left, inside, right):
    with pytest.raises(ValueError, match=r"nested more than|more than 4,194,304"):
        read_json(left * depth + inside + right * depth)


def test_json_comes_back():
    read_json("[" * DEPTH_LIMIT + "]" * DEPTH_LIMIT)
    assert read_json('{"a": [1, 2.5, null, true, "x"]}') == {"a": [1, 2.5, None, True, "x"]}
    assert read_json(b'"\xc3\xa9"') == "\N{LATIN SMALL LETTER E WITH ACUTE}"


@pytest.mark.parametrize(
    "text",
    ["NaN", "-1e999", '{"\\udfff": 1}', "9" * 5000, "[1", "", b"\xff", " " * (JSON_LIMIT + 1)],
)
def test_json_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match=r"."):
        read_json(text)


def test_a_file_of_a_terabyte_asks_for_no_memory(tmp_path):
    path = tmp_path / "sparse"
    path.write_bytes(b"a = 1\n")
    os.truncate(path, 1 << 40)
    tracemalloc.start()
    with pytest.raises(ValueError, match="1,099,511,627,776 bytes, more than"):
        read_bytes(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1 << 20


def test_a_hole_in_a_text_is_told(tmp_path):
    path = tmp_path / "hole"
    path.write_bytes(b"a = 1\n")
    os.truncate(path, 1000)
    with pytest.raises(ValueError, match="a zero byte at 6"):
        read_bytes(path)


def test_what_may_never_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/zero")
    for name in ("pipe", "device", "."):
        with pytest.raises(OSError, match="no regular file"):
            read_bytes(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Größe\nline", "Größe\nline"),
        ("\x1b[2J", "\N{SYMBOL FOR ESCAPE}[2J"),
        (
            "\a\r\t\0",
            "\N{SYMBOL FOR BELL}\N{SYMBOL FOR CARRIAGE RETURN}"
            "\N{SYMBOL FOR HORIZONTAL TABULATION}\N{SYMBOL FOR NULL}",
        ),
        (
            "\x9b31m\x7f\N{RIGHT-TO-LEFT OVERRIDE}\udc80",
            "\N{REPLACEMENT CHARACTER}31m" + "\N{REPLACEMENT CHARACTER}" * 3,
        ),
    ],
)
def test_names_are_made_printable(text, shown):
    assert printable(text) == shown


@given(st.sets(st.text(st.characters(exclude_categories=[])), min_size=2, max_size=20))
def test_two_texts_are_never_one_file(texts):
    names = [file_name(text) for text in texts]
    assert len(set(names)) == len(texts)
    for name in names:
        assert (Path("logs") / name).resolve().parent == Path("logs").resolve()
        assert len(name.encode()) <= 60


ENDINGS = (".feedback", ".recovered", ".mcap", ".active", ".timing", ".w4", "-a3f9c2")
PARTS = [".", "..", "cup", "._", "/", "~", "-", " ", *ENDINGS]


@given(st.lists(st.sampled_from(PARTS), max_size=5).map("".join))
@example(".mine")  # a hidden file, which readers of a folder pass over
@example("cup.feedback")
@example("cup.w4")
def test_a_log_of_any_name_is_found_in_its_folder(text):
    entries = (file_name(text), f"1-{file_name(text)}", dated_name(text))
    with TemporaryDirectory() as folder:
        logs = [Path(folder, *names) for names in (
            (f"{entries[0]}.mcap",), (f"{entries[1]}.mcap",), (f"{entries[2]}.mcap",),
            (entries[0], "1.mcap"),
        )]  # fmt: skip
        for log in logs:
            with TrialWriter(log, {}):
                draft = new_draft(log)
        assert set(log_files(folder)) == set(logs)
        assert {stem_of(log) for log in logs} == {log.stem for log in logs}
        assert stem_of(draft) == logs[-1].stem


@pytest.mark.parametrize("name", [".mcap", "..mcap", "..x", "..", ".active", ".mcap.active"])
def test_a_file_of_an_odd_name_hinders_no_other(name, tmp_path):
    with TrialWriter(tmp_path / "run.mcap", {}):
        pass
    data = (tmp_path / "run.mcap").read_bytes()
    if name != "..":
        (tmp_path / name).write_bytes(data)
    assert log_files(tmp_path) == [tmp_path / "run.mcap"]
    with pytest.raises(LogError, match="There is no log"):
        find_log(tmp_path / "other.mcap")
    for other in ("..y", ".y"):  # of the stems "." and ".y"
        with contextlib.suppress(LogError):
            assert find_log(tmp_path / other) == tmp_path / name


SIGNS = st.characters(codec="utf-8", exclude_characters="\0") | st.sampled_from(
    "' \"$`\\!*~\n\t-\udce9"
)


@pytest.mark.long
@given(st.lists(st.text(SIGNS, max_size=6), max_size=8))
def test_a_shell_reads_the_words_of_a_shown_command(words):
    line = command_line("printf '%s\\0'", *words)
    assert line.isprintable()
    done = subprocess.run(["bash", "-c", line], capture_output=True, check=True)
    read = list(map(os.fsdecode, done.stdout.split(b"\0")))[:-1]
    assert read == (words or [""])


def test_a_path_that_looks_like_an_option_is_shown_as_a_path():
    assert command_line("show", Path("-x.mcap")) == "show ./-x.mcap"
    assert command_line("show", "--trial", Path("a b")) == "show --trial 'a b'"
