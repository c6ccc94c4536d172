"""What a decision of the search holds, what is kept and shared, and the MOMDPs it samples."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pytest
from scipy.stats import chisquare

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import Objective, Transition, build_momdp, initial_belief, update_belief
from meal_bayes.momdp.observation import predictive
from meal_bayes.planners import POMCP, Decision, History, MemoizedPolicy
from meal_bayes.planners.jit import entry_kernel
from meal_bayes.planners.momdp_arrays import arrays_of
from meal_bayes.planners.search.tree import KEPT, draw_percept, draw_root_object, make_sampled

RNG = np.random.default_rng(0)  # of solvers that draw nothing


def same(first, second):
    return all(
        np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b
        for a, b in ((getattr(first, f.name), getattr(second, f.name)) for f in fields(first))
    )


def hopeless(n, *, abstain=False):
    """Build a query of ROC36 of which no behavior tells anything."""
    domain = load_domain("roc36")
    confusion = np.full((n, len(domain.behaviors), 2, 2), 0.5)
    query = Query(domain.attributes[:n])
    goal = Objective(discount=1.0, abstain=abstain)
    return build_momdp(domain, query, confusion, objective=goal)


def test_equal_seeds_decide_alike(small, toy):
    for momdp in (toy, small.ispy32(8, limit=5), small.toy(9, 2, 4, finite=True)):
        first = small.search(momdp, 60, 3)
        second = small.search(momdp, 60, 3)
        assert same(first, second)
    assert len({small.search(toy, 60, seed).tree for seed in range(8)}) > 1


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("simulations", [0, 40])
def test_only_who_may_abstains(small, n, simulations):
    answer = small.search(hopeless(n), simulations)
    assert answer.action == 12  # the report of the belief's most probable values
    assert answer.values[-1] == pytest.approx(-500 + 1000 / 2**n)
    # A table's bound, rounded up, would look before it leaves, at the same price.
    ending = small.search(hopeless(n, abstain=True), simulations, points=0)
    if n == 1:  # a coin costs nothing
        assert ending.action == 12
    else:
        assert ending.action == hopeless(n).abstention
        assert ending.values[-1] == 0.0


def test_known_attributes_cost_a_query_nothing(small):
    """80 certain attributes beside an open one: the problem of the open one."""
    prior = np.array([0.5, *[1.0] * 80])
    wide, narrow = (small.search(small.ispy32(n, prior=prior[:n], limit=5), 0) for n in (81, 1))
    assert wide.action == narrow.action == 0
    assert wide.values[-1] == narrow.values[-1] == 0.0
    assert small.best_value(wide) == pytest.approx(small.best_value(narrow), rel=1e-9)


def test_a_full_tree_ends_the_search(small, toy):
    decision = small.search(toy, 5000, capacity=300)
    assert 0 < decision.simulations < 5000
    assert decision.visits.sum() == decision.simulations


def test_visits_and_the_logged_tree(small, toy):
    decision = small.search(toy, 400)
    assert decision.visits.sum() == decision.simulations == 400
    first = [edge for edge in decision.tree if edge.level == 1]
    second = [edge for edge in decision.tree if edge.level == 2]
    assert decision.tree == (*first, *second)
    for edge in first:
        assert (edge.parent, edge.observation) == (-1, ())
        assert edge.visits == decision.visits[edge.action]
        assert edge.value == decision.values[edge.action]
    assert 0 < len(second) <= 40
    for edge in second:
        assert edge.visits <= first[edge.parent].visits
        assert len(edge.observation) == 2  # look and lift always give a percept, in the end
    assert [e.visits for e in second] == sorted((e.visits for e in second), reverse=True)


@pytest.mark.parametrize("wrong", [{"simulations": -1}, {"exploration": -0.1}, {"capacity": 0}])
def test_settings_are_checked(wrong):
    with pytest.raises(SettingsError, match="POMCP needs"):
        POMCP(**wrong)


def test_threads_decide_alike(small):
    momdp = small.noisy_roc36(2)
    policy = POMCP(200).solve(momdp, np.random.default_rng(0))

    def decide(seed):
        return policy.decide(History(initial_belief(momdp)), np.random.default_rng(seed))

    alone = [decide(seed) for seed in range(24)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(decide, range(24)))
    assert all(map(same, alone, together))


@pytest.fixture(scope="module")
def beliefs(toy):
    """Beliefs at the start, after a look of two kinds, and lifted."""
    start = initial_belief(toy)
    look = update_belief(start, toy, Transition(0, 0, np.array([1, 0], np.int8)))
    other = update_belief(start, toy, Transition(0, 0, np.array([0, 0], np.int8)))
    return start, look, other, start.at(1)


def test_decisions_are_made_once_for_a_place_and_percepts(toy, beliefs):
    class Counting:
        calls = 0

        def decide(self, history, rng):
            self.calls += 1
            nothing = np.zeros(toy.n_behaviors + 1)
            return Decision(self.calls, nothing, nothing, nothing)

    inner = Counting()
    policy = MemoizedPolicy(inner)
    (start, look, *_) = beliefs
    trial = [*beliefs, start, look]
    assert [policy.decide(History(b), RNG).action for b in trial] == [1, 2, 3, 4, 1, 2]
    assert inner.calls == 4


def test_decisions_are_equal_whatever_trial_comes_first(toy, beliefs):
    made = set()
    for seed, order in enumerate(itertools.permutations(range(4))):
        policy = MemoizedPolicy(POMCP(20).solve(toy, np.random.default_rng(seed)))
        rng = np.random.default_rng(seed)
        decisions = [None] * 4
        for place in order:
            decision = policy.decide(History(beliefs[place]), rng)
            values = decision.values[~np.isnan(decision.values)]
            decisions[place] = decision.action, decision.tree, tuple(values), tuple(decision.visits)
        made.add(tuple(decisions))
    assert len(made) == 1


def test_dynamics_are_compiled_once_for_momdps_that_share_them(small):
    first = arrays_of(small.momdp("roc36", {"heavy": {"lift_slow": (0.9, 0.1)}}))
    second = arrays_of(small.momdp("roc36", {"blue": {}, "beans": {}}, 7.0))
    assert first.dynamics is second.dynamics
    for options in ({"objective": Objective(discount=0.9)}, {"objective": Objective(abstain=True)}):
        unlike = arrays_of(small.momdp("roc36", {"heavy": {}}, **options))
        assert unlike.dynamics is not first.dynamics


def test_information_on_the_latent_class_is_planned_with():
    """Look says nothing of the truth, but whether lift is to be believed."""
    honest = [[0.9, 0.1], [0.9, 0.1]]
    mistaken = [[0.1, 0.9], [0.1, 0.9]]
    lift = [[0.9, 0.1], [0.1, 0.9], [0.1, 0.9], [0.9, 0.1]]
    look = [honest[0], mistaken[0], honest[1], mistaken[1]]
    rows = np.array([[look, lift, [[0.5, 0.5]] * 4]])
    latent_classes = [[[0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]]]
    momdp = build_momdp(load_domain("toy"), Query(("red",)), rows, latent_classes=latent_classes)
    assert np.ptp(momdp.rows[0, :2], axis=1).max() == pytest.approx(0.0)
    informative = arrays_of(momdp).percepts.informative
    np.testing.assert_array_equal(informative, [[True, True, False]])


DRAWS = 100_000


@entry_kernel
def draw_percepts(percepts, sampled, behaviors, rng, out):
    """Draw what so many sampled MOMDPs show along a sequence of behaviors -> out (D,T,N)."""
    for d in range(out.shape[0]):
        draw_root_object(percepts, sampled, rng)
        for t in range(behaviors.shape[0]):
            draw_percept(percepts, sampled, behaviors[t], out[d, t], rng)


def sequence_probabilities(momdp, belief, behaviors):
    """Pr(percept levels) of every sequence, from the predictive: (N, K^T)."""
    out = []
    for i, log_prob in enumerate(belief.log_prob):
        for levels in itertools.product(range(momdp.levels), repeat=len(behaviors)):
            counts = belief.percept_counts[i].astype(float)  # a copy
            prob = np.exp(log_prob)  # (C,)
            for e, z in zip(behaviors, levels, strict=True):
                mean = momdp.confusion[i, e, :, z]
                s = momdp.precision[i, e]
                prob = prob * predictive(mean, s, counts[e, z], counts[e].sum())
                counts[e, z] += 1
            out.append(prob.sum())
    return np.reshape(out, (len(momdp.query), -1))


@pytest.mark.quick(6)
@pytest.mark.statistical
@pytest.mark.parametrize("precision", [1.0, 5.0, np.inf])
@pytest.mark.parametrize("options", [{}, {"shared": 3}])
@pytest.mark.parametrize("behaviors", [(0, 0, 0), (0, 1, 0)])
def test_sampled_momdps_show_what_the_predictive_says(small, precision, options, behaviors):
    """To depth 3, after two percepts of the trial; attributes independently of each other."""
    rng = np.random.default_rng(8)
    momdp = small.random("toy", 2, 2, rng, precision=precision, **options)
    belief = initial_belief(momdp)
    for e, levels in ((0, [1, 0]), (1, [1, 1])):
        belief = update_belief(belief, momdp, Transition(e, 0, np.array(levels)))
    counts = belief.percept_counts.astype(float)
    sampled = make_sampled(arrays_of(momdp).percepts, np.exp(belief.log_prob), counts)
    shown = np.zeros((DRAWS, 3, 2), np.int64)
    draw_percepts(arrays_of(momdp).percepts, sampled, np.array(behaviors), rng, shown)
    cells = np.ravel_multi_index(tuple(shown.transpose(1, 2, 0).reshape(6, -1)), (2,) * 6)
    first, second = sequence_probabilities(momdp, belief, behaviors)
    joint = np.einsum("abc,def->adbecf", first.reshape(2, 2, 2), second.reshape(2, 2, 2)).ravel()
    assert joint.sum() == pytest.approx(1.0)
    test = chisquare(np.bincount(cells, minlength=64), DRAWS * joint)
    assert test.pvalue > 0.01


def root_values(small, momdp, simulations, **settings):
    """Value of the best action by each backup."""
    decisions = [
        small.search(momdp, simulations, always=True, backup=backup, **settings)
        for backup in ("expected", "sampled")
    ]
    assert [decision.simulations for decision in decisions] == [simulations] * 2
    return [small.best_value(decision) for decision in decisions]


@pytest.mark.statistical
def test_both_backups_reach_one_value_at_finite_precision(small):
    momdp = small.momdp("toy", small.rates, 3.0, limit=2)
    optimum = small.expectimax(momdp)
    best = optimum.value(momdp.start, optimum.nothing_seen())
    for value in root_values(small, momdp, 100_000):
        assert value == pytest.approx(best, abs=0.01 * momdp.correct)


@pytest.mark.parametrize("precision", [5.0, np.inf])
@pytest.mark.parametrize("backup", ["expected", "sampled"])
def test_a_decision_keeps_rows_of_sampled_momdps(small, precision, backup):
    momdp = small.momdp("toy", small.rates, precision, limit=3)
    decision = small.search(momdp, 100, backup=backup)
    assert decision.action < momdp.n_behaviors
    rows = decision.sampled_rows
    assert rows.shape == (KEPT, 2, momdp.levels)
    np.testing.assert_allclose(rows.sum(axis=2), 1.0)
    for i in range(2):
        classes = momdp.confusion[i, decision.action]
        objects = {tuple(row) for row in rows[:, i]}
        if np.isinf(precision):
            assert objects <= set(map(tuple, classes))
        else:
            assert len(objects) == KEPT  # each MOMDP has an object of its own
            assert not objects & set(map(tuple, classes))
