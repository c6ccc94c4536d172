"""Small problems, and an exact solution of them that shares no code with the planners."""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import ArrayLike

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram, load_domain
from meal_bayes.momdp import (
    MOMDP,
    Belief,
    Transition,
    build_momdp,
    initial_belief,
    report_value,
    update_belief,
)
from meal_bayes.planners import History, Policy

Rates = Mapping[str, Mapping[str, tuple[float, float]]]  # attribute -> behavior -> (TPR, FPR)
Counts = tuple[tuple[tuple[int, ...], ...], ...]  # (N,E,K) percepts so far
TOY_RATES: Rates = {
    "red": {"look": (0.8, 0.25), "lift": (0.6, 0.45)},
    "heavy": {"look": (0.55, 0.4), "lift": (0.9, 0.2)},
}


def momdp_of(
    domain: Domain | str, rates: Rates, precision: ArrayLike = np.inf, **options: object
) -> MOMDP:
    """Build the MOMDP of yes/no percepts with these rates; what is not named tells nothing."""
    if isinstance(domain, str):
        domain = load_domain(domain)
    confusion = np.full((len(rates), len(domain.behaviors), 2, 2), 0.5)
    for i, behaviors in enumerate(rates.values()):
        for name, (tpr, fpr) in behaviors.items():
            confusion[i, domain.behavior_index(name)] = [[1 - fpr, fpr], [1 - tpr, tpr]]
    return build_momdp(domain, Query(tuple(rates)), confusion, precision, **options)


def random_toy(seed: int, n: int, levels: int, *, finite: bool, **options: object) -> MOMDP:
    """Build a `toy` problem with random rows (and precisions)."""
    rng, domain = np.random.default_rng(seed), load_domain("toy")
    confusion = rng.dirichlet(np.ones(levels), (n, 3, 2))
    precision = rng.uniform(0.5, 20.0, (n, 3, 2)) if finite else np.inf
    prior = rng.uniform(0.2, 0.8, n)
    query = Query(domain.attributes[:n])
    return build_momdp(domain, query, confusion, precision, prior=prior, **options)


class Expectimax:
    """The optimum of a MOMDP with few percepts (finite `limit`), by plain recursion.

    Failures are folded as a geometric series. Behaviors that could not be perceived any more are
    left out: in the problems used here they lead nowhere.
    """

    def __init__(self, momdp: MOMDP) -> None:
        self.momdp = momdp
        self._known: dict[tuple[int, Counts], float] = {}

    def nothing_seen(self) -> Counts:
        """Counts at the start."""
        n, e, k = len(self.momdp.query), self.momdp.n_behaviors, self.momdp.levels
        return (((0,) * k,) * e,) * n

    def positive(self, seen: Counts) -> list[float]:
        """Pr(attribute is true) given the percepts, from the definition."""
        out = []
        for i in range(len(seen)):
            joint = self._joint(i, seen[i])
            out.append((joint[1][0] + joint[1][1]) / (sum(joint[0]) + sum(joint[1])))
        return out

    def _joint(self, i: int, seen: tuple[tuple[int, ...], ...]) -> list[list[float]]:
        """Pr(is v, seems w, percepts), [v][w]; a person's answers tell of v, all else of w."""
        prior, share = float(self.momdp.prior[i]), float(self.momdp.misperception[i])
        joint = [
            [(1 - prior) * (1 - share), (1 - prior) * share],
            [prior * share, prior * (1 - share)],
        ]
        for e, counts in enumerate(seen):
            for v in range(2):
                for w in range(2):
                    value = v if self.momdp.direct[e] else w
                    joint[v][w] *= self._likelihood(i, e, value, counts)
        return joint

    def _likelihood(self, i: int, e: int, v: int, counts: tuple[int, ...]) -> float:
        row, s = self.momdp.confusion[i, e, v].tolist(), float(self.momdp.precision[i, e, v])
        if math.isinf(s):
            return math.prod(c**n for c, n in zip(row, counts, strict=True))
        top = math.prod(s * c + j for c, n in zip(row, counts, strict=True) for j in range(n))
        return top / math.prod(s + j for j in range(sum(counts)))

    def stop(self, x: int, seen: Counts) -> float:
        """Value of ending now: best report, or the cheapest illegal behavior."""
        m = self.momdp
        right = math.prod(max(b, 1 - b) for b in self.positive(seen))
        value = m.incorrect + (m.correct - m.incorrect) * right
        ends = [m.cost[e] for e in range(m.n_behaviors) if self._ends(x, e)]
        return max(value, -min(ends)) if m.abstain and ends else value

    def _ends(self, x: int, e: int) -> bool:
        return not self.momdp.legal[x, e] and self.momdp.transition[e, x, -1] == 1

    def value(self, x: int, seen: Counts) -> float:
        """Optimal value."""
        if (x, seen) not in self._known:
            best = self.stop(x, seen)
            for e in self.choices(x, seen):
                best = max(best, self.edge(x, seen, e, self.value))
            self._known[x, seen] = best
        return self._known[x, seen]

    def reached(self) -> list[tuple[int, Counts]]:
        """All states met so far."""
        return list(self._known)

    def choices(self, x: int, seen: Counts) -> Iterator[int]:
        """Legal behaviors that are of any use."""
        m = self.momdp
        for e in range(m.n_behaviors):
            senses = m.informative[e].any()
            if m.legal[x, e] and not (senses and sum(seen[0][e]) >= m.limit[e]):
                yield e

    def edge(self, x: int, seen: Counts, e: int, value: Callable[[int, Counts], float]) -> float:
        """Value of a behavior, repeated until something comes of it."""
        m, idle, total = self.momdp, 0.0, 0.0
        for target, p in enumerate(m.transition[e, x].tolist()):
            felt = p * float(m.informative[e, x, target])
            silent = p - felt
            if target == x:
                idle, silent = silent, 0.0
            if silent > 1e-12:
                total += silent * value(target, seen)
            if felt > 1e-12:
                for q, after in self.percepts(seen, e):
                    total += felt * q * value(target, after)
        reward = -float(m.cost[e]) + self._bonus(seen, e)
        return (reward + m.discount * total) / (1 - m.discount * idle)

    def _bonus(self, seen: Counts, e: int) -> float:
        m = self.momdp
        if sum(seen[0][e]) >= m.limit[e]:
            return 0.0
        both = zip(self.positive(seen), m.bonus[:, e].tolist(), strict=True)
        return sum((1 - b) * no + b * yes for b, (no, yes) in both)

    def percepts(self, seen: Counts, e: int) -> Iterator[tuple[float, Counts]]:
        """All percept vectors of a behavior: probability, counts afterwards."""
        n, k = len(self.momdp.query), self.momdp.levels
        mass = [sum(map(sum, self._joint(i, seen[i]))) for i in range(n)]
        for levels in np.ndindex(*(k,) * n):
            p, after = 1.0, []
            for i, z in enumerate(levels):
                counts = seen[i][e]
                more = (*counts[:z], counts[z] + 1, *counts[z + 1 :])
                after.append((*seen[i][:e], more, *seen[i][e + 1 :]))
                p *= sum(map(sum, self._joint(i, after[-1]))) / mass[i]
            yield p, tuple(after)

    def of_policy(self, policy: Policy, seed: int) -> float:
        """Exact value of a policy that decides by belief, each decision with a fresh generator."""
        known: dict[tuple[int, Counts], float] = {}

        def value(x: int, seen: Counts) -> float:
            if (x, seen) not in known:
                rng = np.random.default_rng(seed)
                action = policy.decide(History(self.belief(x, seen)), rng).action
                if action >= self.momdp.n_behaviors or self._ends(x, action):
                    known[x, seen] = self.stop(x, seen)
                else:
                    known[x, seen] = self.edge(x, seen, action, value)
            return known[x, seen]

        return value(self.momdp.start, self.nothing_seen())

    def belief(self, x: int, seen: Counts) -> Belief:
        """Give the belief as planners get it: by the filter, one percept after the other."""
        belief = initial_belief(self.momdp)
        for e in range(self.momdp.n_behaviors):
            orders = [[z for z, k in enumerate(row[e]) for _ in range(k)] for row in seen]
            for percept in zip(*orders, strict=True):
                belief = update_belief(belief, self.momdp, Transition(e, x, np.array(percept)))
        return belief.at(x)


