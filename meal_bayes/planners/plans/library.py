"""The library of open-loop plans of a MOMDP, in four steps: grow, sift, compete, complete.

What a plan is worth hangs on its *errors*: how often each attribute is reported wrongly after its
percepts. The fewer errors a step reckons with, the more a plan seems worth. Steps reckon as
precisely as they must, from the cheapest computation to the finest:

- *grow* takes the fewest errors that can be, from the Bhattacharyya coefficient of the percepts:
  values from above, so that no plan ends before what could still pay (a bound where percepts are of
  four levels at most and independent given the truth, else an estimate);
- *sift* takes the most errors that can be, by the same coefficient: values from below (a bound
  where percepts are independent given the truth; with shared latent classes an estimate, and of yes
  or no, where half of the errors are taken for misses, half for false alarms);
- *compete* enumerates the percepts; where outcomes would be too many, those that say nearly the
  same are merged, and levels cut to yes or no (`bayes_error.FEW_OUTCOMES`). Errors are never too
  few: values from below again, and close ones;
- *complete* does so once more for the winners, and for what remains of them after a percept, with
  more outcomes (`bayes_error.OUTCOMES`). These tables are what planners read.

Of a plan the library keeps what `values.PLAN` says: its first behavior and sums over all of them,
not the sequence, as planners look again after a step.

Plans of a question of yes or no are grown as if its values were reported, between its least and its
largest payoff; they are sifted, compete and are read by what yes and no earn.

A plan goes along the likeliest outcome of each behavior; what the others cost it is in `paths`.
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

_GROWTH_BELIEFS = 4  # beliefs for which plans are grown from every x, to every first percept
_GROWN = 2_000  # plans that are grown; of a large diagram to the most telling first percepts alone
_MOST_ATTRIBUTES = 5  # by whose number beliefs and candidates grow; with more no more are taken
_BELIEFS = 16  # beliefs for each of these attributes, at which plans compete
_ROUNDS = 6  # of correcting a belief that latent classes hold together
_WINNERS = 14  # plans an x, besides one for every first behavior and what remains of them
_CANDIDATES = 10  # candidates for each of these attributes, an x and a belief, that compete
_OF_FIRST = 2  # candidates of each x and first behavior, if not among these


def plan_library(momdp: MOMDP, model: MOMDPArrays) -> Plans:
    """Build the plan library of a MOMDP.

    1. *Grow.* For the first few of a spread of beliefs, plans are grown from every x to every first
       percept, and percept by percept from there. They, their prefixes, and simple plans are the
       candidates.
    2. *Sift.* By a cheap estimate of their value the most promising go on, at every belief.
    3. *Compete.* At all beliefs of the spread, and from every x, candidates are valued as planners
       value them, by coarser tables; winners are kept. Every legal behavior keeps its best plan,
       so that none is without a lower bound.
    4. *Complete.* What remains of a winner after each of its steps joins the library: who follows a
       plan and plans anew after a step can only gain (but for errors that are computed coarsely,
       where rows are not known), and never puts off its end.
    """
    if not model.dynamics.step["legal"].any():  # as where everything fails
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
    """Return the library of a MOMDP in which nothing can be done."""
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
    """Draw beliefs (B,N,C) around the prior, of which the first is the prior itself."""
    n = len(momdp.query)
    rng = np.random.Generator(np.random.PCG64(n))
    spread = rng.uniform(-4.0, 4.0, (_BELIEFS * min(n, _MOST_ATTRIBUTES), n))
    return _move_prior(momdp, model, np.concatenate([np.zeros((1, n)), spread]))


def _move_prior(momdp: MOMDP, model: MOMDPArrays, spread: Floats) -> Floats:
    """Move the prior's log-odds by a spread (B,N) -> Pr(latent class) (B,N,C), as percepts would.

    Evidence of s nats weighs the classes by exp(s Pr(true | class)). Where the class is the truth,
    this moves the log-odds by s, and one round is enough. Otherwise it moves them by less, and each
    round adds what is still missing. Where both truths share a class, no weights may reach the odds
    that are wanted; then the last round stops short of them.
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
    """Return plans grown at beliefs (B,N), simple ones, and tours where exploring is paid."""
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
    """Grow plans at beliefs (B,N) from every x to every first percept; with their prefixes."""
    legal = diagram.dynamics.step["legal"]
    n_states, n_behaviors = legal.shape
    if n_states * n_behaviors * len(probabilities) > _GROWN:
        probabilities = probabilities[:2]
    shape = n_states, len(probabilities), n_behaviors, LENGTH
    paths = Paths(behavior=np.full(shape, -1), ends=np.zeros(shape, np.bool_))
    cost = np.where(diagram.shortest.senses & legal, diagram.steps.cost, np.inf).min(axis=0)
    growth = Growth(
        log_affinity=log_affinity,
        rate=(-log_affinity[..., 1] / cost).max(axis=1),  # nats a second, of its best behavior
        limit=model.percepts.limit,
        incorrect=model.incorrect,
        reward_range=model.reward_range,
        # Written by the kernel as it goes.
        counts=np.zeros(n_behaviors, np.int64),
        log_r=np.zeros((2, len(log_affinity))),
    )
    begins = _first_goals(diagram, log_affinity, _GROWN // (n_states * len(probabilities)))
    length = grow_plans(diagram.shortest, growth, probabilities, begins, paths)
    start = np.repeat(np.arange(n_states), len(probabilities) * n_behaviors)
    path = paths.behavior[..., :length].reshape(-1, length)
    return sum_up(diagram, start, path, paths.ends[..., :length].reshape(-1, length))


def _first_goals(diagram: DiagramPaths, log_affinity: Floats, most: int) -> Bools:
    """Choose for each x the first percepts that plans are grown to, (X,E), `most` of them at most.

    Half of them tell most a second, the others cost least: they lead to where more can be told.
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

    It only chooses who competes: the best few from each x at each belief stay, and _OF_FIRST of
    each first behavior.
    """
    value = estimate_values(model, candidates, probabilities, log_affinity)  # (B,J)
    is_promising = np.zeros(value.shape[1], np.bool_)
    # Of each x and first behavior, those that are worth most at the belief where they are best.
    peak = value.max(axis=0)
    group = candidates.x * model.dynamics.step.shape[1] + candidates.plan["action"]
    is_promising[_rank_within(group, peak) < _OF_FIRST] = True
    # Of each x and belief, those that are worth most. Candidates come by x (see `cheapest`).
    number = _CANDIDATES * min(len(log_affinity), _MOST_ATTRIBUTES)
    for from_x in np.split(np.arange(len(peak)), np.flatnonzero(np.diff(candidates.x)) + 1):
        best = np.argpartition(-value[:, from_x], min(number, len(from_x) - 1), axis=1)[:, :number]
        is_promising[from_x[best]] = True
    return candidates.select(np.flatnonzero(is_promising))


def _rank_within(group: Ints, value: Floats) -> Ints:
    """Return the place of each value among those of its group, (J,): 0 is the highest."""
    order = np.lexsort((-value, group))
    in_order = group[order]
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order)) - np.searchsorted(in_order, in_order)
    return rank


