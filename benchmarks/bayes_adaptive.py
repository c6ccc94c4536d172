"""The exact Bayes-adaptive optimum of tiny learning problems, and what each bonus loses to it.

    python benchmarks/bayes_adaptive.py [--drawn N] [--seed S] [--weights] [--json]
    python benchmarks/bayes_adaptive.py --picture FILE

A robot is asked about one attribute in each of T trials. A trial has each behavior once at most;
its report is worth +r or -r, and then the label is told. Rows are Beta(w, w) a priori for each
truth, but for a behavior whose rows are known. States are counts, so dynamic programming gives the
optimal expected reward of all T trials, and that of a robot that in each trial maximizes reward and
bonus: no sampling. Bonuses are those of the package, by its own functions, with the exact value of
a trial in place of the grid's. What can be gained is the optimum less what is earned without a
bonus; where that is nothing, seconds lost are shown.
"""

import itertools
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from measuring import options_of, show

from meal_bayes.agents.exploration import AHEAD, explained, percept_entropy, prices, rates_ahead
from meal_bayes.arrays import Bools, Floats, Ints


class Problem(NamedTuple):
    """A learning problem of B behaviors.

    Attributes
    ----------
    name : str
        Of the problem.
    trials : int
        T.
    costs : tuple of float
        (B,) s.
    prior : float
        Pr(the attribute is true).
    reward : float
        r of a report, s.
    known : tuple of float | None
        Pr(yes | false) and Pr(yes | true) of the first behavior, if these are known.
    weight : float
        w of all other rows.
    """

    name: str
    trials: int
    costs: tuple[float, ...]
    prior: float = 0.5
    reward: float = 100.0
    known: tuple[float, float] | None = None
    weight: float = 1.0

    @property
    def unknown(self) -> list[int]:
        """Behaviors whose rows are not known, (U,)."""
        return list(range(self.known is not None, len(self.costs)))


PROBLEMS = (
    Problem("two cheap", 8, (2.0, 2.0)),
    Problem("cheap and dear", 8, (2.0, 20.0)),
    Problem("two dear", 8, (30.0, 30.0)),
    Problem("rare attribute", 8, (5.0, 5.0), prior=0.2),
    Problem("three", 4, (2.0, 5.0, 15.0)),
    Problem("beside a weak known one", 12, (2.0, 5.0), known=(0.35, 0.65)),
    Problem("beside a weak known one", 24, (2.0, 5.0), known=(0.35, 0.65)),
    Problem("beside a good known one", 24, (5.0, 2.0), known=(0.1, 0.9)),
    Problem("dear, beside a good known one", 24, (5.0, 20.0), known=(0.2, 0.8)),
    Problem("doubted, beside a known one", 24, (2.0, 5.0), known=(0.3, 0.7), weight=4.0),
    Problem("much doubted, beside a known one", 24, (2.0, 5.0), known=(0.25, 0.75), weight=10.0),
)


def drawn_problem(number: int, seed: int) -> Problem:
    """Draw a problem: two unknown behaviors, or one beside a known one."""
    rng = np.random.default_rng([seed, number])
    costs = np.exp(rng.uniform(0.0, np.log(40.0), 2)).round(1)
    prior = 0.5 if rng.random() < 0.4 else round(float(rng.uniform(0.1, 0.9)), 2)
    problem = Problem(f"drawn {number}", int(rng.integers(4, 8)), tuple(costs.tolist()), prior)
    if number % 3 == 0:
        return problem
    low = round(float(rng.uniform(0.05, 0.45)), 2)
    high = round(1 - low * float(rng.uniform(0.5, 1.5)), 2)
    trials = int(rng.integers(6, 25))
    weight = float(rng.choice([1.0, 2.0, 4.0]))
    return problem._replace(trials=trials, known=(low, high), weight=weight)


ALPHAS = (0.0, 3.0, 10.0, 30.0, 60.0, 100.0)  # of Eq. 11, s a bit
BETAS = (0.0, 1.0, 3.0, 10.0, 30.0)  # of Eq. 11, s a labeled object
BLOCK = 4000  # states whose bonus is computed at a time
LEAST = 1.0  # s that exploring must be able to gain, to be scored


class Layer(NamedTuple):
    """The S states that a trial can begin in.

    Attributes
    ----------
    counts : Ints
        (S,U,2,2) percepts of each unknown behavior, by truth and by no and yes.
    after : Ints
        (S,N,2) number of the next trial's state, by the set of percepts and the truth.
    """

    counts: Ints
    after: Ints


