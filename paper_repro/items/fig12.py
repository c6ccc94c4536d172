"""Fig. 12: CY101, accuracy of MORC-ITRS over a grid of alpha and beta."""

from collections.abc import Mapping
from itertools import product

import numpy as np
from numpy.typing import NDArray

from meal_bayes.evaluation import plots
from paper_repro.frame import Cell, Result, Setting, Table, until_decided
from paper_repro.online import BEST, Curves, mean_of, paired, run_curves
from paper_repro.statements import Evidence, above, every, joined

ALPHAS, BETAS = (0, 3, 6, 12, 24), (0, 10, 30, 60, 120)
MOMENTS = {"early": 1, "middle": 5, "late": 10}  # batches
STEPS = (10, 20)  # repeats of every pair of weights
AUTO = "morc_itrs_auto"
NOTE = """A beta of the middle is compared with both ends of the grid, by the mean over all alphas
and batches after training; a small alpha (3, 6) with the largest. `own` chooses both weights from
its own posterior."""
SHOWS = """The paper draws accuracy over alpha and beta as three maps, early, middle and late: a
middle beta is best, and accuracy rises everywhere. The maps below share their colors."""
TEXTS = (
    "a beta in the middle is best",
    "a small alpha is better than the largest",
    "accuracy rises from early to late everywhere",
)

Grid = Mapping[str, NDArray[np.float64]]  # accuracy (S,B) by "alpha, beta"


def run(setting: Setting) -> Result:
    """Run the grid on recordings, and the agent that chooses its weights itself."""
    alphas, betas = setting.choose(ALPHAS, (6,)), setting.choose(BETAS, (30,))
    steps = setting.repeat_steps(STEPS)
    pairs = {f"{a}, {b}": (a, b) for a, b in product(alphas, betas)}
    evidence: Mapping[str, Evidence | None] = dict.fromkeys(TEXTS)
    rows: list[tuple[Cell, ...]] = []
    figures = {}
    if steps and not setting.as_published:

        def run_one(name: str, repeats: int) -> Curves:
            alpha, beta = pairs[name]
            return run_curves(
                setting, "cy101", 1, BEST, repeats, alpha=float(alpha), beta=float(beta)
            )

        runs, evidence = until_decided(pairs, steps, run_one, lambda found: judge(accuracy(found)))
        runs |= {"own, own": run_curves(setting, "cy101", 1, AUTO, steps[0])}
        grid = accuracy(runs)
        for name, values in grid.items():
            rows.append((*name.split(", "), len(values), *map(mean_of, _moments(values))))
        means = np.array([
            [[values.mean() for values in _moments(grid[f"{a}, {b}"])] for a in alphas]
            for b in betas
        ])  # fmt: skip
        limits = (float(means.min()), float(means.max()))
        for moment, of in zip(MOMENTS, np.moveaxis(means, 2, 0), strict=True):
            figures[f"_{moment}"] = plots.heat_map(
                of, alphas, betas, labels=("alpha, s a bit", "beta, s", f"accuracy, {moment}"),
                digits=3, limits=limits,
            )  # fmt: skip
    columns = ("alpha", "beta", "repeats", *MOMENTS)
    rise = evidence[TEXTS[2]]
    return Result(
        title="CY101, accuracy over alpha and beta: early, middle, late",
        paper="middle beta best; accuracy rises everywhere",
        ours=f"least rise {rise.interval.estimate:+.3f}" if rise else "",
        tables=(Table("accuracy of MORC-ITRS", columns, tuple(rows)),) if rows else (),
        statements=joined(evidence, None),
        notes=(NOTE,),
        figures=figures,
        shows=SHOWS if figures else "",
    )


def accuracy(runs: Mapping[str, Curves]) -> Grid:
    """Return the accuracy of every pair of weights."""
    return {name: curves.accuracy for name, curves in runs.items()}


def judge(grid: Grid) -> dict[str, Evidence]:
    """Judge the statements from the accuracy of every pair of weights, (S,B) each."""
    number, names = min(map(len, grid.values())), tuple(grid)
    area = {name: values[:number, 1:].mean(axis=1) for name, values in grid.items()}

    def over(axis: int, wanted: tuple[int, ...]) -> NDArray[np.float64]:
        own = [area[name] for name in names if int(name.split(", ")[axis]) in wanted]
        return np.asarray(np.mean(own or list(area.values()), axis=0))

    middle = over(1, BETAS[1:-1])
    ends = {f"beta {b}": paired(middle, over(1, (b,))) for b in (BETAS[0], BETAS[-1])}
    outcomes = (
        every(above(found, 0, number, names, of=f"accuracy less that at {name}")
              for name, found in ends.items()),
        above(paired(over(0, ALPHAS[1:3]), over(0, ALPHAS[-1:])), 0, number, names,
              of=f"accuracy less that at alpha {ALPHAS[-1]}"),
        every(above(paired(_moments(values)[2], _moments(values)[0]), 0, len(values), (name,),
                    of=f"rise at ({name})") for name, values in grid.items()),
    )  # fmt: skip
    return dict(zip(TEXTS, outcomes, strict=True))


def _moments(values: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the accuracy (S,) early, in the middle, and late."""
    return [values[:, min(batch, values.shape[1] - 1)] for batch in MOMENTS.values()]
