"""How wide the kernels are: learned from the labels, one factor for all behaviors of a robot.

A narrow kernel tells objects apart where recordings say much; a wide one knows a few smooth
functions, which is all that a few objects of weak recordings can teach. Which of them a data set
wants is told by the stackers' own loss: how well the modalities, pooled, fit decisions of
classifiers on objects that these never saw. All attributes and behaviors vote, so the label of no
single object matters; nevertheless a held-out object's own labels have no vote on its width.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from meal_bayes.perception.leave_out import NOBODY, Problem, leave_out
from meal_bayes.perception.recordings import BehaviorRecordings
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacked import parts

WIDTHS = (1.0, 1.5, 2.0)  # in median distances

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # as `map`, in any order


def learned_widths(
    behaviors: Iterable[BehaviorRecordings],
    settings: PerceptionSettings,
    held: Iterable[int] = (),
    each: Map = map,
) -> tuple[float, Floats]:
    """Learn by which factor kernels of the behaviors' recordings are to be widened.

    Parameters
    ----------
    held : objects, or folds of them where there are many, each left out in turn.
    each : calls a function on every piece of work, a behavior each; results come in any order.

    Returns
    -------
    The factor of a robot that knows all labels, and those (H,) of robots that know all but the
    held one's. It is what the settings say where they say something, and 1 where there is no RBF or
    no stacker.
    """
    groups = np.fromiter(held, np.int64)
    fixed = settings.width if (settings.recipe, settings.kernel) == ("stacked", "rbf") else 1.0
    if fixed is not None:
        return fixed, np.full(len(groups), fixed)
    pieces = list(enumerate(behaviors))
    found = dict(each(partial(_losses_of_widths, held=groups, settings=settings), pieces))
    losses = np.zeros((len(WIDTHS), 1 + len(groups)))
    for index, _ in pieces:  # in their order, so that the sum is the same to the last bit
        losses += found[index]
    best = np.array(WIDTHS)[losses.argmin(axis=0)]
    return float(best[0]), best[1:]


def _losses_of_widths(
    piece: tuple[int, BehaviorRecordings], held: Ints, settings: PerceptionSettings
) -> tuple[int, Floats]:
    """Return a behavior's number and its losses by width, (W,1+H)."""
    index, recordings = piece
    with threadpool_limits(1):  # sums of many threads differ in their last bit from those of one
        return index, np.stack(
            [_losses(recordings.widened(width), held, settings) for width in WIDTHS]
        )


def _losses(recordings: BehaviorRecordings, held: Ints, settings: PerceptionSettings) -> Floats:
    """Sum the stackers' losses over attributes: with all groups, and without each held one."""
    total = np.zeros(1 + len(held))
    for part in parts(recordings, recordings.kernels(joint=settings.joint), settings):
        problem = part.problem
        everyone = leave_out(problem, NOBODY, settings)
        (all_losses,) = (everyone.losses * _votes(problem, NOBODY)).sum(axis=1)
        total += all_losses
        present = np.flatnonzero(np.isin(held, problem.groups))
        sets = np.searchsorted(problem.groups, held[present])[:, None]
        without = leave_out(problem, sets, settings, everyone.weights[0])
        total[1 + present] += (without.losses * _votes(problem, sets)).sum(axis=1) - all_losses
    return total


def _votes(problem: Problem, sets: Ints) -> Floats:
    """Weigh each attribute by its labels' variance without the sets, (S,P).

    A balanced loss is as noisy as the rarer class is small.
    """
    true = np.add.reduceat((problem.targets > 0).astype(float), problem.starts[:-1], axis=1)
    sizes = np.diff(problem.starts)
    number = sizes.sum() - sizes[sets].sum(axis=1)
    share = (true.sum(axis=1) - true.T[sets].sum(axis=1)) / np.maximum(number, 1)[:, None]
    return np.asarray(share * (1.0 - share))
