"""What tests of reports share."""

import html
import re
from collections.abc import Callable

import pytest


@pytest.fixture(scope="session")
def cells() -> Callable[[str], list[list[str]]]:
    """Return a function that reads the rows of all tables of a page as text."""

    def read(page: str) -> list[list[str]]:
        rows = re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)
        plain = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.DOTALL) for row in rows]
        return [[html.unescape(re.sub(r"<[^>]+>", "", cell)) for cell in row] for row in plain]

    return read
