"""The default method: closed-form kernel classifiers, pooled by a stacker [Wolpert1992].

A classifier for each modality, and one for all of them at once. Outputs on a group of recordings
come from classifiers and stackers that never saw it; groups are objects, or folds of objects where
there are many. With C = gram + noise and targets y of +-1, the kernel-ridge classifier trained
without the recordings G decides y_G - inv(C^-1[G,G]) (C^-1 y)_G on them [Cawley2006]: one inverse a
modality serves every attribute, object and pair of objects.

Many recordings are compared with m landmarks, of kernel L L'. A recording x has m features
phi(x) = L^-1 k(x), whose products are nearly its kernels (Nyström's approximation [Williams2001]).
A ridge on them is a kernel ridge; its normal equations are sums over folds of objects, so leaving
folds out subtracts theirs. All costs are linear in the recordings.

Kernels are wider than the median distance by one factor, which is learned from the labels. A narrow
kernel separates objects where recordings are informative; a wide one has few smooth functions, as
many as a few objects of noisy recordings determine. The factor is one for all behaviors, and
minimizes the loss of the stackers on decisions of classifiers on objects that these never saw,
summed over attributes and behaviors. A held-out object's own labels have no part in it.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from threadpoolctl import threadpool_limits

from meal_bayes.arrays import Bools, ByValue, Floats, Ints
from meal_bayes.perception.compiled_stacking import fit_stackers, score_without
from meal_bayes.perception.feature_spaces import (
    BehaviorRecordings,
    FeatureSpace,
    Rows,
    assign_folds,
    joint_kernel,
)
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.threads import turn

NOISE = 0.15  # lambda of C = K + lambda I
RIDGE = 0.5  # on the stackers' slopes
NOBODY = np.empty((1, 0), np.int64)  # one set, of no groups
_JITTER = 1e-9  # on the landmarks' kernel, where two of them are alike


class Stacker(NamedTuple):
    """A class-balanced logistic regression on M classifiers' decisions: `weights` (P,1+M)."""

    weights: Floats

    def log_odds(self, decisions: Floats) -> Floats:
        """Return log-odds with prior 1/2, (B,P), from decisions (B,M,P); NaN counts as 0."""
        slopes: Floats = np.einsum("bmp,pm->bp", np.nan_to_num(decisions), self.weights[:, 1:])
        return slopes + self.weights[:, 0]


class KernelFit(NamedTuple):
    """A classifier for each of M kernels (of the modalities, perhaps a joint one), and their pool.

    `dual` (M,P,m) is the weight of each recording, or landmark, in the classifiers' decisions.
    """

    dual: Floats
    pool: Stacker

    def scored(self, spaces: Sequence[FeatureSpace], rows: Rows) -> Floats:
        """Return log-odds of "true", (B,P); the joint kernel is that of the modalities there."""
        pairs = zip(spaces, rows, strict=True)
        kernels = np.stack([space.similarity(v) for space, v in pairs if v is not None])
        present = [m for m, values in enumerate(rows) if values is not None]
        if len(self.dual) > len(spaces):
            kernels = np.concatenate([kernels, joint_kernel(kernels)[None]])
            present.append(len(spaces))
        decisions = np.full((len(self.dual), kernels.shape[1], self.dual.shape[1]), np.nan)
        decisions[present] = kernels @ self.dual[present].transpose(0, 2, 1)
        return self.pool.log_odds(decisions.transpose(1, 0, 2))


@dataclass(frozen=True, slots=True)
class Problem(ByValue):
    """Recordings of one behavior whose labels are known, group by group.

    Groups (k,) rise; the recordings of each begin at `starts` (k+1,). Weights (n,) are of each
    recording in a stacker's loss, 2 an object; targets (P,n) are +-1; duals (M,P,m) the weights of
    what recordings are compared with, trained on all groups.

    `score` takes groups left out (s,), their `rows` (q,), and whether those who decide on the
    others did not see them either. It returns decisions on the recordings left out, (M,P,q), and on
    every other group by itself left out too, (M,P,n), 0 where they are left out.
    """

    groups: Ints
    starts: Ints
    weights: Floats
    targets: Floats
    duals: Floats
    score: Callable[[Ints, Ints, bool], tuple[Floats, Floats]]

    def rows(self, groups: Ints) -> Ints:
        """Return the rows of some groups (s,), one group after the other."""
        ranges = [np.arange(self.starts[g], self.starts[g + 1]) for g in groups]
        return np.concatenate([NOBODY[0], *ranges])


def object_weights(objects: Ints) -> Floats:
    """Return the weight of each recording (n,) in a stacker's loss: every object has 2 in all."""
    _, object_of, sizes = np.unique(objects, return_inverse=True, return_counts=True)
    return np.asarray(2.0 / sizes[object_of.ravel()])


