"""Do the intervals that compare agents contain the truth in 95 of 100 cases? Simulated outcomes.

Repeats split the same objects into three parts again and again. Outcomes of two agents on the test
part are drawn from the hierarchical model of `meal-bayes compare` (terms for agent, object,
attribute and repeat, and those of agent and object, agent and repeat), as many as in an online run.
The truth is the difference over new objects and repeats. Printed: how often the interval of the
paired difference (corrected resampled t) and that of the model contain it; and how often any of the
30 statements of a family is decided where nothing differs (Holm).

    python benchmarks/compare.py [--json] [--simulations 200] [--fits 200] [--measure success]
"""

import warnings

import numpy as np
from measuring import options_of, show

from meal_bayes.evaluation import holm, resampled
from meal_bayes.evaluation.outcome_model import compare_outcomes
from meal_bayes.evaluation.statistics import Effect
from meal_bayes.evaluation.summary import measured
from meal_bayes.seeds import stream
from meal_bayes.trials import TrialOutcomes

OBJECTS, REPEATS, ATTRIBUTES, AGENTS = 60, 10, 6, 2
TESTED = OBJECTS // 3
RATIO = TESTED / (OBJECTS - TESTED)
FAMILY = 30  # statements of Fig. 10 in one column
# standard deviations on the logistic scale, and of costs in s
SPREAD = {"object": 0.8, "attribute": 0.8, "repeat": 0.2, "agent object": 0.4, "agent repeat": 0.1}
LEAD, NOISE, SECONDS = 0.5, 6.0, 5.0  # of the second agent; of a cost; s a unit of the scale


def simulate(rng: np.random.Generator, lead: float) -> tuple[TrialOutcomes, np.ndarray, dict]:
    """Draw an online run's test outcomes, the repeat of each, and the true differences."""
    draw = {name: sd * rng.normal(size=size) for (name, sd), size in zip(
        SPREAD.items(),
        (OBJECTS, ATTRIBUTES, REPEATS, (AGENTS, OBJECTS), (AGENTS, REPEATS)), strict=True,
    )}  # fmt: skip
    tests = [rng.permutation(OBJECTS)[:TESTED] for _ in range(REPEATS)]
    rows = [(a, o, p, j) for a in range(AGENTS) for j, objects in enumerate(tests)
            for o in objects for p in range(ATTRIBUTES)]  # fmt: skip
    a, o, p, j = np.array(rows).T
    eta = (1.0 + lead * a + draw["object"][o] + draw["attribute"][p] + draw["repeat"][j]
           + draw["agent object"][a, o] + draw["agent repeat"][a, j])  # fmt: skip
    right = rng.random(len(eta)) < 1 / (1 + np.exp(-eta))
    cost = 40.0 - SECONDS * eta + NOISE * rng.normal(size=len(eta))
    outcomes = TrialOutcomes(
        behaviors=(), agent=np.array(["first", "second"], object)[a],
        key=np.array([f"{x} {y} {z}" for x, y, z in zip(o, p, j, strict=True)]),
        object_index=o, object_name=o.astype(str), attribute=p.astype(str)[:, None],
        truth=np.ones((len(eta), 1)), report=right[:, None],
        positive=np.full((len(eta), 1), 0.5), cost=cost, reward=-cost,
        ended=np.full(len(eta), ""), steps=np.zeros(len(eta)),
        executed=np.zeros((len(eta), 0), int), failed=np.zeros((len(eta), 0), int),
    )  # fmt: skip
    sd = np.sqrt(sum(sd**2 for name, sd in SPREAD.items() if name != "attribute"))
    points, weights = np.polynomial.hermite_e.hermegauss(40)
    at = 1.0 + draw["attribute"][:, None] + sd * points
    mean = [((1 / (1 + np.exp(-at - x))) @ weights).mean() / weights.sum() for x in (0.0, lead)]
    return outcomes, j, {"success": mean[1] - mean[0], "cost": -SECONDS * lead}


def paired(outcomes: TrialOutcomes, repeats: np.ndarray, measure: str) -> Effect:
    """Estimate the second agent's value less the first's over the repeats."""
    values = measured(outcomes, measure)
    sides = [
        [values[(outcomes.agent == name) & (repeats == j)].mean() for j in range(REPEATS)]
        for name in ("first", "second")
    ]
    return resampled(np.subtract(sides[1], sides[0]), RATIO)


def main() -> None:
    """Measure, and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--simulations", type=int, default=200)
    parser.add_argument("--fits", type=int, help="simulations that the model is fitted to")
    parser.add_argument("--measure", choices=["success", "cost"], help="one of both")
    options = parser.parse_args()
    fits = options.simulations if options.fits is None else options.fits
    warnings.simplefilter("ignore")
    report: dict[str, object] = {}
    for measure in [options.measure] if options.measure else ["success", "cost"]:
        hits, modelled = [], []
        for number in range(max(options.simulations, fits)):
            outcomes, repeats, truth = simulate(stream(number, "compare"), LEAD)
            if number < options.simulations:
                _, _, low, high = paired(outcomes, repeats, measure).interval()
                hits.append(low <= truth[measure] <= high)
            if number < fits:
                (row,) = compare_outcomes(outcomes, measure=measure, repeats=repeats, seed=number)
                modelled.append(row.low <= truth[measure] <= row.high)
        report[f"{measure}: corrected t contains the truth"] = _share(hits)
        report[f"{measure}: the model's interval contains the truth"] = _share(modelled)
    false = []
    for number in range(options.simulations):
        effects = [paired(*simulate(stream(number, "family", k), 0.0)[:2], "success")
                   for k in range(FAMILY)]  # fmt: skip
        levels = np.array([min(one.level_above(0), one.level_below(0)) for one in effects])
        false.append(bool((levels <= holm(levels)).any()))
    report[f"any of {FAMILY} is decided where nothing differs"] = _share(false)
    rows = [{"": name, "cases": text} for name, text in report.items()]
    show(rows, report if options.json else None)


def _share(cases: list[bool]) -> str:
    return f"{np.mean(cases):.1%} of {len(cases)}" if cases else "not run"


if __name__ == "__main__":
    main()
