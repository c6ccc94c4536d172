"""One of several objects: the index policy against joint value iteration."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes.domain import Payoffs, Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import Transition, build_momdp, initial_belief, update_belief
from meal_bayes.planners import (
    POMCP,
    Hand,
    History,
    MemoizedPolicy,
    Prospector,
    Random,
    SharedPlans,
    best_move,
    paths_back,
)
from meal_bayes.planners.several_objects import (
    Prospect,
    outside_values,
    values_beside,
    worth_of_others,
)

LIMIT = 2  # percepts of each behavior
DOMAIN = load_domain("toy")
NONE = 0.0


def problem(rates, prior=0.4, cost=(1.0, 5.0, 2.0), none=NONE):
    """Ask a toy object for yes or no; "no" pays what none earns."""
    rows = np.full((1, 3, 2, 2), 0.5)
    for e, (alarm, hit) in enumerate(rates):
        rows[0, e] = [[1 - alarm, alarm], [1 - hit, hit]]
    query = Query(("heavy",), payoffs=Payoffs(100.0, -100.0, none, none))
    momdp = build_momdp(DOMAIN, query, rows, prior=prior, limit=LIMIT)
    return replace(momdp, cost=np.array(cost), abstain=False)


class Chain:
    """Everything that can become of one object: S places (x, percepts), and moves between them."""

    def __init__(self, momdp):
        self.momdp = momdp
        beliefs = {}
        waiting = [initial_belief(momdp)]
        edges = []
        while waiting:
            belief = waiting.pop()
            if self.key(belief) in beliefs:
                continue
            beliefs[self.key(belief)] = belief
            for e, (p, after) in itertools.chain.from_iterable(self.moves(belief)):
                edges.append((self.key(belief), e, p, self.key(after)))
                waiting.append(after)
        self.beliefs = list(beliefs.values())
        place = {key: s for s, key in enumerate(beliefs)}
        self.move = np.zeros((momdp.n_behaviors, len(place), len(place)))
        for source, e, p, target in edges:
            self.move[e, place[source], place[target]] += p
        self.legal = np.array([momdp.legal[belief.x] for belief in self.beliefs]).T  # (E,S)
        chance = np.array([belief.positive[0] for belief in self.beliefs])
        self.claim = -100.0 + 200.0 * chance
        self.x = np.array([belief.x for belief in self.beliefs])

    @staticmethod
    def key(belief):
        return belief.x, belief.percept_counts.tobytes()

    def moves(self, belief):
        momdp = self.momdp
        for e in np.flatnonzero(momdp.legal[belief.x]):
            full = belief.percept_counts[0, e].sum() >= momdp.limit[e]
            for x in np.flatnonzero(momdp.transition[e, belief.x]):
                p = momdp.transition[e, belief.x, x]
                comes = 0.0 if full else momdp.observation_probability[e, belief.x, x]
                outcomes = [(p * (1 - comes), belief.at(int(x)))] if comes < 1 else []
                for z in range(2) if comes else ():
                    rows = momdp.confusion[0, e, :, z]
                    q = belief.positive[0]
                    chance = q * rows[1] + (1 - q) * rows[0]
                    after = update_belief(
                        belief, momdp, Transition(int(e), int(x), np.array([z], np.int8))
                    )
                    outcomes.append((p * comes * chance, after))
                yield [(int(e), outcome) for outcome in outcomes]


def joint(chains, leave, choose=None):
    """Compute the value of the joint problem at its start; of a policy where there is one."""
    sizes = tuple(len(chain.x) for chain in chains)
    g = chains[0].momdp.discount
    claims = [
        chain.claim.reshape([-1 if i == k else 1 for i in range(len(chains))])
        for k, chain in enumerate(chains)
    ]
    stop = np.broadcast_to(NONE, sizes)
    for claim in claims:
        stop = np.maximum(stop, claim)
    value = np.tile(stop, (len(chains), *[1 for _ in chains]))  # by the object in front
    for _ in range(400):
        explored = np.full((len(chains), chains[0].momdp.n_behaviors, *sizes), -np.inf)
        for k, chain in enumerate(chains):
            for e in range(chain.momdp.n_behaviors):
                after = np.moveaxis(np.tensordot(chain.move[e], value[k], axes=(1, k)), 0, k)
                legal = chain.legal[e].reshape([-1 if i == k else 1 for i in range(len(chains))])
                explored[k, e] = np.where(legal, g * after - chain.momdp.cost[e], -np.inf)
        new = np.empty_like(value)
        for front, chain in enumerate(chains):
            free = leave[chain.x].reshape([-1 if i == front else 1 for i in range(len(chains))])
            if choose is None:
                best = stop
                for k in range(len(chains)):
                    ways = explored[k].max(axis=0)
                    best = np.maximum(best, ways if k == front else np.where(free, ways, -np.inf))
                new[front] = best
            else:
                options = [np.broadcast_to(NONE, sizes)]
                options += [np.broadcast_to(claim, sizes) for claim in claims]
                options += [ways for k in range(len(chains)) for ways in explored[k]]
                stacked = np.stack(options)
                new[front] = np.take_along_axis(stacked, choose[front][None], 0)[0]
        change = np.abs(new - value).max()
        value = new
        if change < 1e-9:
            break
    return value[(0, *[0 for _ in chains])]


def moves(chains, prospects, hands):
    """Return what `best_move` does at every joint place, by the object in front."""
    sizes = tuple(len(chain.x) for chain in chains)
    behaviors = chains[0].momdp.n_behaviors
    choose = np.zeros((len(chains), *sizes), int)
    for place in itertools.product(*map(range, sizes)):
        here = [prospects[k][s] for k, s in enumerate(place)]
        for front in range(len(chains)):
            move = best_move(here, front, hands[front][place[front]])
            action = 1 + move.object
            if move.behavior >= 0:
                action = 1 + len(chains) + move.object * behaviors + move.behavior
            choose[(front, *place)] = action
    return choose


def policy(chains, leave):
    """Return what a search by `POMCP` does at every joint place, by the object in front."""
    rng = np.random.default_rng(0)
    solve = SharedPlans(lambda momdp: POMCP().solve(momdp, rng))
    prospectors = [Prospector(chain.momdp, solve, leave) for chain in chains]
    prospects = []
    hands = []
    for prospector, chain in zip(prospectors, chains, strict=True):
        prospects.append([prospector.prospect(History(belief), rng) for belief in chain.beliefs])
        hands.append([prospector.hand(belief) for belief in chain.beliefs])
    return moves(chains, prospects, hands)


RATES = {
    "look tells": [(0.2, 0.85), (0.4, 0.6)],
    "lift tells": [(0.4, 0.6), (0.1, 0.95)],
    "both tell": [(0.3, 0.75), (0.15, 0.85)],
}


@pytest.mark.parametrize("hands", ["free", "full"])
@pytest.mark.parametrize(
    "pair",
    [("look tells", "look tells"), ("lift tells", "both tell"), ("both tell", "look tells")],
    ids=" and ".join,
)
def test_two_objects_are_within_one_percent_of_the_joint_optimum(pair, hands):
    leave = np.array([True, hands == "free", False])
    chains = [
        Chain(problem(RATES[name], prior)) for name, prior in zip(pair, (0.4, 0.3), strict=True)
    ]
    best = joint(chains, leave)
    worth = joint(chains, leave, policy(chains, leave))
    alone = max(joint([chain], leave) for chain in chains)
    assert best > alone + 1.0  # two objects are worth more than one
    assert worth <= best + 1e-6
    assert worth >= 0.99 * best


def exact(chain, leave):
    """Return prospects of all places by value iteration, and what putting down takes there."""
    momdp = chain.momdp
    back = paths_back(momdp, leave, momdp.discount)
    cost, discount, first = (part[chain.x] for part in back)
    outside = outside_values(NONE, 100.0)
    left = np.maximum(discount * outside[:, None] - cost, NONE)
    stop = np.maximum(left, chain.claim)  # (L,S)
    value = stop
    for _ in range(200):
        after = np.einsum("est,lt->les", chain.move, value)
        explored = momdp.discount * after - momdp.cost[:, None]
        explored = np.where(chain.legal, explored, -np.inf)
        value = np.maximum(stop, explored.max(axis=1))
    prospects = [Prospect(outside, explored[:, :, s], claim) for s, claim in enumerate(chain.claim)]
    return prospects, list(map(Hand, cost.tolist(), first.tolist(), discount.tolist()))


CHANCE = st.sampled_from([0.1, 0.3, 0.5, 0.7, 0.9])


@given(
    rates=st.lists(st.tuples(CHANCE, CHANCE, CHANCE, CHANCE), min_size=2, max_size=2),
    priors=st.lists(st.sampled_from([0.05, 0.1, 0.2, 0.3]), min_size=2, max_size=2),
    cost=st.tuples(*[st.sampled_from([0.5, 1.0, 2.0, 4.0])] * 3),
    free=st.booleans(),
)
@settings(max_examples=5)
def test_a_search_earns_what_it_promises_and_does_not_go_to_and_fro(rates, priors, cost, free):
    """The promise is at least what one after another earns, each beside what the rest is worth."""
    leave = np.array([True, free, False])
    chains = [
        Chain(replace(problem([each[:2], each[2:]], prior, cost), limit=np.ones(3)))
        for each, prior in zip(rates, priors, strict=True)
    ]
    prospects, hands = zip(*(exact(chain, leave) for chain in chains), strict=True)
    start = [each[0] for each in prospects]
    others = worth_of_others(start, NONE)
    promised = max(
        values_beside(prospect, worth).max() for prospect, worth in zip(start, others, strict=True)
    )
    promised = max(promised, NONE, *(prospect.claim_value for prospect in start))
    earned = joint(chains, leave, moves(chains, prospects, hands))
    assert promised - 1e-6 <= earned <= joint(chains, leave) + 1e-6


def test_one_object_is_the_question_of_yes_or_no():
    momdp = problem(RATES["both tell"])
    chain = Chain(momdp)
    everywhere = np.array([True, True, False])
    best = joint([chain], everywhere)
    assert joint([chain], everywhere, policy([chain], everywhere)) == pytest.approx(best, rel=0.005)
    rng = np.random.default_rng(0)
    question = MemoizedPolicy(POMCP(300).solve(momdp, rng))
    prospector = Prospector(
        momdp, lambda other: MemoizedPolicy(POMCP(300).solve(other, rng)), everywhere
    )
    for belief in chain.beliefs:
        asked = question.decide(History(belief), rng).action
        move = best_move([prospector.prospect(History(belief), rng)], 0)
        no = momdp.n_behaviors
        yes = momdp.n_behaviors + 1
        assert asked == (no if move.object < 0 else yes if move.behavior < 0 else move.behavior)


def test_values_beside_others_are_those_of_boxes():
    """Weitzman's boxes: each opens for 1 s and holds 100 with Pr p; the others are what is left."""

    def box(p):
        outside = np.linspace(0.0, 100.0, 1001)
        value = -1.0 + p * 100.0 + (1 - p) * outside
        return Prospect(outside, value[:, None], claim_value=-np.inf)

    one, two, three = map(box, (0.3, 0.5, 0.1))
    assert two.index == pytest.approx(100 - 1 / 0.5, abs=0.01)
    assert best_move([one, two, three]).object == 1
    # by decreasing p: -1 + .5 100 + .5 (-1 + .3 100 + .7 (-1 + .1 100))
    last = -1 + 0.1 * 100
    exact_of_others = -1 + 30 + 0.7 * last
    exact = -1 + 50 + 0.5 * exact_of_others
    assert worth_of_others([one, two, three], 0.0)[1] == pytest.approx(exact_of_others, abs=1e-9)
    assert values_beside(two, exact_of_others) == pytest.approx([exact])
    assert worth_of_others([one], 7.0).tolist() == [7.0]


