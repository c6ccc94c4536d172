"""Names of log files: whole, being written, recovered.

A log that is being written is a draft of a unique name, such as `run.w4711-a3f9c2.mcap.active` of
`run.mcap`, so that no two processes ever write into one file. Drafts of earlier versions were
called `run.mcap.active`.
"""

import os
import re
import secrets
from pathlib import Path

from meal_bayes.errors import LogError
from meal_bayes.trial_log.schema import ACTIVE, SUFFIX

TIMING = ".timing.csv"
_RECOVERED = ".recovered"
_DRAFT = r"\.w\d+-[0-9a-f]{6}"
_ENDINGS = re.compile(rf"({_DRAFT})?({re.escape(_RECOVERED)})?$")


def new_draft(path: Path) -> Path:
    """Choose a name for a log that is to become `path`."""
    return path.with_name(f"{path.stem}.w{os.getpid()}-{secrets.token_hex(3)}{SUFFIX}{ACTIVE}")


def timing_of(path: Path) -> Path:
    """Name the table of seconds beside a log or a draft."""
    return path.with_name(_bare(path.name) + TIMING)


def recovered_name(path: Path) -> Path:
    """Name the file that a torn log or draft is recovered into."""
    return path.with_name(f"{stem_of(path)}{_RECOVERED}{SUFFIX}")


def stem_of(path: Path) -> str:
    """Return what a log, its drafts and its recovered file have in common.

    >>> stem_of(Path("run.mcap")), stem_of(Path("run.w4711-a3f9c2.mcap.active"))
    ('run', 'run')
    """
    return _ENDINGS.sub("", _bare(path.name), count=1)


def is_log(path: Path) -> bool:
    """Return whether a name is that of a log or a draft."""
    return path.name.endswith((SUFFIX, SUFFIX + ACTIVE))


def is_recovered(path: Path) -> bool:
    """Return whether a name is that of a recovered file."""
    return path.name.endswith(_RECOVERED + SUFFIX)


def drafts_of(path: Path) -> list[Path]:
    """Find the drafts of a log, the newest first."""
    name = re.compile(rf"{re.escape(path.stem)}({_DRAFT})?{re.escape(SUFFIX + ACTIVE)}")
    if not path.parent.is_dir():
        return []
    found = [file for file in path.parent.iterdir() if name.fullmatch(file.name)]
    return sorted(found, key=_age)


def remove_drafts(path: Path) -> None:
    """Remove the drafts of a log; no process may still be writing them."""
    for draft in drafts_of(path):
        timing = timing_of(draft)
        draft.unlink(missing_ok=True)
        if timing != timing_of(path):
            timing.unlink(missing_ok=True)


def _bare(name: str) -> str:
    return name.removesuffix(ACTIVE).removesuffix(SUFFIX)


def _age(path: Path) -> float:
    try:
        return -path.stat().st_mtime
    except FileNotFoundError:  # it has got its name meanwhile
        return 0.0


def log_files(path: str | Path) -> list[Path]:
    """Find the logs of a run: the file itself, or all of a folder in order of their names.

    A file that is still being written is among them, under the name it has. A recovered file is
    left out where what it was recovered from is there.

    Raises
    ------
    LogError
        There is no such file or folder, or it holds no log.
    """
    path = Path(path)
    if path.is_dir():
        found = sorted(file for file in path.rglob("*") if is_log(file) and file.is_file())
        if not found:
            raise LogError(f"{path} holds no log (*{SUFFIX}).")
        sources = {file.with_name(stem_of(file)) for file in found if not is_recovered(file)}
        return [
            file
            for file in found
            if not (is_recovered(file) and file.with_name(stem_of(file)) in sources)
        ]
    for one in (path, *drafts_of(path)):
        if one.is_file():
            return [one]
    raise LogError(f"There is no log {path}; expected a {SUFFIX} file, or a folder of them.")
