"""Make what README.md and the site show of real runs: the demo's text and the measured tables.

    python benchmarks/readme.py                 # all blocks; goes on where it was interrupted
    python benchmarks/readme.py --only ispy32-1 # one measurement or block, and what shows its rows
    python benchmarks/readme.py --plan          # what would run, and about how long it takes
    python benchmarks/readme.py --write         # all blocks again from the rows that are kept
    python benchmarks/readme.py --check         # compare; with --release fail on old blocks, too

The commands stand in `readme_tables.py`. What they print is kept in `readme.json`, with the digest
of the code that made it (`paper_repro/made_by.py`), and shown between HTML comments of the pages.
What this code made already is not measured again, unless it is named or `--again` is given. The
paper's classifiers and online learning need the recordings.

`--check` writes nothing. It fails where a block is not what its kept rows say, and where the demo
prints another text now. It lists the blocks that other code made than this, each with the command
that makes it again; `--release` fails where there are any.
"""

import argparse
import difflib
import json
import os
import re
import resource
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from measuring import ROOT
from readme_picture import write_pictures
from readme_tables import (
    ANSWERS,
    BELIEFS,
    BELIEVED,
    DECLINING,
    LOSSES,
    MEASUREMENTS,
    ONLINE,
    OURS,
    PAPER_RUN,
    RUNS,
    Rows,
    Tables,
    answers_table,
    beliefs_table,
    finding,
    losses_block,
    online_table,
    results_tables,
    run_table,
    summary,
)

from meal_bayes.evaluation import Interval, difference, estimate_mean
from meal_bayes.trial_log import read_outcomes
from meal_bayes.trials import TrialOutcomes
from paper_repro.made_by import made_by

README = ROOT / "README.md"
RESULTS = ROOT / "docs" / "results"
MEASURED = ROOT / "benchmarks" / "readme.json"
DEMO = "meal-bayes demo"
PLAIN = {"COLUMNS": "90", "NO_COLOR": "1", "TERM": "dumb", "PYTHONIOENCODING": "utf-8"}


class Block(NamedTuple):
    """What stands between two comments of a page: which rows, and how they are shown."""

    page: Path
    rests_on: tuple[str, ...]  # measurements
    text: Callable[[Tables], str]


BLOCKS = {
    "summary": Block(README, tuple(RUNS), summary),
    "losses": Block(README, (LOSSES,), lambda tables: losses_block(tables[LOSSES])),
    "finding": Block(RESULTS / "index.md", tuple(RUNS), finding),
    "results": Block(RESULTS / "index.md", tuple(RUNS), results_tables),
    "paper-classifiers": Block(
        RESULTS / "index.md",
        (PAPER_RUN,),
        lambda tables: run_table(MEASUREMENTS[PAPER_RUN], tables[PAPER_RUN]),
    ),
    "beliefs": Block(
        RESULTS / "beliefs.md", (BELIEFS,), lambda tables: beliefs_table(tables[BELIEFS])
    ),
    "answers": Block(
        RESULTS / "beliefs.md", (ANSWERS,), lambda tables: answers_table(tables[ANSWERS])
    ),
    "online": Block(RESULTS / "online.md", (ONLINE,), lambda tables: online_table(tables[ONLINE])),
}


