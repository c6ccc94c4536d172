"""Check the types of what pages show: the Python of each, as one module, and the examples.

python .ci/type_pages.py

A reader's editor does the same once the code is copied. Bodies of functions without annotations are
checked too, as most of a user's are.
"""

import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
BLOCK = re.compile(r"^```python(?: title=\"[^\"]+\")?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SETTINGS = """
[mypy]
check_untyped_defs = True
ignore_missing_imports = True
[mypy-meal_bayes.*]
follow_imports = silent
"""


def module_of(page: Path) -> str:
    """Return the Python of a page, each line where the page has it, so that faults name it."""
    lines = [""] * len(page.read_text(encoding="utf-8").splitlines())
    text = page.read_text(encoding="utf-8")
    for match in BLOCK.finditer(text):
        first = text.count("\n", 0, match.start(1))
        content = match[1].splitlines()
        if not match[1].startswith("--8<--"):  # a file that the page includes
            lines[first : first + len(content)] = content
    return "\n".join(lines) + "\n"


def main() -> int:
    """Write the modules and let mypy read them; return its exit code."""
    with TemporaryDirectory() as folder:
        modules = list(map(str, sorted((ROOT / "examples").glob("*.py"))))
        for page in PAGES:
            text = module_of(page)
            if text.strip():
                name = "_".join(page.relative_to(ROOT).with_suffix("").parts).replace("-", "_")
                path = Path(folder, f"{name}.py")
                path.write_text(text, encoding="utf-8")
                modules.append(str(path))
        settings = Path(folder, "mypy.ini")
        settings.write_text(SETTINGS, encoding="utf-8")
        command = [sys.executable, "-m", "mypy", "--config-file", str(settings), *modules]
        return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
