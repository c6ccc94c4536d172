"""The default method: closed-form kernel classifiers, combined by a stacker [Wolpert1992].

There is a classifier for each modality and one for all modalities together. Outputs on a group of
recordings come from classifiers and stackers without this group; groups are objects, or folds of
many objects. With C = gram + noise and targets y = +-1, a kernel-ridge classifier without the
recordings G has the decisions y_G - inv(C^-1[G,G]) (C^-1 y)_G on them [Cawley2006]. So one inverse
for each modality is enough for all attributes, objects and pairs of objects.

With many recordings, each is compared with m landmarks, whose kernel is L L'. A recording x has m
features phi(x) = L^-1 k(x), whose products approximate its kernels (Nyström's approximation
[Williams2001]). A ridge regression on these features is a kernel ridge regression. Its normal
equations are sums over folds of objects, so leaving out folds subtracts their parts. The cost is
linear in the number of recordings.

The width of all kernels is the median distance times a factor that is learned from the labels. A
narrow kernel separates objects if recordings are informative. A wide kernel allows only smooth
functions, which can be learned from a few objects with noisy recordings. The factor is the same for
all behaviors. It minimizes the loss of the stackers on decisions by classifiers without the object,
summed over attributes and behaviors. The labels of a held-out object are not used.
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
RIDGE = 0.5  # ridge on the slopes of stackers
NOBODY = np.empty((1, 0), np.int64)  # one empty set of groups
_JITTER = 1e-9  # added to the landmarks' kernel, which may be singular if two are equal


class Stacker(NamedTuple):
    """A class-balanced logistic regression on M classifiers' decisions: `weights` (P,1+M)."""

    weights: Floats

    def log_odds(self, decisions: Floats) -> Floats:
        """Return log-odds with prior 1/2, (B,P), from decisions (B,M,P); NaN counts as 0."""
        slopes: Floats = np.einsum("bmp,pm->bp", np.nan_to_num(decisions), self.weights[:, 1:])
        return slopes + self.weights[:, 0]


class KernelFit(NamedTuple):
    """Classifiers for M kernels (of the modalities, and perhaps a joint one), and their stacker.

    `dual` (M,P,m) contains the weight of each recording, or landmark, in the decisions.
    """

    dual: Floats
    pool: Stacker

    def scored(self, spaces: Sequence[FeatureSpace], rows: Rows) -> Floats:
        """Return log-odds of "true", (B,P); the joint kernel uses the modalities that are given."""
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
    """Recordings of one behavior with known labels, sorted by group.

    Attributes
    ----------
    groups : Ints
        (k,) groups in increasing order.
    starts : Ints
        (k+1,) first recording of each group.
    weights : Floats
        (n,) weight of each recording in the loss of a stacker; each object has 2 in total.
    targets : Floats
        (P,n) labels as +-1.
    duals : Floats
        (M,P,m) weights of recordings or landmarks in classifiers that are trained on all groups.
    score : Callable[[Ints, Ints, bool], tuple[Floats, Floats]]
        Function of the left-out groups (s,), their rows (q,), and whether the classifiers for the
        other groups are trained without the left-out groups, too. It returns decisions on the
        left-out rows, (M,P,q), and decisions on all other groups by classifiers without the group,
        (M,P,n), which are 0 on the left-out rows.
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
    """Return the weight of each recording (n,) in a stacker's loss: 2 in total for each object."""
    _, object_of, sizes = np.unique(objects, return_inverse=True, return_counts=True)
    return np.asarray(2.0 / sizes[object_of.ravel()])


