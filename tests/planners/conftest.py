"""Small problems, and an exact solution of them that shares no code with the planners."""

import math
from collections.abc import Callable, Iterator, Mapping
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import ArrayLike
from planner_models import load_reference

from meal_bayes.domain import Domain, Query, load_domain
from meal_bayes.momdp import MOMDP, Belief, Transition, build_momdp, initial_belief, update_belief
from meal_bayes.momdp.belief import belief_of
from meal_bayes.planners import POMCP, Decision, History, Policy
from meal_bayes.planners.plans.values import plan_values

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


def split(classes: np.ndarray) -> np.ndarray:
    """Split J classes by truth: Pr(class | truth) (N,2,J) -> (N,2,2J)."""
    none = np.zeros_like(classes[:, 0])
    return np.stack([np.hstack([classes[:, 0], none]), np.hstack([none, classes[:, 1]])], axis=1)


def random_classes(n: int, own_classes: int, shared: int, rng: np.random.Generator) -> np.ndarray:
    """Draw Pr(class | truth): so many classes of each truth, or so many that both share."""
    classes = rng.dirichlet(np.ones(shared or own_classes), (n, 2))
    return classes if shared else split(classes)


def random_toy(
    seed: int,
    n: int,
    levels: int,
    *,
    finite: bool,
    mistaken: ArrayLike | None = None,
    own_classes: int = 1,
    shared: int = 0,
    **options: object,
) -> MOMDP:
    """Build a `toy` problem with random rows (and precisions).

    Objects are of so many random classes of each truth, or that both share; or of two of each, of
    which one, a fraction `mistaken` of the objects, follows the other truth's rows.
    """
    rng = np.random.default_rng(seed)
    domain = load_domain("toy")
    c = shared or 2 * own_classes
    confusion = rng.dirichlet(np.ones(levels), (n, 3, c))
    precision = rng.uniform(0.5, 20.0, (n, 3, c)) if finite else np.inf
    prior = rng.uniform(0.2, 0.8, n)
    classes = random_classes(n, own_classes, shared, rng)
    if mistaken is not None:
        confusion = confusion[:, :, [0, 1, 1, 0]]
        precision = precision[:, :, [0, 1, 1, 0]] if finite else np.inf
        error = np.broadcast_to(mistaken, (n,))[:, None]
        classes = split(np.stack([1 - error, error], axis=2).repeat(2, axis=1))
    options |= {"prior": prior, "latent_classes": classes}
    return build_momdp(domain, Query(domain.attributes[:n]), confusion, precision, **options)


def random_momdp(
    name: str,
    n: int,
    levels: int,
    rng: np.random.Generator,
    *,
    own_classes: int = 1,
    shared: int = 0,
    precision: float = np.inf,
    **options: object,
) -> MOMDP:
    """Build a problem of a domain with random rows, of classes as in `random_classes`."""
    domain = load_domain(name)
    shape = n, len(domain.behaviors), shared or 2 * own_classes
    confusion = rng.dirichlet(np.ones(levels), shape)
    query = Query(domain.attributes[:n])
    classes = random_classes(n, own_classes, shared, rng)
    return build_momdp(domain, query, confusion, precision, latent_classes=classes, **options)


def ispy32_of(n: int, rate: tuple[float, float] = (0.9, 0.1), **options: object) -> MOMDP:
    """Build a query of n attributes of ISPY32, all behaviors alike."""
    domain = load_domain("ispy32")
    row = [[1 - rate[1], rate[1]], [1 - rate[0], rate[0]]]
    confusion = np.tile(row, (n, len(domain.behaviors), 1, 1))
    return build_momdp(domain, Query(domain.attributes[:n]), confusion, **options)


