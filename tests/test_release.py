"""What says which version this is, says the same."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HEADING = re.compile(r"^## (?P<version>\S+) - (?P<day>\d{4}-\d\d-\d\d)$", re.MULTILINE)
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
CITATION = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]


def cited(key):
    """Return the value of a key of the citation itself, which its references have indented."""
    (value,) = re.findall(rf"^{key}: (\S+)$", CITATION, re.MULTILINE)
    return value


def test_the_citation_names_the_version_of_the_package():
    assert cited("version") == VERSION


def test_the_changelog_begins_with_this_version_and_its_day():
    latest = HEADING.search(CHANGELOG)
    assert latest["version"] == VERSION
    assert latest["day"] == cited("date-released")


def test_only_changes_to_come_stand_above_it():
    headings = re.findall(r"^## (.+)$", CHANGELOG, re.MULTILINE)
    versions = [heading for heading in headings if heading != "Unreleased"]
    assert headings in (versions, ["Unreleased", *versions])
    days = [match["day"] for match in HEADING.finditer(CHANGELOG)]
    assert len(days) == len(versions)
    assert days == sorted(days, reverse=True)