def _compete(model: MOMDPArrays, candidates: Candidates, beliefs: Floats) -> Candidates:
    """Value candidates at beliefs (B,N,C); of every x, return those that win.

    These are the _WINNERS plans that are best at the largest numbers of beliefs, and for each first
    behavior the plan that is best at the belief where going for it is worth most.
    """
    # Coarse tables are enough to rank some hundred candidates; winners are tabulated again, finely.
    plans = _as_plans(model, candidates, bayes_error.FEW_OUTCOMES)
    evaluator = make_evaluator(model, plans)
    behaviors = np.arange(model.dynamics.step.shape[1])
    winner = np.zeros(len(plans.plan), np.bool_)
    for x, (start, end) in enumerate(itertools.pairwise(plans.first.tolist())):
        best = best_plans(evaluator, x, beliefs)  # (B,E)
        # At a belief the plans that are worth most win; who wins at many beliefs is kept first.
        is_highest = (best.value == best.value.max(axis=1, keepdims=True)) & (best.plan >= 0)
        wins = np.bincount(best.plan[is_highest] - start, minlength=end - start)
        ranking = np.argsort(-wins, kind="stable")[:_WINNERS]
        winner[start + ranking[wins[ranking] > 0]] = True
        # For each behavior the belief where to begin with it is worth most, and its plan there.
        of_first = best.plan[best.value.argmax(axis=0), behaviors]
        winner[of_first[of_first >= 0]] = True
    return candidates.select(np.flatnonzero(winner))


def _complete(model: MOMDPArrays, diagram: DiagramPaths, winners: Candidates) -> Plans:
    """Add what remains of the winners after each of their steps; tabulate all their errors."""
    plans = cheapest(sum_up_walks(diagram, plan_suffixes(winners, diagram.shortest)))
    return _as_plans(model, plans, bayes_error.OUTCOMES)


def _as_plans(model: MOMDPArrays, candidates: Candidates, capacity: int) -> Plans:
    """Make plans of candidates, which are in order of x, with their errors."""
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
    """Return the plans with their errors in another MOMDP; what they cost is taken as it was."""
    row, table = _tabulate(model, plans.observation_counts, bayes_error.OUTCOMES)
    return plans._replace(row=row, table=table)


def _tabulate(model: MOMDPArrays, observation_counts: Ints, capacity: int) -> tuple[Ints, Floats]:
    """Tabulate the errors of plans by their percepts (J,E); equal ones of an attribute share a row.

    Returns the rows (J,N) of the plans in the table, and the table (T,G,C); see `Plans`.
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

    Of yes or no, hits and false alarms are needed apart, not their sum, the error. As if all truths
    were false, an error is to say yes.
    """
    all_false = np.zeros_like(percepts.truth_of_class)
    all_false[:, 0] = 1.0
    return percepts._replace(truth_of_class=all_false)