def kernel_problem(grams: Floats, truth: Bools, groups: Ints, noise: float) -> Problem:
    """Invert C of each kernel: grams (M,n,n), truth (n,P), groups (n,) rising."""
    names, starts = np.unique(groups, return_index=True)
    starts = np.append(starts, len(groups))
    targets = np.ascontiguousarray(np.where(truth, 1.0, -1.0).T)
    # C^-1 of C = K + lambda I, symmetric to the last bit; its products C^-1 y with the targets
    inverses = np.linalg.inv(grams + noise * np.eye(len(groups)))
    inverses = (inverses + inverses.transpose(0, 2, 1)) / 2
    duals = targets @ inverses

    def score(left_out: Ints, rows: Ints, nested: bool) -> tuple[Floats, Floats]:
        decisions, others = score_without(
            left_out, rows, inverses, duals, targets, starts=starts, nested=nested
        )
        return decisions, others  # of a kernel mypy knows no type

    weights = object_weights(groups)
    return Problem(names, starts, weights, targets, duals=duals, score=score)


def landmark_problem(
    kernels: Floats,
    landmarks: Floats,
    truth: Bools,
    groups: tuple[Ints, Ints],
    noise: float,
) -> Problem:
    """Build the normal equations of recordings that are compared with landmarks; groups are folds.

    Kernels (M,n,m) are of recordings with landmarks, `landmarks` (M,m,m) those of landmarks with
    each other, truth (n,P), groups the folds (n,), rising, and the objects (n,).
    """
    folds, objects = groups
    names, starts = np.unique(folds, return_index=True)
    starts = np.append(starts, len(folds))
    targets = np.ascontiguousarray(np.where(truth, 1.0, -1.0).T)
    n_kernels, _, m = kernels.shape
    k = len(names)
    features = np.empty(kernels.shape)
    grams = np.zeros((n_kernels, 1 + k, m, m))  # of all features + noise, and of each fold
    products = np.zeros((n_kernels, 1 + k, m, len(targets)))  # with the targets, the same
    duals = np.empty((n_kernels, len(targets), m))
    for i in range(n_kernels):
        # phi(x) = L^-1 k(x) of every recording, and its normal equations, fold by fold.
        factor = np.linalg.cholesky(landmarks[i] + _JITTER * np.trace(landmarks[i]) * np.eye(m))
        features[i] = solve_triangular(factor, kernels[i].T, lower=True, check_finite=False).T
        for fold, (start, end) in enumerate(pairwise(starts), start=1):
            of_fold = features[i, start:end]
            grams[i, fold] = of_fold.T @ of_fold
            products[i, fold] = of_fold.T @ targets[:, start:end].T
        grams[i, 0] = grams[i].sum(axis=0) + noise * np.eye(m)
        products[i, 0] = products[i].sum(axis=0)
        (ridge_weights,) = _ridge_weights(grams[i : i + 1], products[i : i + 1], names[:0])
        duals[i] = solve_triangular(factor.T, ridge_weights, check_finite=False).T

    def score(left_out: Ints, rows: Ints, nested: bool) -> tuple[Floats, Floats]:
        decisions = np.zeros((n_kernels, *targets.shape))
        for fold in np.setdiff1d(np.arange(k), left_out):
            others = slice(starts[fold], starts[fold + 1])
            out = np.append(left_out if nested else [], fold).astype(np.int64)
            decisions[:, :, others] = decide(out, features[:, others])
        return decide(left_out, features[:, rows]), decisions

    def decide(left_out: Ints, some: Floats) -> Floats:
        return np.asarray((some @ _ridge_weights(grams, products, left_out)).transpose(0, 2, 1))

    weights = object_weights(objects)
    return Problem(names, starts, weights, targets, duals=duals, score=score)


def _ridge_weights(grams: Floats, products: Floats, left_out: Ints) -> Floats:
    """Solve the normal equations of each kernel without some folds, (M,m,P)."""
    weights = np.empty((len(grams), *products.shape[2:]))
    for i, (gram, product) in enumerate(zip(grams, products, strict=True)):
        # (sum over the other folds of F'F + lambda I) w = sum over the other folds of F'y
        matrix = gram[0].copy()
        for fold in left_out:
            matrix -= gram[1 + fold]
        factor = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
        rest = product[0] - product[1 + left_out].sum(axis=0)
        weights[i] = cho_solve(factor, rest, check_finite=False)
    return weights


class LeftOut(NamedTuple):
    """Stackers that never saw some sets S of groups, and their log-odds on these groups.

    Weights (S,P,1+M) are intercept and slopes, log-odds (P,q) of each set's recordings in the order
    of `Problem.rows`, losses (S,P) those on the decisions it learned from, ridge included.
    """

    weights: Floats
    log_odds: list[Floats]
    losses: Floats


