"""A peer that learns while it works: active inference by pymdp, on the toy of `learning.py`.

    pip install inferactively-pymdp
    python benchmarks/peers_learning.py FIRST-END [--tune FIRST-END] [--trials T] [--json]

pymdp keeps Dirichlet counts of the observation model and chooses the action of the least expected
free energy: utility, expected information on the object and on the counts. It is given what helps
it: features are its percepts, 0 or 1, where ours must learn a classifier; the labels that are told
are its states; a report is chosen by its utility alone, or it would report at once to be told the
truth. Rewards and seconds are preferences, all times one scale. That scale is chosen on the seeds
of `--tune`, of several, and the result is that of other seeds. `bayes` meets the same objects.
"""

import numpy as np
from learning import measure
from measuring import options_of, show

SCALES = (0.003, 0.005, 0.01, 0.02, 0.05)  # of preferences, nats a second


def seeds_of(text: str) -> range:
    """Read FIRST-END."""
    first, end = map(int, text.split("-"))
    return range(first, end)


def main() -> None:
    """Tune on some seeds, score on others, and print a table or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("seeds", metavar="FIRST-END")
    parser.add_argument("--tune", metavar="FIRST-END", default="0-5")
    parser.add_argument("--trials", type=int, default=100)
    options = parser.parse_args()
    from pymdp_agent import learned  # noqa: PLC0415  so that --help needs no peer

    tuned = {}
    for scale in SCALES:
        runs = [learned(seed, options.trials, scale) for seed in seeds_of(options.tune)]
        tuned[scale] = float(np.mean([run["reward"] for run in runs]))
    best = max(tuned, key=lambda scale: tuned[scale])
    seeds = seeds_of(options.seeds)
    how = {"agent": "bayes", "trials": options.trials, "horizon": None}
    results = {
        f"pymdp, scale {best:g}": [learned(seed, options.trials, best) for seed in seeds],
        "bayes": [measure("toy", seed, **how) for seed in seeds],
    }
    rows = []
    for name, runs in results.items():
        values = np.array([run["reward"] for run in runs], float)
        rows.append(
            {
                "agent": name,
                "reward": float(values.mean()),
                "s.e.": float(values.std(ddof=1) / np.sqrt(len(values))),
                "least": float(values.min()),
                "cpu, s": float(np.mean([run["cpu, s"] for run in runs])),
            }
        )
    show(rows, {"tuned": tuned, "rows": rows} if options.json else None)


if __name__ == "__main__":
    main()