def layers_of(problem: Problem) -> list[Layer]:
    """List the states that can be reached, trial by trial.

    N = 3^B sets of percepts are numbered in base 3, the first behavior lowest: 0 not executed, 1
    no, 2 yes.
    """
    unknown = problem.unknown
    base = problem.trials + 1
    place = base ** np.arange(4 * len(unknown), dtype=np.int64).reshape(len(unknown), 2, 2)
    percepts = np.array(list(itertools.product(range(3), repeat=len(problem.costs))))[:, ::-1]
    step = np.zeros((len(percepts), 2), np.int64)
    for u, behavior in enumerate(unknown):
        for z in range(2):
            step[percepts[:, behavior] == 1 + z] += place[u, :, z]
    layers = []
    states = np.zeros(1, np.int64)  # the counts as digits
    for _ in range(problem.trials):
        ahead = states[:, None, None] + step
        following, after = np.unique(ahead, return_inverse=True)
        counts = states[:, None, None, None] // place % base
        layers.append(Layer(counts, after.reshape(ahead.shape)))
        states = following
    return layers


def mean_rates(problem: Problem, counts: Ints) -> Floats:
    """Return the mean of Pr(yes | truth) of each behavior, (S,B,2)."""
    alpha = counts + problem.weight
    rates = alpha[..., 1] / alpha.sum(axis=-1)
    if problem.known is None:
        return np.asarray(rates)
    known = np.broadcast_to(problem.known, (len(rates), 1, 2))
    return np.concatenate([known, rates], axis=1)


def joint_of(problem: Problem, rates: Floats) -> Floats:
    """Compute Pr(percepts and truth) of every set of percepts, (...,N,2), of rates (...,B,2)."""
    joint = np.broadcast_to([1 - problem.prior, problem.prior], (*rates.shape[:-2], 1, 2))
    for behavior in reversed(range(rates.shape[-2])):  # the last is the highest digit
        yes = rates[..., behavior, :]
        factor = np.stack([np.ones_like(yes), 1 - yes, yes], axis=-2)  # (...,3,2)
        joint = joint[..., :, None, :] * factor[..., None, :, :]
        joint = joint.reshape(*rates.shape[:-2], -1, 2)
    return joint


def reports_of(problem: Problem, joint: Floats) -> Floats:
    """Compute Pr(percepts) times the expected reward of the best report, (...,N)."""
    return np.asarray(problem.reward * np.abs(joint[..., 1] - joint[..., 0]))


def best_plan(value: Floats, mass: Floats, gain: Floats) -> tuple[Floats, Ints]:
    """Return the value of the best plan of a trial (...,), and what it does (...,N), -1 to report.

    Values (...,N) are those of ending with each set of percepts, and are written; masses (...,N)
    are the sets' probabilities, gains (...,B) of executing a behavior.
    """
    choice = np.full(value.shape, -1)
    for node in reversed(range(value.shape[-1])):
        for behavior in range(gain.shape[-1]):
            place = 3**behavior
            if node // place % 3 == 0:
                tried = value[..., node + place] + value[..., node + 2 * place]
                tried = tried + gain[..., behavior] * mass[..., node]
                better = tried > value[..., node] + 1e-9
                value[..., node] = np.where(better, tried, value[..., node])
                choice[..., node] = np.where(better, behavior, choice[..., node])
    return value[..., 0], choice


def trial_value(problem: Problem, rates: Floats) -> Floats:
    """Compute the expected reward of one trial whose rates (...,B,2) are known, (...,)."""
    joint = joint_of(problem, rates)
    gain = np.broadcast_to(-np.array(problem.costs), rates.shape[:-1])
    value, _ = best_plan(reports_of(problem, joint), joint.sum(axis=-1), gain)
    return value


def optimum(problem: Problem) -> tuple[float, list[Ints]]:
    """Compute the optimal expected reward of all trials, and each trial's plans (S,N)."""
    layers = layers_of(problem)
    value = np.zeros(layers[-1].after.max() + 1)
    plans = []
    for layer in reversed(layers):
        joint = joint_of(problem, mean_rates(problem, layer.counts))
        ends = reports_of(problem, joint) + (joint * value[layer.after]).sum(axis=-1)
        gain = np.broadcast_to(-np.array(problem.costs), (len(joint), len(problem.costs)))
        value, choice = best_plan(ends, joint.sum(axis=-1), gain)
        plans.append(choice)
    return float(value[0]), plans[::-1]