def leave_out(
    problem: Problem, sets: Ints, settings: PerceptionSettings, warm: Floats | None = None
) -> LeftOut:
    """Fit stackers without each of the sets (S,s) of groups, numbered as in the problem.

    `warm` (P,1+M) is where the search starts; the optimum is unique.
    """
    n_kernels, n_targets, _ = problem.duals.shape
    weights = np.zeros((len(sets), n_targets, 1 + n_kernels))
    losses = np.zeros((len(sets), n_targets))
    log_odds = []
    for index, left_out in enumerate(np.asarray(sets, dtype=np.int64)):
        rows = problem.rows(left_out)
        held, decisions = problem.score(left_out, rows, settings.nested)
        remaining = problem.weights.copy()
        remaining[rows] = 0.0  # the stacker does not learn from what is left out
        if warm is not None:
            weights[index] = warm
        fit_stackers(
            remaining,
            decisions.swapaxes(0, 1).copy(),
            problem.targets,
            ridge=RIDGE,
            nonnegative=settings.nonnegative,
            balanced=settings.balanced,
            weights=weights[index],  # written
            losses=losses[index],  # written
        )
        # log-odds on what is left out: intercept, and a slope for each kernel's decision
        slopes = np.einsum("mpq,pm->pq", held, weights[index, :, 1:])
        log_odds.append(weights[index, :, :1] + slopes)
    return LeftOut(weights, log_odds, losses)


def each_group(
    problem: Problem, settings: PerceptionSettings, warm: Floats | None = None
) -> Floats:
    """Score every recording by classifiers and stackers that never saw its group, (n,P)."""
    sets = np.arange(len(problem.groups))[:, None]
    return np.concatenate(leave_out(problem, sets, settings, warm).log_odds, axis=1).T


class AttributeProblem(NamedTuple):
    """Attributes (a,) whose labels are known together, and the problem of these recordings.

    Rows (r,) are the recordings, group by group; columns (c,) what the problem's duals weigh, of
    what recordings are compared with.
    """

    rows: Ints
    attributes: Ints
    columns: Ints
    problem: Problem


def attribute_problems(
    recordings: BehaviorRecordings, kernels: Floats, settings: PerceptionSettings, by_object: bool
) -> Iterator[AttributeProblem]:
    """Yield the problems of one behavior, by which labels are known together.

    What is left out as one are objects, or folds of them where there are many; not `by_object`,
    recordings or folds of recordings.
    """
    n = len(recordings.objects)
    landmarks = recordings.landmarks
    objects = recordings.objects if by_object else np.arange(n)
    groups = objects if landmarks is None else assign_folds(objects, settings.folds)
    for attributes, subset in recordings.by_known_labels():
        rows = np.flatnonzero(subset.labels[:, 0] >= 0)
        rows = rows[np.argsort(groups[rows], kind="stable")]
        truth = subset.labels[rows] == 1
        columns = rows if landmarks is None else np.arange(len(landmarks))
        if landmarks is None:
            problem = kernel_problem(kernels[:, rows][:, :, rows], truth, groups[rows], NOISE)
        else:
            folds_and_objects = (groups[rows], objects[rows])
            problem = landmark_problem(
                kernels[:, rows], kernels[:, landmarks], truth, folds_and_objects, NOISE
            )
        yield AttributeProblem(rows, attributes, columns, problem)


def fit(recordings: BehaviorRecordings, settings: PerceptionSettings) -> tuple[KernelFit, Floats]:
    """Fit one behavior: its classifiers and their stackers; and its nested outputs, (n,P).

    The nested output on a recording comes from classifiers and stackers that never saw its object;
    it is NaN where the label is unknown.
    """
    kernels = recordings.kernels(joint=settings.joint)
    n_kernels, _, m = kernels.shape
    n, n_attributes = recordings.labels.shape
    dual = np.zeros((n_kernels, n_attributes, m))
    weights = np.zeros((n_attributes, 1 + n_kernels))
    nested = np.full((n, n_attributes), np.nan)
    for part in attribute_problems(recordings, kernels, settings, settings.by_object):
        attributes = part.attributes
        problem = part.problem
        weights[attributes] = leave_out(problem, NOBODY, settings).weights[0]
        nested[np.ix_(part.rows, attributes)] = each_group(problem, settings, weights[attributes])
        dual[np.ix_(np.arange(n_kernels), attributes, part.columns)] = problem.duals
    return KernelFit(dual, Stacker(weights)), nested


