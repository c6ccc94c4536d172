"""Digests of what small offline and online runs decided, to compare before and after a change.

    python benchmarks/digests.py before.json          # then change the code
    python benchmarks/digests.py after.json before.json
    python benchmarks/digests.py after.json before.json --carry-over CHECKOUT [--again NAME ...]

The last command compares with a checkout of the code before a change. If no log differs, the change
decides nothing else: what that code measured holds for this code. Results that were made by it then
get the digest of this code, and keep the earlier ones under `same_as`. If logs differ, name all
results that rest on such runs by `--again`, and make them again; the others are carried over.

A file holds the digest of its code, too: logs of a code that is in a file are not made again. If
the package is the same in both, no log is made.

What a command runs beside the package, its script and what items of the paper share, has to be the
same in both. An item of the paper is carried over, too, if only functions and classes beside the
package differ, and `meal-bayes reproduce all --quick` gives equal tables and outcomes of it.

Three data sets, all agents offline, four online. A digest covers each trial's task, steps,
percepts, values (eight digits), beliefs (ten digits), costs, rewards and report; no clocks,
versions or file formats.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from measuring import ROOT

from meal_bayes.trial_log import read_trials
from meal_bayes.trials import Trial
from paper_repro.frame import RESULTS, Setting, command, items
from paper_repro.made_by import made_by, parts, sources

DATASETS = ("roc36", "ispy32", "cy101")
_AGENTS = "iterative_random_legal,morc_itrs,bayes,bayes_memory"
PACKAGE = "meal-bayes run"  # a command of the package alone
KEPT = (ROOT / "benchmarks/readme.json", RESULTS / "provenance.json")
SMALL = {  # options of a run that takes seconds
    "offline": "--trials 6 --attributes 2 --seed 3",
    "online": (
        f"--batches 2 --trials 5 --repeats 1 --attributes 2 --seed 3 --log full --agent {_AGENTS}"
    ),
}


def content(trial: Trial) -> str:
    """Write a trial down in text."""
    parts = [repr(trial.task), trial.agent, repr(trial.truth.tolist())]
    parts.append("none" if trial.report is None else repr(trial.report.tolist()))
    for step in trial.steps:
        percept = None if step.observation is None else step.observation.tolist()
        numbers = (
            round(step.cost, 9),
            round(step.reward, 9),
            step.belief.positive.round(10).tolist(),
            step.decision.values.round(8).tolist(),
        )
        parts.append(repr((step.x, step.decision.action, step.next_x, percept, *numbers)))
    return "|".join(parts)


def digests(root: Path, dataset: str, kind: str) -> dict[str, str]:
    """Run one kind on one data set; return a digest of each log, by its place in the run."""
    with TemporaryDirectory() as logs:
        words = [sys.executable, "-m", "meal_bayes", "run", kind, "--dataset", dataset]
        subprocess.run(
            [*words, *SMALL[kind].split(), "--logs", logs],
            check=True, capture_output=True, cwd=root, env={**os.environ, "PYTHONPATH": str(root)},
        )  # fmt: skip
        return {
            "/".join((dataset, kind, *path.relative_to(logs).parts[1:])): hashlib.sha256(
                "\n".join(map(content, read_trials(path))).encode()
            ).hexdigest()[:16]
            for path in sorted(Path(logs).rglob("*.mcap"))
        }


def all_digests(root: Path, file: Path) -> dict[str, str]:
    """Run every kind on every data set by the code of a checkout; go on with what a file holds."""
    code = made_by(f"python {Path(__file__).relative_to(ROOT)}", root)
    kept = json.loads(file.read_text()) if file.is_file() else {}
    runs = kept["runs"] if kept.get("code") == code else {}
    for dataset in DATASETS:
        for kind in SMALL:
            if f"{dataset} {kind}" not in runs:
                runs[f"{dataset} {kind}"] = digests(root, dataset, kind)
                file.write_text(json.dumps(kept | {"code": code, "runs": runs}, indent=1))
    return logs_of(runs)


def quick_results(root: Path, file: Path) -> dict[str, str]:
    """Run each item of the paper quickly, or read what a file holds; return digests by item."""
    code = "".join(made_by(command(item, Setting()), root) for item in items())
    kept = json.loads(file.read_text()) if file.is_file() else {}
    if kept.get("items code") != code:
        with TemporaryDirectory() as logs:
            words = [sys.executable, "-m", "meal_bayes", "reproduce", "all", "--quick", "--json"]
            done = subprocess.run(
                [*words, "--logs", logs],
                check=True, capture_output=True, cwd=root, text=True,
                env={**os.environ, "PYTHONPATH": str(root)},
            )  # fmt: skip
        results = {
            result["item"]: hashlib.sha256(
                json.dumps([result["tables"], result["statements"]]).encode()
            ).hexdigest()[:16]
            for result in json.loads(done.stdout)["items"]
        }
        kept |= {"items code": code, "items": results}
        file.write_text(json.dumps(kept, indent=1))
    return dict(kept["items"])


def logs_of(runs: dict[str, dict[str, str]]) -> dict[str, str]:
    """Return the digests of the logs of all runs."""
    return {log: digest for logs in runs.values() for log, digest in logs.items()}


def carry_over(
    made: dict[str, Any], words: str, before: Path, now: Path = ROOT, *, tried: bool = False
) -> bool:
    """Note that this code makes what the code of another checkout made; return whether it does.

    What a command runs beside the package, such as a script, has to be the same in both. If it was
    `tried`, with equal results, only constants and data have to be.
    """
    earlier, later = made_by(words, before), made_by(words, now)
    beside = [beside_package(words, root, constants=tried) for root in (before, now)]
    if made.get("code") != earlier or earlier == later or beside[0] != beside[1]:
        return False
    made |= {"code": later, "same_as": [*made.get("same_as", []), earlier]}
    return True


def beside_package(words: str, root: Path, *, constants: bool = False) -> list[bytes]:
    """Return what decides the numbers of a command and is no part of the package."""
    package = root / "meal_bayes"
    files = (file for file in sources(words, root) if package not in file.parents)
    return sorted(part for file in files for part in parts(file, constants=constants))


def carry_all_over(before: Path, again: Collection[str], tried: Collection[str] = ()) -> None:
    """Carry over all results of the code in another checkout but those to be made again.

    Items of the paper that were `tried` gave equal results in both.
    """
    for path in KEPT:
        entries = json.loads(path.read_text(encoding="utf-8"))
        for name, made in entries.items():
            if name in again:
                print(f"to be made again: {name}")
                continue
            words = made.get("command") or command(name, Setting())
            if carry_over(made, words, before, tried=name in tried):
                print(f"carried over: {name}")
        path.write_text(json.dumps(entries, indent=1) + "\n", encoding="utf-8")


def main() -> int:
    """Write the digests, and compare."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path, help="JSON to write")
    parser.add_argument("before", type=Path, nargs="?", help="JSON to compare with")
    parser.add_argument("--carry-over", type=Path, metavar="CHECKOUT", help="of the code before")
    parser.add_argument("--again", nargs="+", default=[], help="results of runs that differ")
    options = parser.parse_args()
    if options.carry_over and not options.before:
        parser.error("--carry-over needs the file with the digests of the code before")
    checkout = options.carry_over and options.carry_over.resolve()
    if checkout and made_by(PACKAGE, checkout) == made_by(PACKAGE, ROOT):
        print("the package is the same")
        carry_all_over(checkout, options.again, equal_items(checkout, options))
        return 0
    now = before = all_digests(ROOT, options.out)
    if checkout:
        before = all_digests(checkout, options.before)
    elif options.before:
        before = logs_of(json.loads(options.before.read_text())["runs"])
    changed = sorted(log for log in {**before, **now} if before.get(log) != now.get(log))
    print(*changed, f"{len(changed)} of {len(now)} logs differ", sep="\n")
    if checkout and (options.again or not changed):
        carry_all_over(checkout, options.again, equal_items(checkout, options))
    return bool(changed)


def equal_items(checkout: Path, options: argparse.Namespace) -> set[str]:
    """Return the items of the paper whose quick results are equal here and in a checkout.

    Nothing is run if what they share beside the package is the same in both.
    """
    commands = [command(item, Setting()) for item in items()]
    if all(beside_package(words, checkout) == beside_package(words, ROOT) for words in commands):
        return set()
    results = quick_results(ROOT, options.out)
    before = quick_results(checkout, options.before)
    return {item for item, digest in before.items() if results.get(item) == digest}


if __name__ == "__main__":
    sys.exit(main())