def main() -> int:
    """Write the blocks, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="compare; list blocks of other code")
    parser.add_argument("--release", action="store_true", help="fail on them, too")
    parser.add_argument("--plan", action="store_true", help="say what would run, and how long")
    parser.add_argument("--write", action="store_true", help="write blocks from kept rows alone")
    parser.add_argument("--again", action="store_true", help="measure what this code made, too")
    parser.add_argument(
        "--only",
        action="append",
        choices=["demo", *BLOCKS, *MEASUREMENTS],
        help="a block or a measurement; may be repeated",
    )
    options = parser.parse_args()
    if options.check or options.release:
        return check(release=options.release)
    named = options.only or ["demo", *MEASUREMENTS]
    todo = [] if options.write else measurements_of(named, again=options.again or options.only)
    if options.plan:
        say_plan(todo)
        return 0
    if "demo" in named and not options.write:
        write_block(README, "demo", demo_block())
    for number, name in enumerate(todo):
        say_plan(todo[number:])
        keep(name, *measure(name))
        write_blocks(resting_on(name))
    if options.write:
        write_blocks(BLOCKS)
    return 0


def measurements_of(names: Iterable[str], *, again: object) -> list[str]:
    """Return the measurements that are named, or of which blocks are, and that are to be made."""
    wanted: set[str] = set()
    for name in names:
        wanted.update(BLOCKS[name].rests_on if name in BLOCKS else (name,))
    return [name for name in MEASUREMENTS if name in wanted and (again or is_old(name))]


def say_plan(names: list[str]) -> None:
    """Say what is still to be measured, and about how many minutes of CPU each takes."""
    minutes = {name: minutes_of(name) for name in names}
    told = ", ".join(f"{name} {number:.0f}" for name, number in minutes.items())
    total = f"{sum(minutes.values()):.0f}"
    print(f"{len(names)} to measure, {total} minutes of CPU: {told}", file=sys.stderr, flush=True)


def minutes_of(name: str) -> float:
    """Return the minutes of CPU that a measurement took last, or a guess where it was another."""
    entry = kept().get(name, {})
    same = entry.get("command") == MEASUREMENTS[name].command
    return float(entry["cpu_s"] / 60) if same and entry.get("cpu_s") else MEASUREMENTS[name].minutes


def measure(name: str) -> tuple[Rows, float]:
    """Run a command; return its rows, and the CPU seconds that it took."""
    before = _cpu_of_children()
    printed = json.loads(run(MEASUREMENTS[name].command))
    rows = printed["summary" if name == ONLINE else "rows"]
    # Trials that were run before count, too.
    seconds = max(_cpu_of_children() - before, sum(row.get("seconds", 0.0) for row in rows))
    if name == BELIEFS:
        rows = [row for row in rows if row["observation_model"] in BELIEVED]
    if name in RUNS:
        logs = sorted(Path(ROOT, printed["log"]).rglob("*.mcap"))
        rows = with_paired(rows, TrialOutcomes.join([read_outcomes(path) for path in logs]))
    return rows, seconds


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def with_paired(rows: Rows, outcomes: TrialOutcomes) -> Rows:
    """Add 95 % intervals, and by how much our agent earns more than others on the same questions.

    Declining every question, which earns 0, is the first of the others.
    """
    ours = outcomes.of_agent(OURS)
    more = estimate_mean(ours, "reward").interval()
    declining = {"agent": DECLINING, "reward": 0.0, **_more(more)}
    for row in rows:
        theirs = outcomes.of_agent(row["agent"])
        reward = estimate_mean(theirs, "reward").interval()
        row.update(reward_low=reward.low, reward_high=reward.high)
        if row["agent"] != OURS:
            row.update(_more(difference(ours, theirs).interval()))
    return [declining, *rows]


def _more(lead: Interval) -> dict[str, float]:
    """Return a lead of our agent as entries of a row."""
    return {"ours_more": lead.estimate, "ours_more_low": lead.low, "ours_more_high": lead.high}


def resting_on(name: str) -> list[str]:
    """Return the blocks that show rows of a measurement."""
    return [block for block, entry in BLOCKS.items() if name in entry.rests_on]


def write_blocks(names: Iterable[str]) -> None:
    """Write blocks, and the pictures."""
    for name in names:
        write_block(BLOCKS[name].page, name, shown(name))
    write_pictures(kept())


def shown(name: str) -> str:
    """Return what belongs into a block, by the rows that are kept."""
    entry = BLOCKS[name]
    there = kept()
    text = entry.text(there)
    measured = (there[name] for name in entry.rests_on if name in there)
    # The code that ran; results that were carried over hold for later code, too.
    codes = (made.get("same_as", [made["code"]])[0] for made in measured)
    made = " ".join(dict.fromkeys(codes))
    if entry.page == README:  # where readers begin
        return f"{text} <!-- made by code {made} -->"
    return f"{text}\n\nMade by code `{made}`."


def is_old(name: str) -> bool:
    """Return whether another command or code than this made a measurement, or nothing yet."""
    command = MEASUREMENTS[name].command
    entry = kept().get(name, {})
    return (entry.get("command"), entry.get("code")) != (command, made_by(command))


def check(*, release: bool) -> int:
    """Compare the blocks with their rows, the demo with what it prints, and codes with this one."""
    faults = check_demo()
    for name, entry in BLOCKS.items():
        place = f"{entry.page.relative_to(ROOT)}, block {name}"
        if block(entry.page.read_text(encoding="utf-8"), name).strip() != shown(name).strip():
            print(f"{place}: not what {MEASURED.relative_to(ROOT)} says; write it by --write")
            faults += 1
    for name in filter(is_old, MEASUREMENTS):
        pages = dict.fromkeys(
            str(BLOCKS[block].page.relative_to(ROOT)) for block in resting_on(name)
        )
        again = f"python benchmarks/readme.py --only {name}"
        print(f"{', '.join(pages)}: other code made {name}; {again}")
        faults += release
    return int(faults > 0)


def keep(name: str, rows: Rows, seconds: float) -> None:
    """Write down the rows of a measurement, what made them, and how long it took."""
    command = MEASUREMENTS[name].command
    entry = {"command": command, "code": made_by(command), "cpu_s": round(seconds), "rows": rows}
    entries = {**kept(), name: entry}
    ordered = {name: entries[name] for name in MEASUREMENTS if name in entries}
    MEASURED.write_text(json.dumps(ordered, indent=1) + "\n", encoding="utf-8")


def kept() -> dict[str, Any]:
    """Read what was kept of each measurement."""
    if not MEASURED.is_file():
        return {}
    return dict(json.loads(MEASURED.read_text(encoding="utf-8")))


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


def write_block(page: Path, name: str, new: str) -> None:
    """Put new content between the two comments of a page."""
    text = page.read_text(encoding="utf-8")
    old = f"<!-- {name} -->\n{block(text, name)}<!-- /{name} -->"
    text = text.replace(old, f"<!-- {name} -->\n{new.rstrip()}\n<!-- /{name} -->")
    page.write_text(text, encoding="utf-8")


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
