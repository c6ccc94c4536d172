"""Do the intervals that compare agents contain the truth in 95 of 100 cases? Simulated outcomes.

Repeats split the same objects into three parts again and again. Outcomes of two agents on the test
part are drawn from the hierarchical model of `meal-bayes compare` (terms for agent, object,
attribute and repeat, and those of agent and object, agent and repeat), as many as in an online run,
with the spreads that the model has found in Fig. 10's panels. The truth is the difference over new
objects and repeats. An agent's luck in a repeat is drawn anew in each, or is that of the objects
which taught it, which repeats share, as a sum. Printed: how often the interval of the paired
difference (corrected resampled t, at several ratios) and that of the model contain the truth; and
how often any of the 30 statements of a family is decided where nothing differs (Holm).

    python benchmarks/compare.py [--json] [--simulations 200] [--fits 50] [--measure success]
"""

import sys
import warnings
from itertools import product

import numpy as np
from measuring import options_of, show

from meal_bayes.evaluation import resampled
from meal_bayes.evaluation.outcome_model import compare_outcomes
from meal_bayes.evaluation.summary import measured
from meal_bayes.seeds import stream
from meal_bayes.trials import TrialOutcomes
from paper_repro.inference import holm, level_above, level_below

OBJECTS = 60
REPEATS = 10
ATTRIBUTES = 6
AGENTS = 2
TESTED = OBJECTS // 3
RATIO = TESTED / (OBJECTS - TESTED)
RATIOS = (0.0, 0.05, 0.1, 0.2, RATIO)  # the last one is that of statements
FAMILY = 30  # statements of Fig. 10 in one column
# standard deviations on the logistic scale, and of costs in s
SPREAD = {"object": 0.4, "attribute": 0.7, "repeat": 0.25, "agent object": 0.05,
          "agent repeat": 0.15}  # fmt: skip
LEAD = 0.5  # of the second agent
NOISE = 6.0  # of a cost
SECONDS = 5.0  # a unit of the scale
# An agent's luck in a repeat: in units of what was fitted, and whether the objects taught have it.
# Any two repeats teach two thirds of the same objects, so that a third of such luck shows as spread
# between repeats; the last world has the visible part that was fitted.
WORLDS = {"drawn anew": (1.0, False), "of the objects taught": (1.0, True),
          "of the objects taught, visible as fitted": (3.0**0.5, True)}  # fmt: skip


def simulate(
    rng: np.random.Generator, lead: float, *, luck: float = 1.0, taught: bool = False
) -> tuple[TrialOutcomes, np.ndarray, dict]:
    """Draw an online run's test outcomes, the repeat of each, and the true differences."""
    draw = {
        name: sd * rng.normal(size=size)
        for (name, sd), size in zip(
            SPREAD.items(),
            (OBJECTS, ATTRIBUTES, REPEATS, (AGENTS, OBJECTS), (AGENTS, REPEATS)),
            strict=True,
        )
    }
    draw["agent repeat"] = luck * draw["agent repeat"]
    splits = np.array([rng.permutation(OBJECTS) for _ in range(REPEATS)])
    tests = splits[:, :TESTED]
    if taught:  # of the same variance
        each = rng.normal(size=(AGENTS, OBJECTS)) / np.sqrt(OBJECTS - TESTED)
        shared = each[:, splits[:, TESTED:]].sum(axis=2)
        draw["agent repeat"] = luck * SPREAD["agent repeat"] * shared
    rows = [
        (a, o, p, j)
        for a in range(AGENTS)
        for j, objects in enumerate(tests)
        for o in objects
        for p in range(ATTRIBUTES)
    ]
    a, o, p, j = np.array(rows).T
    eta = (
        1.0
        + lead * a
        + draw["object"][o]
        + draw["attribute"][p]
        + draw["repeat"][j]
        + draw["agent object"][a, o]
        + draw["agent repeat"][a, j]
    )
    right = rng.random(len(eta)) < 1 / (1 + np.exp(-eta))
    cost = 40.0 - SECONDS * eta + NOISE * rng.normal(size=len(eta))
    outcomes = TrialOutcomes(
        behaviors=(),
        agent=np.array(["first", "second"], object)[a],
        key=np.array([f"{x} {y} {z}" for x, y, z in zip(o, p, j, strict=True)]),
        object_index=o,
        object_name=o.astype(str),
        attribute=p.astype(str)[:, None],
        truth=np.ones((len(eta), 1)),
        report=right[:, None],
        positive=np.full((len(eta), 1), 0.5),
        cost=cost,
        reward=-cost,
        ended=np.full(len(eta), ""),
        steps=np.zeros(len(eta)),
        executed=np.zeros((len(eta), 0), int),
        failed=np.zeros((len(eta), 0), int),
    )
    spread = {**SPREAD, "agent repeat": luck * SPREAD["agent repeat"]}
    sd = np.sqrt(sum(sd**2 for name, sd in spread.items() if name != "attribute"))
    points, weights = np.polynomial.hermite_e.hermegauss(40)
    at = 1.0 + draw["attribute"][:, None] + sd * points
    mean = [((1 / (1 + np.exp(-at - x))) @ weights).mean() / weights.sum() for x in (0.0, lead)]
    return outcomes, j, {"success": mean[1] - mean[0], "cost": -SECONDS * lead}