Bonus = Callable[[Problem, Ints, int], Floats]  # counts (S,U,2,2) and trials to come; s (S,U)


def earned(problem: Problem, bonus: Bonus) -> float:
    """Compute the expected reward of who maximizes each trial's reward and bonus."""
    layers = layers_of(problem)
    costs = np.array(problem.costs)
    value = np.zeros(layers[-1].after.max() + 1)
    for t, layer in reversed(list(enumerate(layers))):
        joint = joint_of(problem, mean_rates(problem, layer.counts))
        mass = joint.sum(axis=-1)
        paid = np.zeros((len(joint), len(costs)))
        for start in range(0, len(joint), BLOCK):
            block = slice(start, start + BLOCK)
            to_come = problem.trials - t - 1
            paid[block, problem.unknown] = bonus(problem, layer.counts[block], to_come)
        _, choice = best_plan(reports_of(problem, joint), mass, paid - costs)
        gets = reports_of(problem, joint) + (joint * value[layer.after]).sum(axis=-1)
        for node in reversed(range(gets.shape[1])):
            for behavior in range(len(costs)):
                place = 3**behavior
                if node // place % 3 == 0:
                    tried = gets[:, node + place] + gets[:, node + 2 * place]
                    tried = tried - costs[behavior] * mass[:, node]
                    chosen = choice[:, node] == behavior
                    gets[:, node] = np.where(chosen, tried, gets[:, node])
        value = gets[:, 0]
    return float(value[0])


def no_bonus(problem: Problem, counts: Ints, to_come: int) -> Floats:
    """Pay nothing."""
    return np.zeros(counts.shape[:2])


def learning(problem: Problem, counts: Ints, to_come: int) -> Floats:
    """Pay the price of one labeled object, as `LearningBonus` does."""
    alpha = counts + problem.weight
    gain = gains(problem, counts, rates_ahead(alpha))
    known = explained(alpha, np.full((len(counts), 1), problem.prior))
    left = np.maximum(to_come + 1 - AHEAD, 0.0)
    return prices(gain, known, left, np.array(problem.costs)[problem.unknown])


def equation_11(
    problem: Problem, counts: Ints, to_come: int, *, alpha: float, beta: float
) -> Floats:
    """Pay alpha a bit of a percept's entropy, less beta a labeled object: weights of a person."""
    entropy = percept_entropy(counts + problem.weight, np.array([problem.prior]))
    return np.asarray(alpha * entropy - beta * counts.sum(axis=(-2, -1)))


def gains(problem: Problem, counts: Ints, ahead: Floats) -> Floats:
    """Compute what a trial gains by one behavior's rates ahead (S,U,Z,2), (S,U,Z)."""
    rates = mean_rates(problem, counts)
    base = trial_value(problem, rates)
    gain = np.empty(ahead.shape[:-1])
    for u, behavior in enumerate(problem.unknown):
        other = np.repeat(rates[:, None], ahead.shape[2], axis=1)  # (S,Z,B,2)
        other[:, :, behavior] = ahead[:, u]
        gain[:, u] = trial_value(problem, other) - base[:, None]
    return gain


BONUSES: dict[str, Bonus] = {"LearningBonus": learning}