def kernel_problem(grams: Floats, truth: Bools, groups: Ints, noise: float) -> Problem:
    """Build the problem with the inverse C^-1 of each kernel.

    Grams are (M,n,n), truth is (n,P), and groups (n,) are in increasing order.
    """
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
    """Build the problem of recordings that are compared with landmarks, with folds as groups.

    Kernels (M,n,m) are between recordings and landmarks, and `landmarks` (M,m,m) between landmarks.
    Truth is (n,P). `groups` contains the folds (n,) in increasing order and the objects (n,).
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
    """Stackers that were fitted without some sets S of groups, and their log-odds on these groups.

    Attributes
    ----------
    weights : Floats
        (S,P,1+M) intercepts and slopes.
    log_odds : list[Floats]
        (P,q) log-odds of the recordings of each set, in the order of `Problem.rows`.
    losses : Floats
        (S,P) losses on the decisions from which the stackers learned, including the ridge.
    """

    weights: Floats
    log_odds: list[Floats]
    losses: Floats


def leave_out(
    problem: Problem, sets: Ints, settings: PerceptionSettings, warm: Floats | None = None
) -> LeftOut:
    """Fit stackers without each of the sets (S,s) of groups, which are positions in the problem.

    `warm` (P,1+M) is the starting point; it does not influence the result.
    """
    n_kernels, n_targets, _ = problem.duals.shape
    weights = np.zeros((len(sets), n_targets, 1 + n_kernels))
    losses = np.zeros((len(sets), n_targets))
    log_odds = []
    for index, left_out in enumerate(np.asarray(sets, dtype=np.int64)):
        rows = problem.rows(left_out)
        held, decisions = problem.score(left_out, rows, settings.nested)
        remaining = problem.weights.copy()
        remaining[rows] = 0.0  # the stacker does not learn from left-out recordings
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
        # log-odds on left-out recordings: intercept, and a slope for each kernel's decision
        slopes = np.einsum("mpq,pm->pq", held, weights[index, :, 1:])
        log_odds.append(weights[index, :, :1] + slopes)
    return LeftOut(weights, log_odds, losses)


def each_group(
    problem: Problem, settings: PerceptionSettings, warm: Floats | None = None
) -> Floats:
    """Score every recording by classifiers and stackers without its group, (n,P)."""
    sets = np.arange(len(problem.groups))[:, None]
    return np.concatenate(leave_out(problem, sets, settings, warm).log_odds, axis=1).T


class AttributeProblem(NamedTuple):
    """Attributes (a,) whose labels are known for the same recordings, and their problem.

    Rows (r,) are the recordings, sorted by group. Columns (c,) are the recordings or landmarks to
    which the duals of the problem belong.
    """

    rows: Ints
    attributes: Ints
    columns: Ints
    problem: Problem


def attribute_problems(
    recordings: BehaviorRecordings, kernels: Floats, settings: PerceptionSettings, by_object: bool
) -> Iterator[AttributeProblem]:
    """Yield a problem for each set of attributes whose labels are known for the same recordings.

    The groups that are left out are objects, or folds of many objects. If not `by_object`, they are
    recordings, or folds of recordings.
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
    """Fit the classifiers and stackers of one behavior; also return its nested outputs, (n,P).

    The nested output on a recording comes from classifiers and stackers without its object. It is
    NaN if the label is unknown.
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
    """Score one behavior for percept tables; all labels of an object must be known, or none.

    Parameters
    ----------
    recordings : BehaviorRecordings
        Recordings of the behavior.
    held : Ints
        (H,) held-out objects, or folds of many objects (see `assign_folds`).
    settings : PerceptionSettings
        Settings of the classifiers.

    Returns
    -------
    held_outputs : Floats
        (n,P) outputs on held-out recordings.
    training : Floats
        (H,n,P) outputs on the other recordings for each held-out group; NaN if none was computed.
        Outputs on the held-out group itself are not valid.
    """
    kernels = recordings.kernels(joint=settings.joint)
    (part,) = attribute_problems(recordings, kernels, settings, by_object=True)
    problem = part.problem
    weights = leave_out(problem, NOBODY, settings).weights[0]
    held_outputs = np.full(recordings.labels.shape, np.nan)
    held_outputs[part.rows] = each_group(problem, settings, weights)
    # An object without labels or recordings is in no training set, so nothing changes without it.
    training = np.tile(held_outputs, (len(held), 1, 1))
    # Pairs of groups of which at least one is held out; each gives training-side outputs.
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
    """Learn the factor of the kernels' widths, with all labels and without those of each group.

    Returns the factor with all labels, and the factors (H,) without each held-out group. If the
    settings fix a width, it is the factor; for methods other than "stacked", the factor is 1.
    `held` contains objects, or folds of many objects. `map_behaviors` applies a function to all
    behaviors, possibly in parallel, and may return results in any order.
    """
    groups = np.fromiter(held, np.int64)
    # The width is learned by the losses of stackers; other methods use the median distance.
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
    """Sum the losses of stackers over the attributes of a behavior.

    Returns the number of the behavior and, for each width, the sums with all groups and without
    each held-out group, (W,1+H).
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
                # Without a group that has no recordings here, the loss is that of all groups.
                present = np.flatnonzero(np.isin(held, problem.groups))
                sets = np.searchsorted(problem.groups, held[present])[:, None]
                without = leave_out(problem, sets, settings, everyone.weights[0])
                losses = (without.losses * _votes(problem, sets)).sum(axis=1)
                total[w, 1 + present] += losses - all_losses
    return index, total


def _votes(problem: Problem, sets: Ints) -> Floats:
    """Return the weight of each attribute, the variance of its labels without the sets, (S,P).

    A balanced loss has more noise if the rarer class is small.
    """
    true = np.add.reduceat((problem.targets > 0).astype(float), problem.starts[:-1], axis=1)
    sizes = np.diff(problem.starts)
    number = sizes.sum() - sizes[sets].sum(axis=1)
    fraction = (true.sum(axis=1) - true.T[sets].sum(axis=1)) / np.maximum(number, 1)[:, None]
    return np.asarray(fraction * (1.0 - fraction))