def noisy_roc36(n: int) -> MOMDP:
    """Build models A1 to A3 of the planner reference: five x, loops that never fail, look .95."""
    text = Path(__file__).with_name("noisy_roc36.json").read_text(encoding="utf-8")
    table = json.loads(text)
    rows = table["behaviors"]
    domain = Domain(
        name="noisy_roc36",
        attributes=tuple(table["attributes"]),
        behaviors=tuple(
            Behavior(row["name"], row["cost"], ("felt",) if "tpr" in row else ()) for row in rows
        ),
        diagram=TransitionDiagram(
            states=("x0", "x1", "x2", "x3", "x4", "term"),
            start="x0",
            effects=tuple(
                Effect(row["from"], row["name"], row["to"], row["success"]) for row in rows
            ),
        ),
    )
    rates = {
        attribute: {row["name"]: (row["tpr"][i], row["fpr"][i]) for row in rows if "tpr" in row}
        for i, attribute in enumerate(domain.attributes[:n])
    }
    return momdp_of(domain, rates, abstain=True)


def returns(momdp: MOMDP, policy: Policy, trials: int, seed: int) -> np.ndarray:
    """Discounted returns in the model, the last reward replaced by its expectation."""
    rng, out = np.random.default_rng(seed), np.zeros(trials)
    for trial in range(trials):
        truth = (rng.random(len(momdp.query)) < momdp.prior).astype(int)
        belief, discount = initial_belief(momdp), 1.0
        for step in range(101):
            action = policy.decide(History(belief), rng).action if step < 100 else -1
            if action < 0 or action >= momdp.n_behaviors:
                out[trial] += discount * report_value(momdp, belief)
                break
            out[trial] -= discount * momdp.cost[action]
            discount *= momdp.discount
            x = int(rng.choice(len(momdp.x_names), p=momdp.transition[action, belief.x]))
            if x == momdp.terminal:
                break
            percept = None
            if rng.random() < momdp.informative[action, belief.x, x]:
                rows = momdp.confusion[np.arange(len(truth)), action, truth]
                percept = np.array([rng.choice(momdp.levels, p=row) for row in rows])
            belief = update_belief(belief, momdp, Transition(action, x, percept))
    return out


@pytest.fixture(scope="session")
def toy() -> MOMDP:
    """Two attributes, few percepts: small enough for brute force."""
    return momdp_of("toy", TOY_RATES, limit=3)


@pytest.fixture(scope="session")
def small() -> SimpleNamespace:
    """The makers of small problems, and their exact solution."""
    return SimpleNamespace(
        momdp=momdp_of,
        toy=random_toy,
        rates=TOY_RATES,
        noisy_roc36=noisy_roc36,
        expectimax=Expectimax,
        returns=returns,
        start=lambda momdp: History(initial_belief(momdp)),
    )
