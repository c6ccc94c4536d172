"""Regenerate what README.md and the site show of real runs: the demo's text and measured tables.

`python benchmarks/readme.py` runs the commands and writes their results between HTML comments of
the pages (`PAGES`); a run that is there already under logs/ is not computed again. `--only` writes
one of the blocks, and those of the same rows: `summary` and `finding` show the rows of `results`.
Two are written only when they are named: `paper-classifiers`, which needs the recordings and, once,
some minutes for the support vector machines, and `online`, a quarter of an hour of two cores.

Each block of measured numbers carries the digest of the code that made it (`made_by.py`). `--check`
writes nothing. It fails where a block is not what its kept rows say, and where the demo prints
another text now. It lists the blocks that other code made than this, each with the command that
makes it again; `--release` fails where there are any.
"""

import argparse
import difflib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

from made_by import made_by
from readme_picture import write_pictures
from readme_tables import (
    ANSWERS,
    BELIEFS,
    BELIEVED,
    ONLINE,
    OURS,
    PAPER_RUN,
    RUNS,
    answers_table,
    beliefs_table,
    finding,
    online_block,
    summary_block,
    table_of,
)

from meal_bayes.evaluation import comparisons
from meal_bayes.trial_log import read_outcomes
from meal_bayes.trials import TrialOutcomes

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
    "answers": ROOT / "docs" / "results" / "beliefs.md",
    "online": ROOT / "docs" / "results" / "online.md",
}
MEASURED_BLOCKS = ("demo", "results", "beliefs", "answers")  # are written by default
COMMANDS = {  # whose rows a block shows
    **dict.fromkeys(("results", "summary", "finding"), tuple(entry.command for entry in RUNS)),
    "paper-classifiers": (PAPER_RUN.command,),
    "beliefs": (BELIEFS,),
    "answers": (ANSWERS,),
    "online": (ONLINE,),
}
CODE = "code"  # in the file of rows: the digest that made each command's


def main() -> int:
    """Write the blocks, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="compare; list blocks of other code")
    parser.add_argument("--release", action="store_true", help="fail on them, too")
    parser.add_argument("--only", choices=PAGES, help="write one of the blocks")
    options = parser.parse_args()
    if options.check or options.release:
        return check(release=options.release)
    for name in [options.only] if options.only else MEASURED_BLOCKS:
        compute(name)
        for block_name in blocks_of_same_rows(name):
            page = PAGES[block_name]
            text = page.read_text(encoding="utf-8")
            page.write_text(replaced(text, block_name, shown(block_name)), encoding="utf-8")
    return 0


def blocks_of_same_rows(name: str) -> list[str]:
    """Return a block, and the others that show the rows of the same commands."""
    same = [other for other in COMMANDS if name in COMMANDS and COMMANDS[other] == COMMANDS[name]]
    return same or [name]


def compute(name: str) -> None:
    """Run the commands of a block, keep their rows, and draw the picture of results."""
    if name in ("summary", "finding"):  # of rows that are kept
        return
    for command in COMMANDS.get(name, ()):
        printed = json.loads(run(command))
        rows = printed["summary" if command == ONLINE else "rows"]
        if command == BELIEFS:
            rows = [row for row in rows if row["observation_model"] in BELIEVED]
        if "paired" in printed:
            rows = with_paired(rows, Path(printed["log"]))
        keep(command, rows)
    if name == "results":
        write_pictures(measured())


def with_paired(rows: list[dict[str, Any]], logs: Path) -> list[dict[str, Any]]:
    """Add by how much our agent earns more than each of the others on the same questions."""
    if OURS not in (row["agent"] for row in rows):
        return rows
    outcomes = TrialOutcomes.join([read_outcomes(path) for path in sorted(logs.rglob("*.mcap"))])
    more = {row.agent: row for row in comparisons(outcomes, reference=OURS)}
    for row in rows:
        if row["agent"] in more:
            less = more[row["agent"]]
            row["ours_more"] = -less.difference
            row["ours_more_low"] = -less.high
            row["ours_more_high"] = -less.low
    return rows


def shown(name: str) -> str:
    """Return what belongs into a block, by the rows that are kept."""
    if name == "demo":
        return demo_block()
    rows = measured()
    if name in ("summary", "finding"):
        text = (summary_block if name == "summary" else finding)(rows)
    elif name == "online":
        text = online_block(rows[ONLINE])
    elif name == "beliefs":
        text = beliefs_table(rows[BELIEFS])
    elif name == "answers":
        text = answers_table(rows[ANSWERS])
    else:
        runs = RUNS if name == "results" else (PAPER_RUN,)
        text = "\n\n".join(table_of(entry, rows[entry.command]) for entry in runs)
    made = " ".join(dict.fromkeys(digests(name)))
    if PAGES[name] == README:  # where readers begin
        return f"{text} <!-- made by code {made} -->"
    return f"{text}\n\nMade by code `{made}`."


def digests(name: str) -> list[str]:
    """Return the digests of the code that made the rows of a block."""
    code = kept().get(CODE, {})
    return [code.get(command, "unknown") for command in COMMANDS[name]]


def is_old(name: str) -> bool:
    """Return whether other code than this made a block."""
    return digests(name) != [made_by(command) for command in COMMANDS[name]]


def check(*, release: bool) -> int:
    """Compare the blocks with their rows, the demo with what it prints, and codes with this one."""
    faults = check_demo()
    for name, page in PAGES.items():
        place = f"{page.relative_to(ROOT)}, block {name}"
        if name == "demo":
            continue
        if block(page.read_text(encoding="utf-8"), name).strip() != shown(name).strip():
            print(f"{place}: not what {MEASURED.relative_to(ROOT)} says; write it anew")
            faults += 1
        if is_old(name):
            first = blocks_of_same_rows(name)[0]
            print(f"{place}: other code made it; python benchmarks/readme.py --only {first}")
            faults += release
    return int(faults > 0)


def keep(command: str, rows: list[dict[str, Any]]) -> None:
    """Write down the rows of a command and the digest of the code that made them."""
    commands = {command for of_block in COMMANDS.values() for command in of_block}
    everything = {**kept(), command: rows}
    code = {**everything.pop(CODE, {}), command: made_by(command)}
    entries = {name: entry for name, entry in everything.items() if name in commands}
    entries[CODE] = {name: digest for name, digest in code.items() if name in commands}
    MEASURED.write_text(json.dumps(entries, indent=1) + "\n", encoding="utf-8")


def kept() -> dict[str, Any]:
    """Read the rows of all commands, and the digests of what made them."""
    if not MEASURED.is_file():
        return {}
    return dict(json.loads(MEASURED.read_text(encoding="utf-8")))


def measured() -> dict[str, list[dict[str, Any]]]:
    """Return the rows behind the tables, by command."""
    return {command: rows for command, rows in kept().items() if command != CODE}


def check_demo() -> int:
    """Compare the README's cast with what the demo prints now."""
    in_page = block(README.read_text(encoding="utf-8"), "demo").splitlines()
    now = demo_block().splitlines()
    for line in difflib.unified_diff(in_page, now, "README.md", DEMO, lineterm=""):
        print(line)
    if in_page != now:
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
