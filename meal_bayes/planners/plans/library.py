"""The library of open-loop plans of a MOMDP, made in four steps: grow, screen, select, complete.

The value of a plan depends on its *errors*: how often each attribute is reported wrongly after the
percepts of the plan. The smaller the assumed errors, the higher the value. The four steps compute
the errors with increasing precision and cost:

- *grow* uses a lower bound on the errors, from the Bhattacharyya coefficient of the percepts.
  Values are then too high, so no plan ends too early. (It is a bound if percepts have at most four
  levels and are independent given the truth, and otherwise an estimate.)
- *screen* (`_sift`) uses an upper bound on the errors by the same coefficient, so values are too
  low. (It is a bound if percepts are independent given the truth. With shared latent classes, and
  for yes-or-no questions, it is an estimate; for the latter, half of the errors count as misses and
  half as false alarms.)
- *select* (`_compete`) enumerates the outcomes. If there are too many, those with similar
  likelihood ratios are merged, and levels are reduced to yes or no (`bayes_error.FEW_OUTCOMES`).
  Errors are never too small, so values are lower bounds again, and close ones.
- *complete* does the same with more outcomes (`bayes_error.OUTCOMES`) for the winners and for the
  rest of each winner after a percept. Planners read the resulting tables.

For each plan, the library keeps the fields of `values.PLAN`: the first behavior, and sums over all
behaviors. It does not keep the sequence, because planners plan again after each step.

For a yes-or-no question, plans are grown as if the values of its attributes were reported, with the
smallest and the largest payoff as rewards. The later steps use the payoffs of yes and no.

A plan assumes the most probable outcome of each behavior; `paths` computes the cost of the other
outcomes.
"""

import itertools

import numpy as np

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.momdp_arrays import MOMDPArrays, Percepts
from meal_bayes.planners.plans import bayes_error
from meal_bayes.planners.plans.affinity import estimate_values, log_affinities
from meal_bayes.planners.plans.candidates import (
    LENGTH,
    Candidates,
    cheapest,
    distinct,
    paid_tours,
    plan_suffixes,
    simple_plans,
    sum_up,
    sum_up_walks,
)
from meal_bayes.planners.plans.growth import Growth, Paths, grow_plans
from meal_bayes.planners.plans.paths import DiagramPaths, diagram_of
from meal_bayes.planners.plans.values import PLAN, Plans, best_plans, make_evaluator

_GROWTH_BELIEFS = 4  # number of beliefs for which plans are grown
_GROWN = 2_000  # largest number of grown plans; in a large diagram, fewer first percepts are used
_MOST_ATTRIBUTES = 5  # numbers of beliefs and candidates grow up to this number of attributes
_BELIEFS = 16  # number of beliefs for each attribute, at which plans compete
_ROUNDS = 6  # number of corrections of a belief with several latent classes
_WINNERS = 14  # number of winners for each x, in addition to one for every first behavior
_CANDIDATES = 10  # number of competing candidates for each attribute, x and belief
_OF_FIRST = 2  # number of further candidates for each x and first behavior


def plan_library(momdp: MOMDP, model: MOMDPArrays) -> Plans:
    """Build the plan library of a MOMDP.

    1. *Grow.* For some of a set of beliefs around the prior, plans are grown from every state, with
       every first percept, by adding one percept at a time. These plans, their prefixes, and simple
       plans are the candidates.
    2. *Screen.* At every belief, the candidates with the highest estimated values are kept.
    3. *Select.* At all beliefs of the set, and from every state, candidates are valued as planners
       value them, but by coarser tables; the winners are kept. The best plan of every legal
       behavior is kept too, so that every behavior has a lower bound.
    4. *Complete.* What remains of a winner after each of its steps is added to the library. A robot
       that follows a plan and plans again after each step therefore never does worse than the plan
       (except for coarsely computed errors if confusion matrices are uncertain).
    """
    if not model.dynamics.step["legal"].any():  # for example if all behaviors always fail
        return _no_plans(momdp, model)
    diagram = diagram_of(model.dynamics)
    beliefs = _spread_beliefs(momdp, model)
    probabilities = (beliefs * model.percepts.truth_of_class[:, 1]).sum(axis=2)  # (B,N) of true
    log_affinity = log_affinities(model)
    grown = _grow(model, diagram, probabilities[:_GROWTH_BELIEFS], log_affinity)
    candidates = _sift(model, grown, probabilities, log_affinity)
    winners = _compete(model, candidates, beliefs)
    return _complete(model, diagram, winners)


