"""One file that holds a study: its logs, what belongs to them, and a list of what they are.

Equal inputs give equal bytes, so that two people compare their archives by one checksum.
"""

import json
import logging
import shutil
import zipfile
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from platform import python_version
from typing import Any

from meal_bayes.digests import checksum_of
from meal_bayes.display import listed
from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.files import checked_path, command_line, draft_of
from meal_bayes.trial_log.names import all_logs
from meal_bayes.trial_log.reader import check_log
from meal_bayes.trial_log.schema import ACTIVE, SUFFIX
from meal_bayes.version import package_version

MANIFEST = "MANIFEST.json"
_WRITTEN = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip file knows
_PERMISSIONS = 0o644 << 16

log = logging.getLogger("meal_bayes.trial_log")


def write_archive(folder: str | Path, out: str | Path, others: Sequence[str | Path] = ()) -> Path:
    """Check the logs of a study, and pack them with a manifest.

    The manifest has the SHA-256 of every file, the trials of each log, and the versions of Python,
    of this package and of the libraries that are installed.

    Parameters
    ----------
    folder : str | Path
        With the logs; everything in it is packed but for logs that are not over, which a warning
        names.
    out : str | Path
        The archive, a .zip.
    others : Sequence[str | Path]
        Files and folders that belong to the study, such as a domain and its recordings.

    Returns
    -------
    Path
        Of the archive.

    Raises
    ------
    LogError
        A folder without logs that are over, a log that is damaged, what does not exist, or two
        files that would have one name.
    """
    folder = checked_path("The folder", folder)
    if not folder.is_dir():
        raise LogError(f"{folder} is no folder; give that of a run, with its logs.")
    _check_over(all_logs(folder))
    files = dict[str, Path]()
    for source_path in (folder, *map(Path, others)):
        for name, path in _files_of(source_path):
            if name in files and not path.samefile(files[name]):
                raise LogError(f"{files[name]} and {path} would both be {name}; rename one.")
            files[name] = path
    if MANIFEST in files:
        raise LogError(f"{files[MANIFEST]} has the name of the archive's own list; rename it.")
    trials = {name: _trials_of(path) for name, path in files.items() if path.suffix == SUFFIX}
    with draft_of(out, inputs=list(files.values())) as draft:
        manifest = _manifest(files, trials)
        with zipfile.ZipFile(draft, "w") as archive:
            archive.writestr(_entry(MANIFEST), json.dumps(manifest, indent=1, ensure_ascii=False))
            for name, path in sorted(files.items()):
                with (
                    path.open("rb") as source,
                    archive.open(_entry(name), "w", force_zip64=True) as target,
                ):
                    shutil.copyfileobj(source, target)
    return Path(out)


def _check_over(logs: Sequence[Path]) -> None:
    """Warn of logs that are not over, and so are left aside; refuse where none is."""
    drafts = [str(file) for file in logs if file.name.endswith(ACTIVE)]
    if not drafts:
        return
    text = (
        f"{listed(drafts, 3)}: not over. A trial that is broken off goes on by Learner.resume(), a "
        "search by Learner.resume_find(), a run by its own command."
    )
    if len(drafts) == len(logs):
        raise LogError(f"There is no log to pack: {text}")
    log.warning("Left out of the archive: %s", text)


def _files_of(root: Path) -> Iterator[tuple[str, Path]]:
    """Yield the name in the archive and the path of each file of a place."""
    if root.is_file():
        yield root.name, root
    elif root.is_dir():
        for path in sorted(root.rglob("*")):
            if path.is_file() and not path.name.endswith(ACTIVE):
                yield (Path(root.resolve().name) / path.relative_to(root)).as_posix(), path
    else:
        raise LogError(f"There is no {root}; name a file or a folder.")


def _trials_of(path: Path) -> int:
    info = check_log(path)
    if not info.ours:
        raise LogCorruptError(
            f"{path} is no log of meal_bayes: {info.problems[0]}; take it out of the folder."
        )
    if not info.whole:
        raise LogCorruptError(
            f"{path} is damaged: {info.problems[0]}; take it out of the folder, and save its whole "
            f"trials with: {command_line('meal-bayes log recover', path)}"
        )
    return info.trials


def _manifest(files: dict[str, Path], trials: dict[str, int]) -> dict[str, Any]:
    installed = {
        distribution.name: distribution.version for distribution in metadata.distributions()
    }
    return {
        "made_by": f"meal-bayes {package_version()}",
        "python": python_version(),
        "files": {name: checksum_of(path) for name, path in sorted(files.items())},
        "trials": dict(sorted(trials.items())),
        "installed": dict(sorted(installed.items())),
    }


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, _WRITTEN)
    entry.external_attr = _PERMISSIONS
    return entry
