"""The logs of a run, read as far as they can be: what a viewer or a report wants."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from meal_bayes.agents.trial import Trial
from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log.reader import Scan, read_header
from meal_bayes.trial_log.schema import ACTIVE, SUFFIX


def log_files(path: str | Path) -> list[Path]:
    """Find the logs of a run: the file itself, or all of a folder in order of their names.

    A file that is still being written is among them, under the name it has.

    Raises
    ------
    LogError : there is no such file or folder, or it holds no log.
    """
    path = Path(path)
    if path.is_dir():
        endings = (SUFFIX, SUFFIX + ACTIVE)
        found = sorted(file for file in path.rglob("*") if file.name.endswith(endings))
        if not found:
            raise LogError(f"{path} holds no log (*{SUFFIX}).")
        return [file for file in found if file.is_file()]
    active = path.with_name(path.name + ACTIVE)
    for one in (path, active):
        if one.is_file():
            return [one]
    raise LogError(f"There is no log {path}; expected a {SUFFIX} file, or a folder of them.")


class Logs:
    """One or more logs, damaged ones included: faults are noted, whole trials are given.

    Parameters
    ----------
    paths : files, or folders of them.

    Raises
    ------
    LogError : a path that is not there, or a folder without logs.
    """

    def __init__(self, *paths: str | Path) -> None:
        self.files: Sequence[Path] = [file for path in paths for file in log_files(path)]
        self.problems: list[str] = []  # grows while trials are read

    @property
    def header(self) -> dict[str, object]:
        """What the run was, as the first file with a header says; empty where none has one."""
        return next((header for header in map(_header, self.files) if header), {})

    def parts(self) -> Iterator[tuple[dict[str, object], Iterator[Trial]]]:
        """Yield for each file its header and its trials.

        Raises
        ------
        LogVersionError : a file of another format version.
        """
        for file in self.files:
            yield _header(file), self._read(file)

    def trials(self) -> Iterator[Trial]:
        """Yield the trials of all files.

        Raises
        ------
        LogCorruptError : there is not one trial that can be read, in files that are damaged.
        LogError : there is no trial in them, though they are sound.
        LogVersionError : a file of another format version.
        """
        found = False
        for _, trials in self.parts():
            for trial in trials:
                found = True
                yield trial
        if not found:
            self.complain_of_nothing()

    def complain_of_nothing(self) -> None:
        """Raise the error of logs without a trial."""
        if self.problems:
            raise LogCorruptError(f"Not one trial can be read: {self.problems[0]}.")
        raise LogError(f"{self.files[0]} holds no trial yet.")

    def _read(self, file: Path) -> Iterator[Trial]:
        scan = Scan(file, tolerant=True)
        yield from scan.trials()
        if file.name.endswith(ACTIVE):
            why = f" ({scan.problems[0]})" if scan.problems else ""
            self.problems.append(f"{file} was not finished by its writer{why}")
        else:
            self.problems += [f"{file}: {problem}" for problem in scan.problems]


def _header(file: Path) -> dict[str, object]:
    try:
        return read_header(file)
    except LogCorruptError:
        return {}