def test_a_full_hand_needs_the_object_that_it_holds():
    prospect = Prospect(np.array([0.0, 1.0]), np.zeros((2, 1)), claim_value=0.0)
    with pytest.raises(SettingsError, match="none is in front"):
        best_move([prospect], hand=Hand(1.0, 0))


def test_plans_are_shared_by_problems_that_differ_in_payoffs():
    solved = []

    def solve(momdp):
        solved.append(momdp)
        return POMCP().solve(momdp, np.random.default_rng(0))

    shared = SharedPlans(solve)
    momdp = problem(RATES["both tell"])
    dearer = replace(momdp, payoffs=Payoffs(100.0, -100.0, 50.0, 50.0))
    assert shared(momdp) is shared(problem(RATES["both tell"]))
    assert shared(dearer) is not shared(momdp)
    assert len(solved) == 1
    assert shared(problem(RATES["both tell"], prior=0.1)) is not shared(momdp)
    assert len(solved) == 2


def test_an_agent_that_compares_no_values_cannot_find():
    momdp = problem(RATES["both tell"])
    prospector = Prospector(
        momdp,
        lambda other: Random().solve(other, np.random.default_rng(0)),
        np.array([True, False, False]),
    )
    rng = np.random.default_rng(0)  # with which it explores
    with pytest.raises(SettingsError, match="compares no values"):
        prospector.prospect(History(initial_belief(momdp)), rng)