def _no_plans(momdp: MOMDP, model: MOMDPArrays) -> Plans:
    """Return the library of a MOMDP without legal behaviors."""
    n_states, n_behaviors = model.dynamics.step.shape
    return Plans(
        first=np.zeros(n_states + 1, np.int64),
        plan=np.zeros((0,), PLAN),
        observation_counts=np.zeros((0, n_behaviors), np.int64),
        expected_percepts=np.zeros((0, n_behaviors)),
        row=np.zeros((0, len(momdp.query)), np.int64),
        table=np.ones((1, bayes_error.THRESHOLDS, model.percepts.rows.shape[2])),
    )


def _spread_beliefs(momdp: MOMDP, model: MOMDPArrays) -> Floats:
    """Draw beliefs (B,N,C) around the prior; the first one is the prior itself."""
    n = len(momdp.query)
    rng = np.random.Generator(np.random.PCG64(n))
    spread = rng.uniform(-4.0, 4.0, (_BELIEFS * min(n, _MOST_ATTRIBUTES), n))
    return _move_prior(momdp, model, np.concatenate([np.zeros((1, n)), spread]))


def _move_prior(momdp: MOMDP, model: MOMDPArrays, spread: Floats) -> Floats:
    """Return beliefs Pr(latent class) (B,N,C) whose log-odds differ from the prior by `spread`.

    Evidence of s nats multiplies the classes by exp(s Pr(true | class)). If the class is the truth,
    this moves the log-odds by s, and one round is enough. Otherwise it moves them by less, and each
    round adds the missing evidence. If both truths share classes, the wanted log-odds may be
    impossible; the beliefs are then as close as the last round comes.
    """
    false, true = model.percepts.truth_of_class.transpose(1, 0, 2)  # (N,C)

    def log_odds(beliefs: Floats) -> Floats:
        yes = (beliefs * true).sum(axis=-1).clip(1e-300)
        no = (beliefs * false).sum(axis=-1).clip(1e-300)
        return np.asarray(np.log(yes / no))

    by_truth = np.clip(np.stack([1 - momdp.prior, momdp.prior], axis=1), 1e-9, 1.0)  # (N,2)
    prior = (by_truth[:, :, None] * momdp.latent_classes).sum(axis=1).clip(1e-21, 1.0)  # (N,C)
    prior /= prior.sum(axis=1, keepdims=True)
    wanted = log_odds(prior) + spread
    beliefs = prior[None]
    evidence = np.zeros_like(spread)
    for _ in range(1 if model.percepts.class_is_truth else _ROUNDS):
        evidence = evidence + wanted - log_odds(beliefs)
        beliefs = prior * np.exp(evidence[:, :, None] * true)
    return np.ascontiguousarray(beliefs / beliefs.sum(axis=2, keepdims=True))


def _grow(
    model: MOMDPArrays, diagram: DiagramPaths, probabilities: Floats, log_affinity: Floats
) -> Candidates:
    """Return grown plans at beliefs (B,N), simple plans, and tours if there is a bonus."""
    parts = [
        _grow_percepts(model, diagram, probabilities, log_affinity),
        simple_plans(diagram, log_affinity),
    ]
    if model.shaped and (diagram.shortest.first_action >= 0).any():
        parts.append(sum_up_walks(diagram, paid_tours(model, diagram.shortest), prefixes=True))
    return cheapest(Candidates(*map(np.concatenate, zip(*parts, strict=True))))


