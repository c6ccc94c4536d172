"""Fig. 12: CY101, accuracy of MORC-ITRS over a grid of alpha and beta."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.experiments import OnlineConfig
from paper_repro.frame import Cell, Result, Setting, Table
from paper_repro.online import BEST, Curves, curves_config, mean_of, run_curves
from paper_repro.statements import RECORDED, Evidence, above, below, every, judged

ALPHAS = (0, 3, 6, 12, 24)
BETAS = (0, 10, 30, 60, 120)
MOMENTS = {"early": 1, "middle": 5, "late": 10}  # batches
REPEATS = 5  # of each of 25 pairs, whose means are compared
MIDDLE = "a beta in the middle is best"
RISES = "accuracy rises from early to late, averaged over the grid"
NOTE = """A beta of the middle is compared with both ends of the grid, by the mean over all alphas
and batches after training; a small alpha (3, 6) with the largest, early, and by how much accuracy
rises from early to late. That accuracy rises is judged by the mean over the pairs of weights: at
each of 25 pairs five splits could not show it, short of perfection; of each pair the means of the
table say it, without an interval. The sentence's intervals are those of the statements."""
SHOWS = """The paper draws accuracy over alpha and beta as three maps, early, middle and late: a
middle beta is best, accuracy rises everywhere, and with a small alpha it is higher in the beginning
and improves less. The maps below share their colors."""
Grid = Mapping[str, NDArray[np.float64]]  # accuracy (S,B) by "alpha, beta"


def runs(setting: Setting) -> Iterator[OnlineConfig]:
    """List the runs of all pairs of weights."""
    for alpha, beta in product(*weights(setting)):
        yield curves_config(setting, **how_run(setting, alpha, beta))


def weights(setting: Setting) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the alphas and the betas of the grid."""
    return setting.choose(ALPHAS, (3, 24)), setting.choose(BETAS, (0, 30, 120))


def how_run(setting: Setting, alpha: float, beta: float) -> dict[str, Any]:
    """Return the arguments of the run of a pair of weights."""
    repeats = setting.repeats_of(REPEATS, column=RECORDED)
    weighed = {"alpha": float(alpha), "beta": float(beta)}
    return {"dataset": "cy101", "n": 1, "agent": BEST, "repeats": repeats, **weighed}


def run(setting: Setting) -> Result:
    """Run the grid on recordings."""
    alphas, betas = weights(setting)
    repeats = setting.repeats_of(REPEATS, column=RECORDED)
    curves: dict[str, Curves] = {
        f"{alpha}, {beta}": run_curves(setting, **how_run(setting, alpha, beta))
        for alpha, beta in product(alphas, betas)
    }
    # Repeat s of every pair of weights has the same split, so that grids are compared repeat by
    # repeat; splits share their objects, by one ratio.
    ratio = next(iter(curves.values())).ratio
    grid = {name: entry.accuracy for name, entry in curves.items()}
    moments = {name: _moments(accuracy) for name, accuracy in grid.items()}
    rows: list[tuple[Cell, ...]] = [
        (*name.split(", "), repeats, *(mean_of(part, ratio, fraction=True) for part in values))
        for name, values in moments.items()
    ]
    evidence: dict[str, dict[str, Evidence | None]] = {RECORDED: judge(grid, ratio)}
    rises = [float((values[-1] - values[0]).mean()) for values in moments.values()]
    return Result(
        title="CY101, accuracy over alpha and beta: early, middle, late",
        sentence=_sentence(judged(evidence, [], ""), rises),
        tables=(
            Table("accuracy of MORC-ITRS", ("alpha", "beta", "repeats", *MOMENTS), tuple(rows)),
        ),
        evidence=evidence,
        size=f"{repeats} repeats of each pair.",
        notes=(NOTE,),
        shows=SHOWS,
    )


def judge(grid: Grid, ratio: float) -> dict[str, Evidence | None]:
    """Judge the statements from the accuracy of every pair of weights, (S,B) each."""

    def over(axis: int, wanted: tuple[int, ...]) -> NDArray[np.float64]:
        """Average the accuracy (S,B) over the pairs with some weights."""
        chosen = [a for name, a in grid.items() if int(name.split(", ")[axis]) in wanted]
        return np.asarray(np.mean(chosen, axis=0))

    middle = over(1, BETAS[1:-1])[:, 1:].mean(axis=1)  # of the batches after training
    ends = {b: middle - over(1, (b,))[:, 1:].mean(axis=1) for b in (BETAS[0], BETAS[-1])}
    small = _moments(over(0, ALPHAS[1:3]))
    large = _moments(over(0, ALPHAS[-1:]))
    early = mean_of(small[0] - large[0], ratio)
    rise = mean_of((small[2] - small[0]) - (large[2] - large[0]), ratio)
    average = _moments(np.asarray(np.mean(list(grid.values()), axis=0)))
    return {
        MIDDLE: every(
            [
                above(mean_of(lead, ratio), 0, of=f"accuracy less that at beta {b}")
                for b, lead in ends.items()
            ]
        ),
        "a small alpha is higher in the beginning and improves less than the largest": every(
            [
                above(early, 0, of=f"early, less at {ALPHAS[-1]}"),
                below(rise, 0, of=f"rise less that at {ALPHAS[-1]}"),
            ]
        ),
        RISES: above(mean_of(average[2] - average[0], ratio), 0, of="mean rise"),
    }


def _sentence(statements: Sequence[Mapping[str, Any]], rises: Sequence[float]) -> str:
    """Say how much a middle beta brings, and how accuracy rises, over the grid and in each pair."""
    middle, mean = (
        f"{row['estimate']:+.3f} [{row['interval'][0]:+.3f}, {row['interval'][1]:+.3f}]"
        for text in (MIDDLE, RISES)
        for row in statements
        if row["text"] == text
    )
    rising = sum(rise > 0 for rise in rises)
    return (
        f"A beta in the middle differs from an end of the grid by {middle}; accuracy rises by "
        f"{mean} on average, and the mean of the splits rises in {rising} of {len(rises)} "
        f"pairs of weights (by {min(rises):+.3f} to {max(rises):+.3f})."
    )


def _moments(values: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the accuracy (S,) early, in the middle, and late."""
    return [values[:, min(batch, values.shape[1] - 1)] for batch in MOMENTS.values()]
