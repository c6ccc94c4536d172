"""Fig. 7, Sect. 7.2.1: one MORC trial on ISPY32, YELLOW and METALLIC?, by our filter."""

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.arrays import Floats
from meal_bayes.momdp import best_report
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.replay import cost_of, momdp_of, replay
from paper_repro.statements import THEIRS, Evidence, constructed, fact

STEP = 5e-4  # of a probability
ROUNDING = 0.005 + 1e-9  # of what is printed to two decimals
NOTE = """The paper prints no rates: those of look fit the second belief, those of push the third,
so these two are by construction. After them the same two percepts came once more, so that by Eq. 8
each attribute's odds in the fourth are those in the third squared, whatever the rates are. The
third is printed to two decimals: the beliefs that print it lead to {low} to {high}, each entry by
itself; ours are by one choice of rates. The cost: the six behaviors come to {cost:.1f} s,
{free:.1f} s without reinit. Two readings make it the {printed:.0f} s, and nothing printed tells
which one holds: one `ask` of {ask:.0f} s, which is not among the printed steps; or a reinit of 100
s, which is what the published code charges for it on ROC36 (it falls through to the reward of a
wrong report)."""


def run(setting: Setting) -> Result:
    """Replay the trial; beliefs are those of Eq. 8, costs those of the paper's table."""
    paper = paper_values("fig7")
    momdp = momdp_of("ispy32", paper["fitted"])
    beliefs = replay(momdp, paper["steps"])
    report = momdp.action_name(best_report(momdp, beliefs[-1])).removeprefix("report ")
    cost = cost_of(momdp, paper["steps"])
    ask = cost_of(momdp, [{"behavior": "ask"}])
    low, high = twice(paper["steps"][1]["belief"])
    free = cost_of(momdp, [step for step in paper["steps"] if step["behavior"] != "reinit"])
    steps = [{"behavior": "(before)", "belief": paper["first_belief"]}, *paper["steps"]]
    rows: list[tuple[Cell, ...]] = []
    evidence: dict[str, Evidence | None] = {}
    for number, (step, belief) in enumerate(zip(steps, beliefs, strict=True)):
        printed = step.get("belief")
        ours = belief.joint.tolist()
        failed = step["behavior"] != "reinit" and "percept" not in step and number > 0
        name = step["behavior"] + (" (failed)" if failed else "")
        rows.append((name, _vector(printed), _vector(ours)))
        if printed is None:
            continue
        text = f"belief {_vector(printed)} after {name}"
        if number == 0:
            evidence[text] = constructed("the prior is a setting")
        elif number < len(steps) - 1:
            evidence[text] = constructed("the rates were fitted to it")
        else:
            rule = f"the third, its percepts once more: {_vector(low, 3)} to {_vector(high, 3)}"
            inside = (low - ROUNDING <= printed) & (printed <= high + ROUNDING)
            evidence[text] = fact(bool(inside.all()), rule)
    evidence |= {
        f"the MOMDP has {paper['states']} states": constructed(f"it has {momdp.n_states}"),
        f"the report is {paper['report']}": constructed("argmax of the last belief"),
        f"the trial costs {paper['cost']:.0f} s": constructed(
            f"{free:.0f} s of look and push, and 100 s of an `ask` or of reinit"
        ),
        f"its reward is {paper['reward']:.0f}": constructed(
            f"{momdp.correct:.0f} of a right report less the printed cost"
        ),
    }
    title = "belief of (neither, metallic, yellow, both)"
    return Result(
        title="A trial of MORC on ISPY32, a blue-red bottle full of water, YELLOW and METALLIC?",
        sentence=f"The last belief, printed {_vector(steps[-1]['belief'])}, is "
        f"{_vector(beliefs[-1].joint.tolist())} by rates that fit the earlier ones, and the "
        f"report is {report}.",
        tables=(Table(title, ("after", "paper", "ours"), tuple(rows)),),
        evidence={THEIRS: evidence},
        notes=(
            NOTE.format(
                cost=cost,
                free=free,
                ask=ask,
                printed=paper["cost"],
                low=_vector(low, 3),
                high=_vector(high, 3),
            ),
        ),
    )


def twice(printed: ArrayLike) -> tuple[Floats, Floats]:
    """Return the least and the largest belief, entry by entry, that the same percepts lead to.

    `printed` (4,) is the belief of two attributes after them, from an even one, to two decimals.
    """
    # Every belief that is printed so, on a grid of the two probabilities; by Eq. 8 the same
    # percepts once more square the odds of each attribute.
    positive = np.arange(STEP, 1, STEP)  # Pr(yellow), Pr(metallic)
    belief = _joint(positive[:, None], positive)
    prints = (abs(belief - np.asarray(printed)) <= ROUNDING).all(axis=-1)
    odds = positive / (1 - positive)
    after = odds**2 / (1 + odds**2)
    reached = _joint(after[:, None], after)[prints]
    return reached.min(axis=0), reached.max(axis=0)


def _joint(yellow: Floats, metallic: Floats) -> Floats:
    """Return the beliefs (...,4) of (neither, metallic, yellow, both)."""
    neither = (1 - yellow) * (1 - metallic)
    only_metallic = (1 - yellow) * metallic
    only_yellow = yellow * (1 - metallic)
    return np.stack([neither, only_metallic, only_yellow, yellow * metallic], axis=-1)


def _vector(values: ArrayLike | None, digits: int = 2) -> str | None:
    if values is None:
        return None
    return "[" + " ".join(f"{value:.{digits}f}" for value in np.asarray(values)) + "]"
