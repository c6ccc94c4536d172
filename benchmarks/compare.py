"""Do the intervals that compare agents contain the truth in 95 of 100 cases? Simulated outcomes.

Repeats split the same objects into three parts again and again. Outcomes of two agents on the test
part are drawn from a hierarchical model (normal terms for agent, object, attribute and repeat, and
those of agent and object, agent and repeat), as many as in an online run, with spreads that were
fitted to Fig. 10's panels. The truth is the difference over new objects and repeats. An agent's
luck in a repeat is drawn anew in each, or is that of the objects which taught it, which repeats
share, as a sum. Printed: how often the interval of the paired difference (corrected resampled t, at
several ratios) contains the truth; and how often any of the 30 statements of a family is decided
where nothing differs (Holm).

    python benchmarks/compare.py [--json] [--simulations 200] [--measure success]
"""

import argparse
from itertools import product

import numpy as np
from measuring import options_of, show

from meal_bayes.evaluation import resampled
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
SPREAD = {  # standard deviations on the logistic scale
    "object": 0.4,
    "attribute": 0.7,
    "repeat": 0.25,
    "agent object": 0.05,
    "agent repeat": 0.15,
}
LEAD = 0.5  # of the second agent
NOISE = 6.0  # of a cost
SECONDS = 5.0  # a unit of the scale
# An agent's luck in a repeat: in units of what was fitted, and whether the objects taught have it.
# Any two repeats teach two thirds of the same objects, so that a third of such luck shows as spread
# between repeats; the last world has the visible part that was fitted.
WORLDS = {
    "drawn anew": (1.0, False),
    "of the objects taught": (1.0, True),
    "of the objects taught, visible as fitted": (3.0**0.5, True),
}


def simulate(
    rng: np.random.Generator, lead: float, *, luck: float = 1.0, taught: bool = False
) -> tuple[TrialOutcomes, np.ndarray, dict]:
    """Draw an online run's test outcomes, the repeat of each, and the true differences."""
    sizes = {
        "object": OBJECTS,
        "attribute": ATTRIBUTES,
        "repeat": REPEATS,
        "agent object": (AGENTS, OBJECTS),
        "agent repeat": (AGENTS, REPEATS),
    }
    draw = {name: SPREAD[name] * rng.normal(size=size) for name, size in sizes.items()}
    draw["agent repeat"] = luck * draw["agent repeat"]
    splits = np.array([rng.permutation(OBJECTS) for _ in range(REPEATS)])
    tests = splits[:, :TESTED]
    if taught:  # a sum over the objects taught, of the same variance as luck drawn anew
        each = rng.normal(size=(AGENTS, OBJECTS)) / np.sqrt(OBJECTS - TESTED)
        shared = each[:, splits[:, TESTED:]].sum(axis=2)
        draw["agent repeat"] = luck * SPREAD["agent repeat"] * shared
    trials = [
        (a, o, p, j)
        for a in range(AGENTS)
        for j, objects in enumerate(tests)
        for o in objects
        for p in range(ATTRIBUTES)
    ]
    a, o, p, j = np.array(trials).T  # agent, object, attribute, repeat of each trial
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
    gain = true_gain(draw["attribute"], lead, luck)
    return outcomes, j, {"success": gain, "cost": -SECONDS * lead}


def true_gain(attributes: np.ndarray, lead: float, luck: float) -> float:
    """Return the second agent's lead in accuracy over new objects and repeats.

    The attributes stay the same six. All other terms are normal, so that accuracy is the mean of a
    logistic over a normal, by Gauss and Hermite's 40 points.
    """
    spread = {**SPREAD, "agent repeat": luck * SPREAD["agent repeat"]}
    sd = np.sqrt(sum(sd**2 for name, sd in spread.items() if name != "attribute"))
    points, weights = np.polynomial.hermite_e.hermegauss(40)
    at = 1.0 + attributes[:, None] + sd * points
    mean = [((1 / (1 + np.exp(-at - x))) @ weights).mean() / weights.sum() for x in (0.0, lead)]
    return mean[1] - mean[0]


def paired(outcomes: TrialOutcomes, repeats: np.ndarray, measure: str) -> np.ndarray:
    """Return the second agent's mean less the first's in each repeat, (J,)."""
    values = measured(outcomes, measure)
    second = outcomes.agent == "second"
    lead = np.empty(REPEATS)
    for j in range(REPEATS):
        here = repeats == j
        lead[j] = values[here & second].mean() - values[here & ~second].mean()
    return lead


def main() -> None:
    """Measure, and print rows or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--simulations", type=int, default=200)
    parser.add_argument("--measure", choices=["success", "cost"], help="one of both")
    options = parser.parse_args()
    rows = []
    measures = [options.measure] if options.measure else ["success", "cost"]
    for world, measure in product(WORLDS, measures):
        rows += coverage(world, measure, options)
    rows += [false_decisions(world, options.simulations) for world in WORLDS]
    show(rows, rows if options.json else None)


def coverage(world: str, measure: str, options: argparse.Namespace) -> list[dict]:
    """Measure how often intervals contain the truth."""
    luck, taught = WORLDS[world]
    runs = [
        simulate(stream(number, "compare"), LEAD, luck=luck, taught=taught)
        for number in range(options.simulations)
    ]
    truths = [truth[measure] for *_, truth in runs]
    leads = [paired(outcomes, repeats, measure) for outcomes, repeats, _ in runs]
    methods: dict[str, list] = {
        f"corrected t, ratio {ratio:g}": [resampled(x, ratio).interval()[2:] for x in leads]
        for ratio in RATIOS
    }
    rows = []
    for method, intervals in methods.items():
        hits = [low <= truth <= high for truth, (low, high) in zip(truths, intervals, strict=True)]
        width = float(np.mean([high - low for low, high in intervals]))
        what = f"{measure}: the interval contains the truth"
        rows.append(_row(what, world, method, hits, width))
    return rows


def false_decisions(world: str, simulations: int) -> dict:
    """Measure how often Holm's levels decide any statement of a family where nothing differs."""
    luck, taught = WORLDS[world]
    false = []
    for number in range(simulations):
        levels = np.empty(FAMILY)
        for k in range(FAMILY):
            rng = stream(number, "family", k)
            outcomes, repeats, _ = simulate(rng, 0.0, luck=luck, taught=taught)
            lead = resampled(paired(outcomes, repeats, "success"), RATIO)
            levels[k] = min(level_above(lead, 0), level_below(lead, 0))
        false.append(bool((levels <= holm(levels)).any()))
    what = f"any of {FAMILY} is decided where nothing differs"
    return _row(what, world, f"corrected t, ratio {RATIO:g}", false)


def _row(what: str, world: str, method: str, cases: list[bool], width: float | None = None) -> dict:
    return {
        "": what,
        "an agent's luck in a repeat is": world,
        "method": method,
        "fraction": float(np.mean(cases)),
        "of": len(cases),
        "width": width,
    }


if __name__ == "__main__":
    main()
