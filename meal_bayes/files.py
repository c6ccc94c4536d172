"""Files that people name: written whole or not at all, and never over what must stay.

Every output goes through `draft_of`: a draft of a unique name in the same folder, which is synced
to the disk and renamed when it is whole. What stood under the name before stays until then, also
when the disk is full or the process is killed. Drafts of logs, which programs read while they
grow, are named in `trial_log/file.py`.

What may be replaced:

- A log of trials is replaced by the run or the command that wrote it, which chose its name by its
  settings, or where a program says `overwrite=True`; by nothing else (`name_new`).
- The file of a learner is replaced by `Learner.save` alone, and one that another program has saved
  since only where a program says `overwrite=True`.
- Reports, figures, pictures, recordings of the viewer, percept tables and other results can be
  computed again: they replace what has their name, and that is told in the log (INFO).
- A file that the same command reads, a folder, a device and a pipe are never replaced.
"""

import contextlib
import hashlib
import logging
import os
import re
import secrets
import shlex
import stat
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from meal_bayes.errors import DataError, OutputError, SettingsError

if sys.platform != "win32":
    import fcntl

log = logging.getLogger("meal_bayes.files")
LOGS = "logs"  # folder of the logs of trials and runs, by default
# Endings that have a meaning in `trial_log`, so no other file may have them.
_RESERVED = re.compile(r"\.(feedback|recovered|timing|active|w\d+(-[0-9a-f]{6})?)$")
_LOG_MAGIC = b"\x89MCAP0\r\n"
LEARNER = "learner.json"  # member of the file of a learner, which tells it from other archives


def command_line(command: str, *words: str | Path) -> str:
    """Return a command and its words as a line that a shell reads back as these very words.

    Paths and names are data: they may hold blanks, quotes, or what no terminal shows.

    >>> command_line("meal-bayes log show", Path("my logs/a.mcap"))
    "meal-bayes log show 'my logs/a.mcap'"
    """
    return " ".join([command, *map(_shell_word, words)])


def _shell_word(word: str | Path) -> str:
    # A path that begins with a dash would be read as an option.
    text = f"./{word}" if isinstance(word, Path) and str(word).startswith("-") else str(word)
    if text.isprintable():
        return shlex.quote(text)
    return "$'" + "".join(f"\\x{byte:02x}" for byte in os.fsencode(text)) + "'"


def path_text(value: Any) -> Any:
    """Return a path that a user gives as a text, with the home folder in place of a first `~`.

    What is no path is returned as it is; a name of something that ships stays a name, too.

    >>> path_text(Path("own.toml")), path_text("roc36")
    ('own.toml', 'roc36')
    """
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else value
    if not isinstance(text, str) or not text.startswith("~"):
        return text
    try:
        return str(Path(text).expanduser())
    except RuntimeError:
        raise SettingsError(
            f"{text!r:.300} names the home folder of an unknown user; if the name of the file "
            f"begins with ~, write './{text:.300}'."
        ) from None


def checked_path(what: str, value: object) -> Path:
    """Return a path that a user gives; a `SettingsError` where it is none, such as 3 or "".

    A first `~` is the home folder.

    >>> checked_path("log", 3)
    Traceback (most recent call last):
    meal_bayes.errors.SettingsError: log is 3; give a path, as a text or a Path.
    """
    text = path_text(value)
    if not isinstance(text, str) or not text or "\0" in text:
        raise SettingsError(f"{what} is {value!r:.60}; give a path, as a text or a Path.")
    try:
        Path(text).stat()
    except (FileNotFoundError, NotADirectoryError):  # to come, or said by whoever reads it
        pass
    except OSError as fault:  # a name that is too long, links in a loop, a folder that is closed
        raise SettingsError(f"{what} {text!r:.300}: {fault.strerror}; give another path.") from None
    except UnicodeEncodeError:  # half a character
        raise SettingsError(
            f"{what} {text!a:.300} is not a valid file name; give another."
        ) from None
    return Path(text)