class Expectimax:
    """The optimum of a MOMDP with few percepts (finite `limit`), by plain recursion.

    Failures are folded as a geometric series. Behaviors that could not be perceived any more are
    left out: in the problems used here they lead nowhere.
    """

    def __init__(self, momdp: MOMDP) -> None:
        self.momdp = momdp
        self.known: dict[tuple[int, Counts], float] = {}  # of the states met so far

    def nothing_seen(self) -> Counts:
        """Counts at the start."""
        n = len(self.momdp.query)
        e = self.momdp.n_behaviors
        k = self.momdp.levels
        return (((0,) * k,) * e,) * n

    def positive(self, seen: Counts) -> list[float]:
        """Pr(attribute is true) given the percepts, from the definition."""
        both = (self._joint(i, counts) for i, counts in enumerate(seen))
        return [sum(true) / (sum(false) + sum(true)) for false, true in both]

    def _joint(self, i: int, seen: tuple[tuple[int, ...], ...]) -> list[list[float]]:
        """Pr(is v, of class c, percepts), [v][c]."""
        prior = float(self.momdp.prior[i])
        classes = self.momdp.latent_classes[i].tolist()
        return [
            [p * share * self._likelihood(i, c, seen) for c, share in enumerate(classes[v])]
            for v, p in enumerate((1 - prior, prior))
        ]

    def _likelihood(self, i: int, latent_class: int, seen: tuple[tuple[int, ...], ...]) -> float:
        out = 1.0
        for e, counts in enumerate(seen):
            row = self.momdp.confusion[i, e, latent_class].tolist()
            s = float(self.momdp.precision[i, e, latent_class])
            if math.isinf(s):
                out *= math.prod(c**n for c, n in zip(row, counts, strict=True))
            else:
                both = zip(row, counts, strict=True)
                out *= math.prod(s * c + j for c, n in both for j in range(n))
                out /= math.prod(s + j for j in range(sum(counts)))
        return out

    def stop(self, x: int, seen: Counts) -> float:
        """Value of ending now: best report, or abstaining."""
        m = self.momdp
        if m.query.event is not None:
            return max(*self._yes_and_no(seen), 0.0 if m.abstain else -math.inf)
        right = math.prod(max(b, 1 - b) for b in self.positive(seen))
        value = m.incorrect + (m.correct - m.incorrect) * right
        return max(value, 0.0) if m.abstain else value

    def _yes_and_no(self, seen: Counts) -> list[float]:
        """Expected rewards of yes and no, by all value vectors one by one."""
        m = self.momdp
        event = self.momdp.query.event
        four = m.payoffs or (m.correct, m.incorrect, m.correct, m.incorrect)
        positive = self.positive(seen)
        out = [0.0, 0.0]
        for truth in np.ndindex(*(2,) * len(positive)):
            p = math.prod(b if v else 1 - b for b, v in zip(positive, truth, strict=True))
            holds = (list(truth) == list(event.allowed)) != event.complement
            out[0] += p * (four[0] if holds else four[1])
            out[1] += p * (four[3] if holds else four[2])
        return out

    def value(self, x: int, seen: Counts) -> float:
        """Optimal value."""
        if (x, seen) not in self.known:
            best = self.stop(x, seen)
            for e in self.choices(x, seen):
                best = max(best, self.edge(x, seen, e, self.value))
            self.known[x, seen] = best
        return self.known[x, seen]

    def choices(self, x: int, seen: Counts) -> Iterator[int]:
        """Legal behaviors that are of any use."""
        m = self.momdp
        for e in range(m.n_behaviors):
            senses = m.observation_probability[e].any()
            if m.legal[x, e] and not (senses and sum(seen[0][e]) >= m.limit[e]):
                yield e

    def edge(self, x: int, seen: Counts, e: int, value: Callable[[int, Counts], float]) -> float:
        """Value of a behavior, repeated until something comes of it."""
        m = self.momdp
        idle = 0.0
        total = 0.0
        left = sum(seen[0][e]) < m.limit[e]
        for target, p in enumerate(m.transition[e, x].tolist()):
            felt = p * float(m.observation_probability[e, x, target]) * left
            silent = p - felt
            if target == x:
                idle = silent
                silent = 0.0
            if silent > 1e-12:
                total += silent * value(target, seen)
            if felt > 1e-12:
                for q, after in self.percepts(seen, e):
                    total += felt * q * value(target, after)
        if idle > 1 - 1e-12:  # nothing can come of it
            return -math.inf
        comes = float((m.transition[e, x] * m.observation_probability[e, x]).sum())
        reward = -float(m.cost[e]) + comes * self._bonus(seen, e)
        return (reward + m.discount * total) / (1 - m.discount * idle)

    def _bonus(self, seen: Counts, e: int) -> float:
        """Pay for a percept, at the belief before it."""
        m = self.momdp
        if sum(seen[0][e]) >= min(m.limit[e], m.bonus_limit[e]):
            return 0.0
        both = zip(self.positive(seen), m.bonus[:, e].tolist(), strict=True)
        return sum((1 - b) * no + b * yes for b, (no, yes) in both)

    def percepts(self, seen: Counts, e: int) -> Iterator[tuple[float, Counts]]:
        """All percept vectors of a behavior: probability, counts afterwards."""
        n = len(self.momdp.query)
        k = self.momdp.levels
        mass = [sum(map(sum, self._joint(i, seen[i]))) for i in range(n)]
        for levels in np.ndindex(*(k,) * n):
            p = 1.0
            after = []
            for i, z in enumerate(levels):
                counts = seen[i][e]
                more = (*counts[:z], counts[z] + 1, *counts[z + 1 :])
                after.append((*seen[i][:e], more, *seen[i][e + 1 :]))
                p *= sum(map(sum, self._joint(i, after[-1]))) / mass[i]
            yield p, tuple(after)

    def of_policy(self, policy: Policy, seed: int) -> float:
        """Exact value of a policy that decides by belief, each decision with a fresh generator.

        A policy that goes round without percepts never ends, and is worth -inf here.
        """
        known: dict[tuple[int, Counts], float] = {}

        def value(x: int, seen: Counts) -> float:
            if (x, seen) not in known:
                known[x, seen] = -math.inf  # as long as it is being computed
                rng = np.random.default_rng(seed)
                action = policy.decide(History(self.belief(x, seen)), rng).action
                if action >= self.momdp.n_behaviors:
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
    """Load a model of the planner reference, A1 to A5."""
    return load_reference()[f"A{n}"]


