"""Compare searches for one of a few objects, which must be put down, with the optimum.

    python benchmarks/find_exact.py --problems 60 --objects 2 --seed 1

Small random problems, each solved exactly: an object has three states, in the last one or two of
which it is held, at most `--percepts` behaviors that tell something, once each, and success below
1. The joint problem of all objects, of which a held one must be put down before another is taken,
is solved by value iteration, and the same iteration values two ways to search:

- find: `meal_bayes.planners.best_move`, on exact values of each object;
- turn: each object in turn, by its own optimal plan, until one is claimed.

A right claim earns 500, a wrong one -500, none of them 0. What a search loses is of these units.
"""

import argparse
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from meal_bayes.planners import Hand, Prospect, best_move

REWARD = 500.0
STATES = 3
OUTSIDE = REWARD * np.linspace(0.0, 1.0, 17) ** 2
SETTLED = 1e-6


@dataclass(frozen=True)
class Behavior:
    """One behavior: from a state to another, at a cost, s; a failure changes nothing."""

    source: int
    target: int
    cost: float
    success: float
    rates: tuple[float, float] | None  # Pr(yes | false), Pr(yes | true); None: no percept


@dataclass(frozen=True)
class Chain:
    """All that can become of an object: S places, of a state and the percepts so far."""

    state: np.ndarray  # (S,)
    claim: np.ndarray  # (S,) expected reward of claiming it
    move: np.ndarray  # (E,S,S) Pr(next place); a row of zeros where it is not legal
    cost: np.ndarray  # (E,)
    put_down: np.ndarray  # (S,) s
    way: np.ndarray  # (S,) the behavior by which putting down begins; -1 where it can be left

    @property
    def legal(self) -> np.ndarray:
        """Whether a behavior can be executed, (E,S)."""
        return self.move.any(axis=2)


def drawn(rng: np.random.Generator, percepts: int, scale: float) -> list[Behavior]:
    """Draw behaviors: one from each state to the next, some that stay, and putting down."""

    def behavior(source: int, target: int, success: list[float], telling: float) -> Behavior:
        cost = scale * float(rng.lognormal(1.1, 0.85))
        rates = None
        if rng.random() < telling:
            apart = rng.beta(2.0, 1.5)
            middle = rng.uniform(0.15, 0.85)
            rates = max(0.03, middle * (1 - apart)), min(0.97, middle + apart * (1 - middle))
        return Behavior(source, target, cost, float(rng.choice(success)), rates)

    behaviors = [behavior(*two, [1.0, 0.95, 0.9, 0.8], 0.8) for two in pairwise(range(STATES))]
    behaviors += [behavior(x, x, [1.0, 0.95], 1.0) for x in range(STATES) if rng.random() < 0.6]
    behaviors.append(behavior(STATES - 1, 0, [1.0], 0.0))
    telling = [each for each in behaviors if each.rates is not None]
    best = sorted(telling, key=lambda each: each.rates[0] - each.rates[1])[:percepts]
    return [
        each if each in best else Behavior(each.source, each.target, each.cost, each.success, None)
        for each in behaviors
    ]


def chain_of(behaviors: list[Behavior], prior: float, held_from: int) -> Chain:
    """List the places of an object that is held from a state on."""
    start = (0, (None,) * len(behaviors))
    places = {start: 0}
    moves = []
    waiting = [start]
    while waiting:
        place = state, seen = waiting.pop()
        for e, each in enumerate(behaviors):
            if each.source != state:
                continue
            outcomes = [((each.target, seen), each.success)]
            if each.rates is not None and seen[e] is None:
                true = probability(behaviors, prior, seen)
                yes = (1 - true) * each.rates[0] + true * each.rates[1]
                outcomes = [
                    ((each.target, (*seen[:e], level, *seen[e + 1 :])), each.success * p)
                    for level, p in ((False, 1 - yes), (True, yes))
                ]
            for after, p in [*outcomes, (place, 1 - each.success)]:
                if after not in places:
                    places[after] = len(places)
                    waiting.append(after)
                moves.append((e, places[place], places[after], p))
    move = np.zeros((len(behaviors), len(places), len(places)))
    for e, source, target, p in moves:
        move[e, source, target] += p
    back = np.where(np.arange(STATES) < held_from, 0.0, np.inf)
    first = np.full(STATES, -1)
    for _ in range(STATES):
        for e, each in enumerate(behaviors):
            cost = each.cost / each.success + back[each.target]
            if cost < back[each.source]:
                back[each.source] = cost
                first[each.source] = e
    state = np.array([place[0] for place in places])
    true = np.array([probability(behaviors, prior, place[1]) for place in places])
    return Chain(
        state=state,
        claim=REWARD * (2 * true - 1),
        move=move,
        cost=np.array([each.cost for each in behaviors]),
        put_down=back[state],
        way=first[state],
    )


def probability(behaviors: list[Behavior], prior: float, seen: tuple) -> float:
    """Compute Pr(it is the one) after what was seen by each behavior."""
    odds = prior / (1 - prior)
    for each, level in zip(behaviors, seen, strict=True):
        if level is not None:
            false, true = each.rates
            odds *= true / false if level else (1 - true) / (1 - false)
    return odds / (1 + odds)


