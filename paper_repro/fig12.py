"""Fig. 12: CY101, accuracy of MORC-ITRS over a grid of alpha and beta, and where its own lie."""

from itertools import product

import numpy as np
from frame import Cell, Claim, Result, Setting, Table, main
from numpy.typing import NDArray
from online import chosen_weights, mean_of, nearest, panel

from meal_bayes.evaluation import curves_of, plots

FIXED, AUTO = "morc_itrs", "morc_itrs_auto"
NOTE = """Of the repeats, the first half chooses the best fixed pair by the mean accuracy over all
batches, the second half compares it with the self-chosen weights. A star marks the pair of the grid
next to the mean of those that the agent chose for itself after pretraining."""
DELTA = 5 * 66  # recordings of the objects in pretraining and training, Eq. 10


def run(setting: Setting) -> Result:
    """Run the grid, and the agent that chooses its weights from its own posterior."""
    alphas, betas = setting.of("fig12", "alpha"), setting.of("fig12", "beta")
    repeats, moments = setting.of("fig12", "repeats"), setting.of("fig12", "moments")
    grid = np.array(
        [[_accuracy(setting, FIXED, repeats, a, b) for a in alphas] for b in betas]
    )  # (beta,alpha,repeat,batch)
    auto = panel(setting, "cy101", 1, (AUTO,), repeats)
    own = curves_of(auto.results(), AUTO).accuracy  # (repeat,batch)
    alpha, beta = chosen_weights(auto)
    beta *= DELTA
    last = grid.shape[-1] - 1
    figures = {}
    for name, batch in moments.items():
        ax = figures[f"_{name}"] = plots.heat_map(
            grid[:, :, :, min(batch, last)].mean(axis=2), alphas, betas,
            x_label="alpha, s a bit", y_label="beta, s", value_label=f"accuracy, {name}", digits=3,
        )  # fmt: skip
        ax.plot(nearest(alphas, alpha), nearest(betas, beta) + 0.3, "*", color="white", ms=11)
    half = max(repeats // 2, 1)
    area = grid.mean(axis=3)  # (beta,alpha,repeat)
    b, a = np.unravel_index(area[:, :, :half].mean(axis=2).argmax(), area.shape[:2])
    rest = slice(half, None) if repeats > 1 else slice(None)
    gain = own.mean(axis=1)[rest] - area[b, a, rest]
    rows: list[tuple[Cell, ...]] = [
        (alphas[j], betas[i], *(mean_of(grid[i, j, :, min(m, last)]) for m in moments.values()))
        for i, j in product(range(len(betas)), range(len(alphas)))
    ]
    rows.append(("own", "own", *(mean_of(own[:, min(m, last)]) for m in moments.values())))
    rise = grid[..., min(max(moments.values()), last)].mean(2) > grid[..., min(1, last)].mean(2)
    middle = grid[:, :, :, last].mean(axis=(1, 2))
    return Result(
        item="fig12",
        title="CY101, accuracy over alpha and beta: early, middle, late",
        paper="middle beta best; accuracy rises everywhere",
        ours=f"own weights less best fixed ({alphas[a]}, {betas[b]}): {gain.mean():+.3f}",
        tables=(Table("accuracy of MORC-ITRS", ("alpha", "beta", *moments), tuple(rows)),),
        claims=(
            Claim("a beta in the middle is best", bool(0 < middle.argmax() < len(betas) - 1)),
            Claim("accuracy rises from early to late everywhere", bool(rise.all())),
        ),
        notes=(NOTE.replace("\n", " "),
               f"Area under the curve, own less best fixed: {mean_of(gain).mean:+.4f} "
               f"(s.e. {mean_of(gain).se:.4f}), of {area[b, a, rest].mean():.3f}. "
               f"Chosen after pretraining: alpha {alpha:.1f}, beta {beta:.1f}."),
        figures=figures,
    )  # fmt: skip


def _accuracy(
    setting: Setting, agent: str, repeats: int, alpha: float | None = None,
    beta: float | None = None,
) -> NDArray[np.float64]:  # fmt: skip
    run = panel(setting, "cy101", 1, (agent,), repeats, alpha=alpha, beta=beta)
    return curves_of(run.results(), agent).accuracy


if __name__ == "__main__":
    main(run)