def regular_file(what: str, value: object) -> Path:
    """Return a `checked_path` to read; a `DataError` where it is a folder, a pipe or a device.

    Whoever opens a pipe that nobody writes to waits for ever. What is not there is told by its
    reader.
    """
    path = checked_path(what, value)
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "a pipe or a device"
        raise DataError(f"{what} {path} is {kind}; give the path of a regular file.")
    return path


def lasting_path(what: str, value: object) -> Path:
    """Return a `checked_path` that stays where it is when the process changes its folder."""
    path = checked_path(what, value)
    try:
        return path.absolute()
    except FileNotFoundError:
        raise SettingsError(
            f"{what} is {str(path)!r:.300}, but the current folder of this process does not "
            "exist any more; give a path that begins with /."
        ) from None


def file_name(text: str, longest: int = 60) -> str:
    """Return any text as a name of a file, in no other folder; other texts have other names.

    The name neither begins with a dot, as readers of a folder pass over hidden files, nor ends as
    only drafts, recovered logs and logs of feedback do.

    >>> file_name("bayes")
    'bayes'
    >>> file_name("../a blue cup"), file_name("../a_blue_cup")
    ('__a_blue_cup-8e83c849', '__a_blue_cup-ba66d6d8')
    >>> file_name(".bayes"), file_name("cup.feedback")
    ('_bayes-b5af724b', 'cup.feedback-13b0a887')
    """
    name = re.sub(r"[^\w.-]+|^\.+|^$", "_", text)
    reserved = _RESERVED.search(name) is not None
    if name != text or reserved or len(name.encode()) > longest:  # file systems count bytes
        digest = hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:8]
        name = f"{name.encode()[: longest - 9].decode(errors='ignore')}-{digest}"
    return name


def check_output(
    path: str | Path, *, inputs: Iterable[str | Path] = (), expected: bool = False
) -> Path:
    """Check that a file can be written, before the work that it is to hold; creates its folder.

    Returns the path with links followed; an `OutputError` where it is one of the inputs (files, or
    folders of files, that the same command reads), a trial log, the file of a learner (unless it is
    `expected` to be there), or no regular file.
    """
    named = checked_path("The output", path)
    target = Path(os.path.realpath(named))
    # Links are followed: an output may be a link to what is read.
    with _with_path(named):
        for read in (checked_path("The input", path) for path in inputs):
            if target.exists() and read.exists() and read.samefile(target):
                raise OutputError(f"{named} is also an input; give the output another name.")
        if target.is_dir():
            raise OutputError(f"{named} is a folder; give the name of a file.")
        if target.is_file():
            with target.open("rb") as file:
                if file.read(len(_LOG_MAGIC)) == _LOG_MAGIC:
                    raise OutputError(
                        f"{named} is a trial log, which is not replaced; give another name."
                    )
            if not expected and _is_learner(target):
                raise OutputError(
                    f"{named} is the file of a learner, which is not replaced; give another name."
                )
        elif target.exists():
            raise OutputError(f"{named} is a device or a pipe; give the name of a regular file.")
        _check_way(named.parent)  # before links are followed
        check_folder(target.parent)
    return target


def _is_learner(path: Path) -> bool:
    """Return whether a file is the whole file of a learner."""
    try:
        with zipfile.ZipFile(path) as archive:
            return LEARNER in archive.namelist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError, RuntimeError):
        return False


def check_folder(folder: str | Path) -> Path:
    """Create a folder, and check that files can be written in it; else an `OutputError`."""
    folder = make_folder(checked_path("The folder", folder))
    with _with_path(folder), tempfile.TemporaryFile(dir=folder):
        pass
    return folder