def explored(chain: Chain, outside: np.ndarray) -> np.ndarray:
    """Compute the values (L,E,S) of the behaviors of an object that can be left for so much."""
    stop = np.maximum(chain.claim, np.maximum(outside[:, None] - chain.put_down, 0.0))  # (L,S)
    value = stop
    while True:
        after = np.einsum("est,lt->les", chain.move, value) - chain.cost[:, None]
        values = np.where(chain.legal, after, -np.inf)
        new = np.maximum(stop, values.max(axis=1))
        if np.abs(new - value).max() < SETTLED:
            return values
        value = new


def along(place: int, values: np.ndarray, objects: int) -> np.ndarray:
    """Return values (S,) of an object as values of the joint problem."""
    return values.reshape([-1 if k == place else 1 for k in range(objects)])


def joint(chains: list[Chain], options: np.ndarray | None = None) -> float:
    """Compute the optimum at the start; or what the `options` (front, *places) of a way earn.

    Options are none of them, to claim each object, and every behavior of every object.
    """
    n = len(chains)
    size = tuple(len(chain.state) for chain in chains)
    claims = [np.broadcast_to(along(k, chain.claim, n), size) for k, chain in enumerate(chains)]
    stop = [np.zeros(size), *claims]
    value = np.tile(np.max(stop, axis=0), (n,) + (1,) * n)  # by the object in front
    # Value iteration over all objects' states at once: undiscounted, as costs end every search.
    while True:
        values = []  # of each object's behaviors
        for k, chain in enumerate(chains):
            after = np.moveaxis(np.tensordot(chain.move, value[k], axes=(2, k)), 1, 1 + k)
            cost = np.expand_dims(chain.cost, tuple(range(1, n + 1)))
            legal = np.stack([along(k, each, n) for each in chain.legal])
            values.append(np.where(legal, after - cost, -np.inf))
        new = np.empty_like(value)
        for front in range(n):
            if options is None:
                # Another object's turn comes only when the one in front was put down.
                free = along(front, chains[front].put_down == 0, n)
                best = [
                    np.where(free | (k == front), each.max(axis=0), -np.inf)
                    for k, each in enumerate(values)
                ]
                new[front] = np.max([*stop, *best], axis=0)
            else:
                every = np.concatenate([stop, *values])
                new[front] = np.take_along_axis(every, options[front][None], 0)[0]
        if np.abs(new - value).max() < SETTLED:
            return float(value[(0,) * (n + 1)])
        value = new


def by_find(chains: list[Chain]) -> np.ndarray:
    """Return the options that `best_move` takes."""
    prospects = []
    for chain in chains:
        values = explored(chain, OUTSIDE)
        prospects.append(
            [Prospect(OUTSIDE, values[..., s], claim) for s, claim in enumerate(chain.claim)]
        )

    def option(front: int, places: tuple[int, ...]) -> int:
        chain = chains[front]
        hand = Hand(float(chain.put_down[places[front]]), int(chain.way[places[front]]))
        here = [each[s] for each, s in zip(prospects, places, strict=True)]
        move = best_move(here, front, hand)
        return 1 + move.object if move.behavior < 0 else _behavior(chains, *move[:2])

    return _options(chains, option)


def by_turn(chains: list[Chain]) -> np.ndarray:
    """Return the options of who asks about each object in turn."""
    plans = []
    for chain in chains:
        values = explored(chain, np.zeros(1))[0]
        goes_on = values.max(axis=0) > np.maximum(chain.claim, 0.0) + SETTLED
        plans.append(np.where(goes_on, values.argmax(axis=0), -1))

    def option(front: int, places: tuple[int, ...]) -> int:
        for k in range(front, len(chains)):
            s = places[k]
            if plans[k][s] >= 0:
                held = chains[front].way[places[front]]
                if k != front and held >= 0:
                    return _behavior(chains, front, held)
                return _behavior(chains, k, plans[k][s])
            if chains[k].claim[s] > 0:
                return 1 + k
        return 0

    return _options(chains, option)


def _behavior(chains: list[Chain], place: int, behavior: int) -> int:
    return 1 + len(chains) + sum(len(chain.cost) for chain in chains[:place]) + int(behavior)


def _options(chains: list[Chain], option) -> np.ndarray:
    size = tuple(len(chain.state) for chain in chains)
    options = np.zeros((len(chains), *size), int)
    for front, *places in product(range(len(chains)), *map(range, size)):
        options[(front, *places)] = option(front, tuple(places))
    return options


def main() -> None:
    """Print what each way loses."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--problems", type=int, default=60)
    parser.add_argument("--objects", type=int, default=2)
    parser.add_argument("--percepts", type=int, default=3, help="behaviors that tell, at most")
    parser.add_argument("--scale", type=float, default=1.0, help="of all costs")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    losses = []
    for number in range(options.problems):
        rng = np.random.default_rng([options.seed, number])
        behaviors = drawn(rng, options.percepts, options.scale)
        held_from = int(rng.integers(1, STATES))
        priors = rng.choice([0.05, 0.1, 0.2, 0.3], options.objects)
        chains = [chain_of(behaviors, prior, held_from) for prior in priors]
        best = joint(chains)
        losses.append([best - joint(chains, way(chains)) for way in (by_find, by_turn)])
    print("way    mean loss    worst")
    for way, loss in zip(("find", "turn"), np.array(losses).T, strict=True):
        error = loss.std(ddof=1) / np.sqrt(len(loss))
        print(f"{way}  {loss.mean():8.3f} ± {error:.3f}{loss.max():9.2f}")


if __name__ == "__main__":
    main()