def paired(outcomes: TrialOutcomes, repeats: np.ndarray, measure: str) -> np.ndarray:
    """Return the second agent's mean less the first's in each repeat, (J,)."""
    values = measured(outcomes, measure)
    first, second = (
        [values[(outcomes.agent == name) & (repeats == j)].mean() for j in range(REPEATS)]
        for name in ("first", "second")
    )
    return np.subtract(second, first)


def main() -> None:
    """Measure, and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--simulations", type=int, default=200)
    parser.add_argument("--fits", type=int, default=50, help="simulations that the model is fitted")
    parser.add_argument(
        "--draws", type=int, default=200, help="of the model, in each of two chains"
    )
    parser.add_argument("--measure", choices=["success", "cost"], help="one of both")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    measures = [options.measure] if options.measure else ["success", "cost"]
    for (world, (luck, taught)), measure in product(WORLDS.items(), measures):
        runs = [
            simulate(stream(number, "compare"), LEAD, luck=luck, taught=taught)
            for number in range(max(options.simulations, options.fits))
        ]
        truths = [truth[measure] for *_, truth in runs]
        leads = [paired(*run[:2], measure) for run in runs[: options.simulations]]
        methods: dict[str, list] = {
            f"corrected t, ratio {ratio:g}": [resampled(x, ratio).interval()[2:] for x in leads]
            for ratio in RATIOS
        }
        if options.fits:
            fits = methods["the model"] = []
            for number, (outcomes, repeats, _) in enumerate(runs[: options.fits]):
                (fit,) = compare_outcomes(
                    outcomes, measure=measure, repeats=repeats, draws=options.draws, seed=number
                )
                fits.append((fit.low, fit.high))
                inside = fit.low <= truths[number] <= fit.high
                print(f"fit {number + 1} of {options.fits}: {inside}", file=sys.stderr, flush=True)
        for method, intervals in methods.items():
            hits = [
                low <= truth <= high for truth, (low, high) in zip(truths, intervals, strict=False)
            ]
            width = float(np.mean([high - low for low, high in intervals]))
            rows.append(
                _row(f"{measure}: the interval contains the truth", world, method, hits, width)
            )
    for world, (luck, taught) in WORLDS.items():
        false = []
        for number in range(options.simulations):
            effects = [
                resampled(
                    paired(
                        *simulate(stream(number, "family", k), 0.0, luck=luck, taught=taught)[:2],
                        "success",
                    ),
                    RATIO,
                )
                for k in range(FAMILY)
            ]
            levels = np.array([min(level_above(gap, 0), level_below(gap, 0)) for gap in effects])
            false.append(bool((levels <= holm(levels)).any()))
        rows.append(
            _row(
                f"any of {FAMILY} is decided where nothing differs",
                world,
                f"corrected t, ratio {RATIO:g}",
                false,
            )
        )
    show(rows, rows if options.json else None)


def _row(what: str, world: str, method: str, cases: list[bool], width: float | None = None) -> dict:
    fraction = {"fraction": float(np.mean(cases)), "of": len(cases), "width": width}
    return {"": what, "an agent's luck in a repeat is": world, "method": method, **fraction}


if __name__ == "__main__":
    main()