def score(problem: Problem, *, weights: bool = False) -> dict[str, object]:
    """Score every bonus on a problem: share of what can be gained, or seconds lost."""
    best, _ = optimum(problem)
    nothing = earned(problem, no_bonus)
    can = best - nothing
    row: dict[str, object] = {
        "problem": problem.name,
        "trials": problem.trials,
        "costs": problem.costs,
        "prior": problem.prior,
        "known": problem.known,
        "weight": problem.weight,
        "optimum": best,
        "can be gained": can,
    }
    values = {name: earned(problem, bonus) for name, bonus in BONUSES.items()}
    if weights:
        pairs = itertools.product(ALPHAS, BETAS)
        by_hand = sorted(earned(problem, partial(equation_11, alpha=a, beta=b)) for a, b in pairs)
        values["Eq. 11, best of 30 weights"] = by_hand[-1]
        values["Eq. 11, median"] = by_hand[len(by_hand) // 2]
    for name, value in values.items():
        row[name] = (value - nothing) / can if can >= LEAST else value - best
    return row


def summed_up(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """Return mean and worst share, and the most seconds lost where nothing can be gained."""
    names = [name for name in rows[0] if name in BONUSES or name.startswith("Eq. 11")]
    scored = [row for row in rows if float(row["can be gained"]) >= LEAST]
    rest = [row for row in rows if float(row["can be gained"]) < LEAST]
    return [
        {
            "bonus": name,
            "share, mean": float(np.mean([row[name] for row in scored])),
            "share, worst": min((float(row[name]) for row in scored), default=float("nan")),
            "s lost, worst": -min((float(row[name]) for row in rest), default=0.0),
            "problems": f"{len(scored)} + {len(rest)}",
        }
        for name in names
    ]


def executes(plans: Ints, behavior: int) -> Bools:
    """Return whether plans (S,N) may come to a behavior, (S,)."""
    reached = np.zeros(plans.shape, np.bool_)
    reached[:, 0] = True
    for node in range(plans.shape[1]):
        for first in range(int(np.log(plans.shape[1]) / np.log(3) + 0.5)):
            goes = reached[:, node] & (plans[:, node] == first)
            for z in (1, 2):
                if node // 3**first % 3 == 0:
                    reached[:, node + z * 3**first] |= goes
    return (reached & (plans == behavior)).any(axis=1)


def draw(path: Path, problem: Problem, trial: int) -> float:
    """Draw what the optimum does in one trial, by what was learned of the second behavior.

    Returns the fraction of states in which `LearningBonus` does the same.
    """
    import matplotlib.pyplot as plt  # noqa: PLC0415  the rest does without

    layer = layers_of(problem)[trial]
    _, plans = optimum(problem)
    joint = joint_of(problem, mean_rates(problem, layer.counts))
    paid = np.zeros((len(joint), len(problem.costs)))
    paid[:, problem.unknown] = learning(problem, layer.counts, problem.trials - trial - 1)
    mass = joint.sum(axis=-1)
    _, ours = best_plan(reports_of(problem, joint), mass, paid - np.array(problem.costs))
    rates = mean_rates(problem, layer.counts)[:, 1]
    objects = layer.counts.sum(axis=(1, 2, 3))
    youden = rates[:, 1] - rates[:, 0]
    panels = {"exact optimum": executes(plans[trial], 1), "LearningBonus": executes(ours, 1)}
    same, different = panels.values()
    share = float((same == different).mean())
    figure, axes = plt.subplots(1, 2, figsize=(9, 4.0), sharey=True, layout="constrained")
    shift = {True: 0.15, False: -0.15}
    for axis, (title, tries) in zip(axes, panels.items(), strict=True):
        for tried, color, label in (
            (False, "0.7", "does not try it"),
            (True, "tab:blue", "tries it"),
        ):
            rows = tries == tried
            place = objects[rows] + shift[tried]
            axis.scatter(place, youden[rows], s=10, color=color, label=label)
        axis.set_title(title)
    axes[0].set_ylabel("posterior mean of\nPr(yes | true) - Pr(yes | false)")
    figure.supxlabel("labeled objects that the behavior was tried on, number", fontsize="medium")
    figure.suptitle(
        f"LearningBonus decides as the exact optimum in {100 * share:.0f} % of states",
        x=0.01,
        ha="left",
        weight="bold",
    )
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", markerscale=2)
    figure.savefig(path, dpi=110)
    return share


def main() -> None:
    """Score, and print a table or JSON; or draw."""
    parser = options_of(__doc__)
    parser.add_argument("--drawn", type=int, default=0, help="problems, in place of the named ones")
    parser.add_argument("--seed", type=int, default=0, help="of the drawn ones")
    parser.add_argument("--weights", action="store_true", help="Eq. 11 by 30 pairs of weights, too")
    parser.add_argument("--picture", type=Path, help="file of a picture of two behaviors, alone")
    options = parser.parse_args()
    if options.picture:
        same = draw(options.picture, PROBLEMS[6], 8)
        print(f"{options.picture}: the same in {100 * same:.1f} % of states")
        return
    problems = [drawn_problem(number, options.seed) for number in range(options.drawn)] or PROBLEMS
    rows = [score(problem, weights=options.weights) for problem in problems]
    if not options.json:
        show(rows)
    show(summed_up(rows), {"problems": rows} if options.json else None)


if __name__ == "__main__":
    main()
