"""How wide the kernels are: wider than the median distance by one factor, learned from the labels.

A narrow kernel separates objects where recordings are informative; a wide one has few smooth
functions, as many as a few objects of noisy recordings determine. The factor is one for all
behaviors, and minimizes the loss of the stackers on decisions of classifiers on objects that these
never saw, summed over attributes and behaviors. A held-out object's own labels have no part in it.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from meal_bayes.arrays import Floats, Ints
from meal_bayes.perception.feature_spaces import BehaviorRecordings
from meal_bayes.perception.kernel_ridge import NOBODY, Problem, attribute_problems, leave_out
from meal_bayes.perception.settings import PerceptionSettings

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
    with threadpool_limits(1):  # sums of many threads differ in their last bit from those of one
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