def make_folder(folder: Path) -> Path:
    """Create a folder, where neither a file nor a link to nothing stands; else an `OutputError`."""
    with _with_path(folder):
        _check_way(folder)
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def _check_way(folder: Path) -> None:
    """Refuse a folder where a file, or a link to what is not there, stands in its place or way."""
    for place in (folder, *folder.parents):
        if place.is_dir():
            return
        if place.exists():
            raise OutputError(f"{folder} cannot be written: {place} is a file; give another place.")
        if place.is_symlink():
            target = place.readlink()
            raise OutputError(
                f"{folder} cannot be written: {place} is a link to {target}, which is not there; "
                "create that folder, or give another place."
            )


@contextlib.contextmanager
def draft_of(
    path: str | Path, *, inputs: Iterable[str | Path] = (), expected: bool = False
) -> Iterator[Path]:
    """Yield the path of an empty draft, which gets the name `path` when the block ends well.

    Other parameters and errors are those of `check_output`; a full disk is an `OutputError` too.
    A file that is replaced is named in the log (INFO), unless it is `expected` to be there. The
    command line shows that.
    """
    named = checked_path("The output", path)
    target = check_output(named, inputs=inputs, expected=expected)
    # Of a long name a part: file systems allow 255 bytes, of up to four a character.
    draft = target.parent / f".{target.name[:50]}.{os.getpid()}-{secrets.token_hex(4)}.part"
    with _with_path(named):
        try:
            draft.touch(exist_ok=False)  # with the permissions of any new file
            yield draft
            replaced = target.exists() and not expected
            replace_whole(draft, target)
            if replaced:
                log.info("%s was there, and is replaced", named)
        finally:
            with contextlib.suppress(OSError):
                draft.unlink(missing_ok=True)


def hold(file: BinaryIO) -> bool:
    """Hold an open file for this process until it is closed; return whether nobody else does.

    The system lets go of it when the process ends, however it ends.
    """
    if sys.platform == "win32":
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


@contextlib.contextmanager
def alone_in(folder: str | Path) -> Iterator[None]:
    """Let no other process that asks for it too be in a folder meanwhile."""
    folder = check_folder(folder)
    if sys.platform == "win32":
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def write_whole(
    path: str | Path,
    content: bytes | str,
    *,
    inputs: Iterable[str | Path] = (),
    expected: bool = False,
) -> None:
    r"""Write a file whole or not at all; text as UTF-8. Parameters and errors as of `draft_of`.

    Names of files need not be UTF-8: their other bytes stand in a text as \udcff.
    """
    data = content.encode(errors="backslashreplace") if isinstance(content, str) else content
    with draft_of(path, inputs=inputs, expected=expected) as draft:
        draft.write_bytes(data)


def keep_folder(folder: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a folder, which gets its name when it is whole; the first to end keeps it.

    Errors are those of `check_folder`.
    """
    check_folder(folder.parent)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f"{folder.name}.") as unfinished:
        draft = Path(unfinished, folder.name)
        write(draft)
        if not folder.is_dir():  # another process may have been quicker
            draft.replace(folder)


def replace_whole(draft: Path, target: Path) -> None:
    """Sync a draft to the disk and rename it; an existing target keeps its permissions."""
    with contextlib.suppress(FileNotFoundError):
        draft.chmod(stat.S_IMODE(target.stat().st_mode))
    _sync(draft)
    draft.replace(target)
    with contextlib.suppress(OSError):  # not every file system syncs folders
        _sync(target.parent)


def name_new(draft: Path, target: Path) -> None:
    """Sync a draft to the disk and rename it; a `FileExistsError` where the name is taken.

    The draft then stays. No file is lost, however late another process writes the same name.
    """
    _sync(draft)
    try:
        os.link(draft, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links: an empty file reserves the name
        target.open("xb").close()
        draft.replace(target)
    else:
        draft.unlink()
    with contextlib.suppress(OSError):  # not every file system syncs folders
        _sync(target.parent)


@contextlib.contextmanager
def _with_path(path: Path) -> Iterator[None]:
    """Raise the system's errors as an `OutputError` that names the file."""
    try:
        yield
    except OSError as fault:
        why = fault.strerror or str(fault)
        raise OutputError(f"{path} cannot be written: {why}; give another place.") from fault


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