def outputs(
    recordings: BehaviorRecordings, held: Ints, settings: PerceptionSettings
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables; of each object all labels are known, or none.

    Held (H,) are objects, or folds of them where there are many (see `assign_folds`). Returns the
    outputs (n,P) on what is held out, and for each of it those on the others, (H,n,P), NaN where
    none was computed; on itself they mean nothing.
    """
    kernels = recordings.kernels(joint=settings.joint)
    (part,) = attribute_problems(recordings, kernels, settings, by_object=True)
    problem = part.problem
    weights = leave_out(problem, NOBODY, settings).weights[0]
    held_outputs = np.full(recordings.labels.shape, np.nan)
    held_outputs[part.rows] = each_group(problem, settings, weights)
    # An object without labels or recordings is in no training set: what serves others serves it.
    training = np.tile(held_outputs, (len(held), 1, 1))
    # Unordered pairs of groups, at least one held out: each gives the training side of the other.
    pairs = np.stack(np.triu_indices(len(problem.groups), 1), axis=1)
    pairs = pairs[np.isin(problem.groups[pairs], held).any(axis=1)]
    both = leave_out(problem, pairs, settings, weights).log_odds
    rows = [part.rows[start:end] for start, end in pairwise(problem.starts)]
    for (first, second), scores in zip(pairs.tolist(), both, strict=True):
        of_first, of_second = np.split(scores.T, [len(rows[first])])
        training[np.ix_(held == problem.groups[first], rows[second])] = of_second
        training[np.ix_(held == problem.groups[second], rows[first])] = of_first
    unlabeled = np.setdiff1d(np.arange(len(held_outputs)), part.rows)
    across = kernels[:, unlabeled][:, :, part.columns]
    decisions = np.einsum("mbn,mpn->bmp", across, problem.duals)
    held_outputs[unlabeled] = Stacker(weights).log_odds(decisions)
    return held_outputs, training


# --- Widths of kernels

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # as `map`, in any order

WIDTHS = (1.0, 1.5, 2.0)  # in median distances


def learned_widths(
    behaviors: Iterable[BehaviorRecordings],
    settings: PerceptionSettings,
    held: Iterable[int] = (),
    map_behaviors: Map = map,
) -> tuple[float, Floats]:
    """Learn the factor of the kernels' widths, by all labels, and without each held object's, (H,).

    Where the settings fix a width it is the factor; it is 1 of other methods than "stacked".
    Held are objects, or folds of them where there are many. `map_behaviors` calls a function
    on every behavior, perhaps at once; results may come in any order.
    """
    groups = np.fromiter(held, np.int64)
    # Only the stackers' losses tell widths apart; of other methods the width is the median's.
    fixed = settings.width if settings.method == "stacked" else 1.0
    if fixed is not None:
        return fixed, np.full(len(groups), fixed)
    pieces = list(enumerate(behaviors))
    by_behavior = dict(
        map_behaviors(partial(_losses_of_widths, held=groups, settings=settings), pieces)
    )
    losses = np.zeros((len(WIDTHS), 1 + len(groups)))
    for index, _ in pieces:  # in their order, so that the sum is the same to the last bit
        losses += by_behavior[index]
    best = np.array(WIDTHS)[losses.argmin(axis=0)]
    return float(best[0]), best[1:]


def _losses_of_widths(
    piece: tuple[int, BehaviorRecordings], held: Ints, settings: PerceptionSettings
) -> tuple[int, Floats]:
    """Sum the stackers' losses over a behavior's attributes.

    Returns its number, and by width (W,1+H) the sums with all groups and without each held one.
    """
    index, recordings = piece
    total = np.zeros((len(WIDTHS), 1 + len(held)))
    # Sums of many threads differ in their last bit from those of one.
    with turn(), threadpool_limits(1):
        for w, width in enumerate(WIDTHS):
            wide = recordings.widened(width)
            kernels = wide.kernels(joint=settings.joint)
            for part in attribute_problems(wide, kernels, settings, by_object=True):
                problem = part.problem
                everyone = leave_out(problem, NOBODY, settings)
                (all_losses,) = (everyone.losses * _votes(problem, NOBODY)).sum(axis=1)
                total[w] += all_losses
                # Without a group that has no recording here the loss is that of all.
                present = np.flatnonzero(np.isin(held, problem.groups))
                sets = np.searchsorted(problem.groups, held[present])[:, None]
                without = leave_out(problem, sets, settings, everyone.weights[0])
                losses = (without.losses * _votes(problem, sets)).sum(axis=1)
                total[w, 1 + present] += losses - all_losses
    return index, total


def _votes(problem: Problem, sets: Ints) -> Floats:
    """Weight each attribute by its labels' variance without the sets, (S,P).

    A balanced loss is the noisier the smaller the rarer class.
    """
    true = np.add.reduceat((problem.targets > 0).astype(float), problem.starts[:-1], axis=1)
    sizes = np.diff(problem.starts)
    number = sizes.sum() - sizes[sets].sum(axis=1)
    fraction = (true.sum(axis=1) - true.T[sets].sum(axis=1)) / np.maximum(number, 1)[:, None]
    return np.asarray(fraction * (1.0 - fraction))
