"""Damaged files of every kind that the package reads, drawn by hypothesis.

Each kind runs in a process of its own, so that its memory is its own. `silent` counts results that
are not what the file says, `hangs` readings that took more than five seconds of CPU, `tracebacks`
everything that is raised and is not one of the package's errors, or that the command line would not
tell in one line, `changed` files beside or under the reading that are not what they were.
"""

import argparse
import contextlib
import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from click.testing import CliRunner
from fuzz_damage import SOUND, damages, make_sound
from fuzz_oracles import Wrong, readers
from hypothesis import Phase, given, seed, settings

from meal_bayes.cli import main as program
from meal_bayes.errors import MealBayesError

FOUND = ("inputs", "silent", "hangs", "tracebacks", "changed")
PATIENCE = 5.0  # s of CPU
MEMORY = 500.0  # MB
EVERY = 10  # of so many inputs one goes through the command line too
KINDS = tuple(SOUND)
SHOWN = 20  # findings that are told
COMMANDS = {
    "log": (("log", "check"), ("log", "info"), ("log", "info", "--json"), ("log", "show"),
            ("log", "recover", "--out", "out.mcap", "--json"), ("report", "-o", "out.html")),
    "table": (("data", "list"), ("memory", "show", "--dataset")),
    "toml": (("ask", "red", "--object", "a", "--dataset"), ("data", "list")),
    "pomdpx": (("log", "check"), ("data", "list"), ("view", "--save", "out.rrd")),
}  # fmt: skip


class Hang(BaseException):
    """Raised by the clock; no `Exception`, so that no reader takes it for a fault of its own."""


class Tally:
    """Findings of one kind."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.told: list[str] = []
        self.peak = 0.0

    def note(self, what: str, text: str) -> None:
        """Count one finding, and keep its words."""
        self.counts[what] += 1
        if len(self.told) < SHOWN:
            self.told.append(f"{what}: {text}")

    def run(self, name: str, action: Callable[[], object]) -> None:
        """Run one reading under the clock."""
        begin = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, PATIENCE)
        try:
            action()
        except Hang:
            pass
        except Wrong as fault:
            self.note("silent", f"{name}: {fault}")
        except Exception as fault:
            if not isinstance(fault, MealBayesError):
                self.note("tracebacks", f"{name}: {type(fault).__name__}: {str(fault)[:200]}")
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        if time.process_time() - begin > PATIENCE:
            self.note("hangs", name)
        if (peak := peak_mb()) > max(MEMORY, self.peak):
            self.peak = peak
            self.note("memory", f"{name}: {peak:.0f} MB")


def command(arguments: tuple[str, ...], path: Path, tally: Tally) -> None:
    """Call the command line in this process; it may end with 0, 1 or 2 and one line of error."""
    result = CliRunner().invoke(program, [*arguments, str(path)])
    name = f"{' '.join(arguments)} {path.name}"
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        if isinstance(result.exception, Hang):
            raise result.exception
        tally.note("tracebacks", f"{name}: {result.exception!r:.200}")
    errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    if result.exit_code not in (0, 1, 2) or len(errors) > 1 or "Traceback" in result.output:
        tally.note("tracebacks", f"{name}: exit code {result.exit_code}, {result.stderr[:200]!r}")
    if any(not (sign.isprintable() or sign == "\n") for sign in result.output):
        tally.note("tracebacks", f"{name}: sends control characters")


def digests(folder: Path) -> dict[str, str]:
    """Digest of every file, but of those that commands wrote as they were told."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.iterdir())
        if path.is_file() and not path.name.startswith("out.")
    }


def damaged(kind: str, count: int, number: int, folder: Path, tally: Tally) -> None:
    """Damage one sound file over and over."""
    make_sound(folder)
    path = folder / SOUND[kind]
    checks = readers(kind, path)

    @seed(number)
    @settings(max_examples=count, deadline=None, database=None, phases=[Phase.generate])
    @given(damages(path.read_bytes()))
    def read(changed: bytes) -> None:
        path.write_bytes(changed)
        index = tally.counts["inputs"] = tally.counts["inputs"] + 1
        name = f"{kind} {index}"
        with unchanged(folder, name, tally, whole=index % EVERY == 0):
            for check in checks:
                tally.run(name, lambda c=check: c(path))
            for arguments in COMMANDS.get(kind, ()) if index % EVERY == 0 else ():
                tally.run(name, lambda a=arguments: command(a, path, tally))
                for out in folder.glob("out.*"):
                    out.unlink()

    read()


@contextlib.contextmanager
def unchanged(folder: Path, name: str, tally: Tally, *, whole: bool = True) -> Iterator[None]:
    """Compare the files of a folder before and after."""
    before = digests(folder) if whole else {}
    yield
    if whole and (after := digests(folder)) != before:
        tally.note("changed", f"{name}: {sorted(set(before.items()) ^ set(after.items()))[:2]}")


def one_kind(kind: str, options: argparse.Namespace) -> None:
    """Run one kind and print what was found."""

    def ring(*_: object) -> None:
        raise Hang

    signal.signal(signal.SIGPROF, ring)
    warnings.simplefilter("error")  # what a library mutters, nobody foresaw
    tally = Tally()
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        damaged(kind, options.inputs, options.seed, Path(name), tally)
    counts = {key: tally.counts[key] for key in FOUND}
    print(json.dumps({**counts, "peak_mb": round(peak_mb()), "told": tally.told}))


def peak_mb() -> float:
    """Return the most memory that this process has had, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main() -> int:
    """Read the command line; the exit code is 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=1000, help="damages of each kind of file")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", action="append", choices=KINDS, help="a kind; may be repeated")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--kind", choices=KINDS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.kind:
        one_kind(options.kind, options)
        return 0
    total: Counter[str] = Counter(dict.fromkeys(FOUND, 0))
    peak, told, by_kind = 0, [], {}
    for kind in options.only or KINDS:
        numbers = [f"--{key}={getattr(options, key)}" for key in ("inputs", "seed")]
        done = subprocess.run(
            [sys.executable, __file__, "--kind", kind, *numbers], capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        if done.returncode:
            sys.exit(f"{kind} ended with {done.returncode}: {done.stderr[-2000:]}")
        found = json.loads(done.stdout)
        told += [f"{kind}: {text}" for text in found.pop("told")]
        peak = max(peak, found["peak_mb"])
        by_kind[kind] = found
        total.update({key: found[key] for key in FOUND})
    facts = {**{key: total[key] for key in FOUND}, "peak_mb": peak}
    if options.json:
        print(json.dumps({**facts, "kinds": by_kind, "told": told}))
    else:
        for kind, found in by_kind.items():
            print(f"{kind:<8}", ", ".join(f"{key} {value}" for key, value in found.items()))
        print("\n".join(told))
    return int(any(total[key] for key in FOUND[1:]))


if __name__ == "__main__":
    sys.exit(main())
