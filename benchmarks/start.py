"""How soon an answer comes: CPU seconds of small commands, of the largest data set, of kernels."""

import os
import tempfile
from pathlib import Path

from measuring import cpu_seconds, options_of, show

SAMPLE = Path(__file__).resolve().parents[1] / "logs" / "sample.mcap"
READ = "from meal_bayes.datasets import load_dataset; load_dataset('cy101')"
KERNELS = (
    "from meal_bayes.planners import POMCP, Factored, OpenLoop, warm_up\n"
    "for solver in (POMCP(), OpenLoop(), Factored()): warm_up(solver)\n"
    "warm_up(POMCP(), float('inf'))"
)
PARTS = {  # name: (bar in CPU seconds, words behind `python`)
    "--help": (0.5, ("-m", "meal_bayes", "--help")),
    "data list": (1.0, ("-m", "meal_bayes", "data", "list", "roc36")),
    "log info": (2.0, ("-m", "meal_bayes", "log", "info", str(SAMPLE))),
    "doctor": (5.0, ("-m", "meal_bayes", "doctor")),
    "read CY101": (10.0, ("-c", READ)),  # needs the recordings
}
COLD = {  # with an empty cache of kernels, as after an install
    "demo, nothing compiled": ("-m", "meal_bayes", "demo"),
    "kernels of all solvers": ("-c", KERNELS),
}
DEMO = (  # on one core
    "import os, sys\n"
    "os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])\n"
    "from meal_bayes.cli import main\n"
    "main(['demo', '--logs', sys.argv[1]])"
)
HERE = Path(__file__).resolve().parents[1]
REPEATS = 3


def beside(package: Path) -> list[dict[str, object]]:
    """Run the demo with nothing compiled of another version, and of this one; Linux only."""
    rows: list[dict[str, object]] = []
    for name, folder in (("now", HERE), ("before", package.resolve())):
        with tempfile.TemporaryDirectory() as cache:
            spent = cpu_seconds(
                ("-P", "-c", DEMO, cache), PYTHONPATH=str(folder), NUMBA_CACHE_DIR=cache
            )
        rows.append({"demo, nothing compiled": name, "CPU s": spent})
    return rows


def main() -> None:
    """Measure and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--before", type=Path, help="folder of another version: the demo alone")
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if options.before is not None:
        demos = beside(options.before)
        show(demos, demos if options.json else None)
        return
    rows = [
        {"part": name, "CPU s": min(cpu_seconds(words) for _ in range(REPEATS)), "bar": bar}
        for name, (bar, words) in PARTS.items()
    ]
    for name, words in COLD.items():
        with tempfile.TemporaryDirectory() as cache:
            rows.append({"part": name, "CPU s": cpu_seconds(words, NUMBA_CACHE_DIR=cache)})
    measured = {row["part"]: round(row["CPU s"], 2) for row in rows}
    report = {name: None if s != s else s for name, s in measured.items()}  # noqa: PLR0124  NaN
    show(rows, report if options.json else None)


if __name__ == "__main__":
    main()