def _grow_percepts(
    model: MOMDPArrays, diagram: DiagramPaths, probabilities: Floats, log_affinity: Floats
) -> Candidates:
    """Grow plans at beliefs (B,N) from every x with every first percept; add their prefixes."""
    legal = diagram.dynamics.step["legal"]
    n_states, n_behaviors = legal.shape
    if n_states * n_behaviors * len(probabilities) > _GROWN:
        probabilities = probabilities[:2]
    shape = n_states, len(probabilities), n_behaviors, LENGTH
    paths = Paths(behavior=np.full(shape, -1), ends=np.zeros(shape, np.bool_))
    cost = np.where(diagram.shortest.senses & legal, diagram.steps.cost, np.inf).min(axis=0)
    growth = Growth(
        log_affinity=log_affinity,
        rate=(-log_affinity[..., 1] / cost).max(axis=1),  # nats per second of the best behavior
        limit=model.percepts.limit,
        incorrect=model.incorrect,
        reward_range=model.reward_range,
        # Buffers of the kernel.
        counts=np.zeros(n_behaviors, np.int64),
        log_r=np.zeros((2, len(log_affinity))),
    )
    begins = _first_goals(diagram, log_affinity, _GROWN // (n_states * len(probabilities)))
    length = grow_plans(diagram.shortest, growth, probabilities, begins, paths)
    start = np.repeat(np.arange(n_states), len(probabilities) * n_behaviors)
    path = paths.behavior[..., :length].reshape(-1, length)
    return sum_up(diagram, start, path, paths.ends[..., :length].reshape(-1, length))


def _first_goals(diagram: DiagramPaths, log_affinity: Floats, most: int) -> Bools:
    """Choose at most `most` first percepts of grown plans for each x, (X,E).

    Half of them have the most information per second; the others have the lowest cost, because they
    may lead to states with more informative percepts.
    """
    shortest = diagram.shortest
    tells = -log_affinity[..., 1].sum(axis=0)  # (E,)
    reached = (shortest.first_action >= 0) & (tells > 0)
    price = np.where(reached, shortest.cost + 1e-6, np.inf)
    by_price, by_rate = (
        order.argsort(axis=1, kind="stable").argsort(axis=1)
        for order in (price, price / tells.clip(1e-12))
    )
    half = max(most // 2, 1)
    return np.asarray(
        reached & ((by_price < most - half) | (by_rate < half) | (most >= len(tells)))
    )


def _sift(
    model: MOMDPArrays, candidates: Candidates, probabilities: Floats, log_affinity: Floats
) -> Candidates:
    """Select candidates by an estimate of their values at beliefs (B,N).

    The best few candidates from each x at each belief are kept, and the best _OF_FIRST candidates
    of each first behavior.
    """
    value = estimate_values(model, candidates, probabilities, log_affinity)  # (B,J)
    is_promising = np.zeros(value.shape[1], np.bool_)
    # For each x and first behavior, the candidates with the highest value at any belief.
    peak = value.max(axis=0)
    group = candidates.x * model.dynamics.step.shape[1] + candidates.plan["action"]
    is_promising[_rank_within(group, peak) < _OF_FIRST] = True
    # For each x and belief, those with the highest value. Candidates are sorted by x (`cheapest`).
    number = _CANDIDATES * min(len(log_affinity), _MOST_ATTRIBUTES)
    for from_x in np.split(np.arange(len(peak)), np.flatnonzero(np.diff(candidates.x)) + 1):
        best = np.argpartition(-value[:, from_x], min(number, len(from_x) - 1), axis=1)[:, :number]
        is_promising[from_x[best]] = True
    return candidates.select(np.flatnonzero(is_promising))


def _rank_within(group: Ints, value: Floats) -> Ints:
    """Return the rank of each value in its group, (J,); the highest value has rank 0."""
    order = np.lexsort((-value, group))
    in_order = group[order]
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order)) - np.searchsorted(in_order, in_order)
    return rank


