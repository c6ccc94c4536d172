"""Regenerate what README.md and the site show of real runs: the demo's text and measured tables.

`python benchmarks/readme.py` runs the commands and writes their results between HTML comments of
the pages (`PAGES`); a run that is there already under logs/ is not computed again. `--only` writes
one of the blocks. Two are written only when they are named: `paper-classifiers`, which needs the
recordings and, once, some minutes for the support vector machines, and `online`, a quarter of an
hour of two cores. The block `summary` shows the rows that are kept from `results`. `--check` writes
nothing: it compares the demo's text with what the command prints now, and exits with 1 if they
differ.
"""

import argparse
import difflib
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from readme_picture import write_pictures
from readme_tables import (
    BELIEFS,
    BELIEVED,
    ONLINE,
    PAPER_RUN,
    RUNS,
    beliefs_table,
    finding,
    online_block,
    summary_block,
    table_of,
)

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
MEASURED = ROOT / "benchmarks" / "readme.json"  # rows behind the tables, by command
DEMO = "meal-bayes demo"
PLAIN = {"COLUMNS": "90", "NO_COLOR": "1", "TERM": "dumb", "PYTHONIOENCODING": "utf-8"}
PAGES = {  # where each block stands
    "demo": README,
    "summary": README,
    "finding": ROOT / "docs" / "results" / "index.md",
    "results": ROOT / "docs" / "results" / "index.md",
    "paper-classifiers": ROOT / "docs" / "results" / "index.md",
    "beliefs": ROOT / "docs" / "results" / "beliefs.md",
    "online": ROOT / "docs" / "results" / "online.md",
}
# What is written by default, in this order: `summary` and `finding` are made of `results`' rows.
MEASURED_BLOCKS = ("demo", "results", "summary", "finding", "beliefs")


def main() -> int:
    """Write the blocks, or check the demo's."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="compare the demo's text only")
    parser.add_argument("--only", choices=PAGES, help="write one of the blocks")
    options = parser.parse_args()
    if options.check:
        return check_demo()
    for name in [options.only] if options.only else MEASURED_BLOCKS:
        new = content(name)
        page = PAGES[name]
        text = page.read_text(encoding="utf-8")
        page.write_text(replaced(text, name, new), encoding="utf-8")
    return 0


def content(name: str) -> str:
    """Make what belongs into a block."""
    if name == "demo":
        return demo_block()
    if name == "summary":
        write_pictures(measured())
        return summary_block(measured())
    if name == "finding":
        return finding(measured())
    if name == "online":
        rows = json.loads(run(ONLINE))["summary"]
        keep({ONLINE: rows})
        return online_block(rows)
    if name == "beliefs":
        rows = json.loads(run(BELIEFS))["rows"]
        rows = [row for row in rows if row["observation_model"] in BELIEVED]
        keep({BELIEFS: rows})
        return beliefs_table(rows)
    runs = RUNS if name == "results" else (PAPER_RUN,)
    tables = {entry.command: json.loads(run(entry.command))["rows"] for entry in runs}
    keep(tables)
    return "\n\n".join(table_of(entry, tables[entry.command]) for entry in runs)


def keep(tables: Mapping[str, list[dict[str, Any]]]) -> None:
    """Write down the rows of some tables, beside those of the others that the README shows."""
    shown = {*(entry.command for entry in (*RUNS, PAPER_RUN)), BELIEFS, ONLINE}
    others = {command: rows for command, rows in measured().items() if command in shown}
    MEASURED.write_text(json.dumps({**others, **tables}, indent=1) + "\n", encoding="utf-8")


def measured() -> dict[str, list[dict[str, Any]]]:
    """Read the rows behind the tables, which a test compares with the README."""
    if not MEASURED.is_file():
        return {}
    return dict(json.loads(MEASURED.read_text(encoding="utf-8")))


def check_demo() -> int:
    """Compare the README's cast with what the demo prints now."""
    shown = block(README.read_text(encoding="utf-8"), "demo").splitlines()
    now = demo_block().splitlines()
    for line in difflib.unified_diff(shown, now, "README.md", DEMO, lineterm=""):
        print(line)
    if shown != now:
        print("README.md shows another demo; mend it with: python benchmarks/readme.py --only demo")
        return 1
    print("README.md shows the demo as it is")
    return 0


def block(text: str, name: str) -> str:
    """Find what stands between `<!-- name -->` and `<!-- /name -->`."""
    blocks = re.findall(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->", text, re.DOTALL)
    if len(blocks) != 1:
        raise SystemExit(f"The page has {len(blocks)} blocks <!-- {name} -->; expected one.")
    return str(blocks[0])


def replaced(text: str, name: str, new: str) -> str:
    """Put new content between the two comments."""
    old = f"<!-- {name} -->\n{block(text, name)}<!-- /{name} -->"
    return text.replace(old, f"<!-- {name} -->\n{new.rstrip()}\n<!-- /{name} -->")


def run(command: str) -> str:
    """Run a command of this package, or a script, in the project's folder; what it prints."""
    name, *arguments = shlex.split(command)
    if name not in ("meal-bayes", "python"):
        raise ValueError(f"not a command of this package: {command}")
    print(f"$ {command}", file=sys.stderr, flush=True)
    # -P: the installed package, not the one in the working directory; scripts import their siblings
    program = ["-P", "-m", "meal_bayes"] if name == "meal-bayes" else []
    done = subprocess.run(
        [sys.executable, *program, *arguments],
        cwd=ROOT,
        env={**os.environ, **PLAIN},
        stdout=subprocess.PIPE,
        encoding="utf-8",
        check=True,
    )
    return done.stdout


def demo_block() -> str:
    """Make a code block of the demo's question, a decision to go on, one to stop, and its end."""
    parts = [part.rstrip() for part in run(DEMO).split("\n\n")]
    question = next(part for part in parts if part.startswith("  question"))
    going_on = next(part for part in parts if part.startswith("2  "))
    end = next(place for place, part in enumerate(parts) if part.startswith("  answer"))
    excerpt = (question, going_on, "\n\n".join(parts[end - 1 : end + 1]))
    return "\n".join(("```text", "\n...\n".join(excerpt), "```\n"))


if __name__ == "__main__":
    raise SystemExit(main())
