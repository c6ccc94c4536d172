"""Whose a file is: of this format, of another version of it, or no log of ours."""

from collections.abc import Sequence
from pathlib import Path

from meal_bayes.errors import LogCorruptError, LogVersionError
from meal_bayes.trial_log import schema
from meal_bayes.untrusted import read_json

_WITH_ITS_CODE = "run its configuration again, or read it with the version that wrote it"
_FORMS = {profile: form for form, profile in schema.PROFILES.items()}


class ForeignFileError(LogCorruptError):
    """A file that is no log of ours, whole or torn; its text says what it is."""

    def of(self, path: Path) -> str:
        """Return what is said of the file at a path."""
        return f"{path} is no log of meal_bayes: {self}; give a {schema.SUFFIX} file that it wrote"


def check_size(path: Path, size: int) -> None:
    """Refuse a file without a byte, but for a draft: its writer has not come to its first one."""
    if size == 0 and not path.name.endswith(schema.ACTIVE):
        raise ForeignFileError("it is empty")


def form_of(profile: str) -> str | None:
    """Return the form that a profile in an MCAP header names; None of a file that has no profile.

    Raises
    ------
    ForeignFileError
        It is another program's.
    LogVersionError
        It is a form of another version.
    """
    if not profile:  # `mcap merge` leaves it out
        return None
    if profile in _FORMS:
        return _FORMS[profile]
    if profile.startswith(f"{schema.PROFILES[schema.FULL]}/"):
        raise LogVersionError(
            f"written as {profile!r:.60}, which this meal_bayes does not know; {_WITH_ITS_CODE}"
        )
    raise ForeignFileError(f"it is another program's MCAP file, of profile {profile!r:.40}")


def check_topics(topics: Sequence[str]) -> None:
    """Refuse a file without a profile that declares these topics, and none of a run."""
    if topics and schema.RUN not in topics:
        raise ForeignFileError(f"it is another program's MCAP file, of topic {topics[0]!r:.40}")


def run_header(data: bytes) -> dict[str, object]:
    """Read the run message of a file of this format's version."""
    message = schema.RunMessage.FromString(data)
    header = read_json(message.header)
    if not isinstance(header, dict):
        raise LogCorruptError("the header is no table of names and values")
    if message.format_version != schema.FORMAT_VERSION:
        raise LogVersionError(
            f"written in log format {message.format_version}, this meal_bayes reads format "
            f"{schema.FORMAT_VERSION}; {_WITH_ITS_CODE}"
        )
    return header