def _compete(model: MOMDPArrays, candidates: Candidates, beliefs: Floats) -> Candidates:
    """Compute the values of candidates at beliefs (B,N,C), and return the winners for every x.

    The winners are the _WINNERS plans that are best at the largest numbers of beliefs, and for each
    first behavior the best plan at the belief at which beginning with it has the highest value.
    """
    # Coarse tables are enough to rank candidates; for winners, finer tables are computed later.
    plans = _as_plans(model, candidates, bayes_error.FEW_OUTCOMES)
    evaluator = make_evaluator(model, plans)
    behaviors = np.arange(model.dynamics.step.shape[1])
    winner = np.zeros(len(plans.plan), np.bool_)
    for x, (start, end) in enumerate(itertools.pairwise(plans.first.tolist())):
        best = best_plans(evaluator, x, beliefs)  # (B,E)
        # At each belief, the plans with the highest value win; plans with most wins are kept.
        is_highest = (best.value == best.value.max(axis=1, keepdims=True)) & (best.plan >= 0)
        wins = np.bincount(best.plan[is_highest] - start, minlength=end - start)
        ranking = np.argsort(-wins, kind="stable")[:_WINNERS]
        winner[start + ranking[wins[ranking] > 0]] = True
        # For each behavior, the best plan at the belief at which its value is highest.
        of_first = best.plan[best.value.argmax(axis=0), behaviors]
        winner[of_first[of_first >= 0]] = True
    return candidates.select(np.flatnonzero(winner))


def _complete(model: MOMDPArrays, diagram: DiagramPaths, winners: Candidates) -> Plans:
    """Add the rest of each winner after each of its steps, and tabulate the errors of all plans."""
    plans = cheapest(sum_up_walks(diagram, plan_suffixes(winners, diagram.shortest)))
    return _as_plans(model, plans, bayes_error.OUTCOMES)


def _as_plans(model: MOMDPArrays, candidates: Candidates, capacity: int) -> Plans:
    """Make plans with errors from candidates, which are in order of x."""
    states = np.arange(model.dynamics.step.shape[0] + 1)
    row, table = _tabulate(model, candidates.observation_counts, capacity)
    return Plans(
        first=np.searchsorted(candidates.x, states),
        plan=candidates.plan,
        observation_counts=candidates.observation_counts,
        expected_percepts=candidates.expected_percepts,
        row=row,
        table=table,
    )


def retabulate(plans: Plans, model: MOMDPArrays) -> Plans:
    """Return the plans with their errors in another MOMDP; their costs do not change."""
    row, table = _tabulate(model, plans.observation_counts, bayes_error.OUTCOMES)
    return plans._replace(row=row, table=table)


def _tabulate(model: MOMDPArrays, observation_counts: Ints, capacity: int) -> tuple[Ints, Floats]:
    """Tabulate the errors of plans with percepts (J,E).

    Plans with equal informative percepts of an attribute share a row of the table. Returns the rows
    (J,N) of the plans, and the table (T,G,C); see `Plans`.
    """
    percepts = model.percepts
    row = []
    counts = []
    attribute: list[int] = []
    for i, informative in enumerate(percepts.informative):
        informing = observation_counts * informative
        representative, number = distinct(informing)
        row.append(len(attribute) + number)
        counts.append(informing[representative])
        attribute.extend(itertools.repeat(i, len(representative)))
    table = np.empty((len(attribute), bayes_error.THRESHOLDS, percepts.rows.shape[2]))
    scratch = bayes_error.make_scratch(percepts, plans=0, rows=0, capacity=capacity)
    if model.conjunction is not None:
        percepts = _as_yes_rates(percepts)
    bayes_error.tabulate_errors(
        percepts, np.concatenate(counts), np.array(attribute, np.int64), scratch, table
    )
    return np.column_stack(row), table


def _as_yes_rates(percepts: Percepts) -> Percepts:
    """Return percepts whose tabulated errors are Pr(says yes | class).

    A yes-or-no question needs hits and false alarms separately, and not their sum, the error. If
    all truths are treated as false, an error is the same as saying yes.
    """
    all_false = np.zeros_like(percepts.truth_of_class)
    all_false[:, 0] = 1.0
    return percepts._replace(truth_of_class=all_false)