def test_the_way_back_counts_failures():
    domain = load_domain("simulated_arm")
    rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    momdp = build_momdp(domain, Query(("heavy",)), rows)
    leave = np.isin(domain.diagram.states, domain.leave)
    cost, _, first = paths_back(momdp, leave)
    assert momdp.behavior_names[first[1]] == "lift"
    p = momdp.transition[momdp.behavior_names.index("lift"), 1, 2]  # else it is lifted again
    assert cost[:4] == pytest.approx([0.0, 1.5 / p + 1.5, 1.5, 0.0])
    assert momdp.behavior_names[first[2]] == "drop"
    assert first[0] == -1


def test_the_way_back_is_discounted_by_its_steps():
    momdp = problem(RATES["both tell"])
    cost, discount, first = paths_back(momdp, np.array([True, False, False]), 0.9)
    assert cost.tolist()[:2] == [0.0, 2.0]
    assert discount.tolist()[:2] == [1.0, 0.9]
    assert first.tolist()[:2] == [-1, 2]


@pytest.mark.parametrize("decision", [None, 0, "look"])
def test_a_policy_that_decides_nothing_is_told(decision):
    """As in a trial, by the same boundary."""
    momdp = problem([(0.2, 0.8)] * 3)
    policy = SimpleNamespace(decide=lambda history, rng: decision)
    prospector = Prospector(momdp, lambda _: policy, np.ones(len(momdp.x_names), bool))
    with pytest.raises(SettingsError, match="expected a Decision"):
        prospector.prospect(History(initial_belief(momdp)), np.random.default_rng(0))