def believing(momdp: MOMDP, log_odds: ArrayLike, x: int = 0) -> Belief:
    """Build the belief after an answer of these log-likelihood ratios, without percepts.

    Where truths share no class these are its log-odds, whatever the prior.
    """
    odds = np.asarray(log_odds, dtype=float)
    truth = -np.logaddexp(0.0, np.stack([odds, -odds], axis=1))  # (N,2)
    with np.errstate(divide="ignore"):
        log_prob = np.logaddexp.reduce(truth[:, :, None] + np.log(momdp.latent_classes), axis=1)
    return belief_of(momdp, x, log_prob, initial_belief(momdp).percept_counts)


def search(
    momdp: MOMDP,
    simulations: int,
    seed: int = 0,
    *,
    history: History | None = None,
    always: bool = False,
    capacity: int = 500_000,
    **options: object,
) -> Decision:
    """Decide once, at the start by default; `always` by search, even if nothing is to decide."""
    rng = np.random.default_rng(seed)
    policy = POMCP(simulations=simulations, capacity=capacity, **options).solve(momdp, rng)
    history = history or History(initial_belief(momdp))
    if always:
        evaluator = plan_values(policy.model, policy.plans, history.belief)
        return policy._search(None, history.belief, evaluator, rng)
    return policy.decide(history, rng)


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
        ispy32=ispy32_of,
        random=random_momdp,
        expectimax=Expectimax,
        believing=believing,
        weights=lambda momdp, log_odds: np.exp(believing(momdp, log_odds).log_prob),
        search=search,
        best_value=lambda decision: float(np.nanmax(decision.values + decision.bonus)),
        start=lambda momdp: History(initial_belief(momdp)),
    )
