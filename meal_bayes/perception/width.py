"""How wide the kernels are: learned from the labels, one factor for all behaviors of a robot.

A narrow kernel tells objects apart where recordings say much; a wide one knows a few smooth
functions, which is all that a few objects of weak recordings can teach. Which of them a data set
wants is told by the stackers' own loss: how well the modalities, pooled, fit decisions of
classifiers on objects that these never saw. All attributes and behaviors vote, so the label of no
single object matters; nevertheless a held-out object's own labels have no vote on its width.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from meal_bayes.perception.leave_out import NOBODY, KernelProblem, leave_out, problems
from meal_bayes.perception.modality import with_joint
from meal_bayes.perception.recordings import BehaviorRecordings
from meal_bayes.perception.settings import PerceptionSettings

WIDTHS = (1.0, 1.5, 2.0)  # in median distances

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


def learned_widths(
    behaviors: Sequence[BehaviorRecordings],
    settings: PerceptionSettings,
    held: Iterable[int] = (),
) -> tuple[float, Floats]:
    """Learn by which factor kernels of the behaviors' recordings are to be widened.

    Parameters
    ----------
    held : objects, each left out in turn.

    Returns
    -------
    The factor of a robot that knows all labels, and those (H,) of robots that know all but one
    object's. It is what the settings say where they say something, and 1 where there is no RBF or
    no stacker.
    """
    objects = np.fromiter(held, np.int64)
    fixed = settings.width if (settings.recipe, settings.kernel) == ("stacked", "rbf") else 1.0
    if fixed is not None:
        return fixed, np.full(len(objects), fixed)
    losses = np.zeros((len(WIDTHS), 1 + len(objects)))
    for index, width in enumerate(WIDTHS):
        for recordings in behaviors:
            losses[index] += _losses(recordings.widened(width), objects, settings)
    best = np.array(WIDTHS)[losses.argmin(axis=0)]
    return float(best[0]), best[1:]


def _losses(recordings: BehaviorRecordings, held: Ints, settings: PerceptionSettings) -> Floats:
    """Sum the stackers' losses over attributes: with all objects, and without each held one."""
    total = np.zeros(1 + len(held))
    grams = with_joint(recordings.grams) if settings.joint else recordings.grams
    objects = recordings.objects
    for _, _, problem in problems(grams, recordings.labels, objects, settings.noise):
        everyone = leave_out(problem, NOBODY, settings)
        (all_losses,) = (everyone.losses * _votes(problem, NOBODY)).sum(axis=1)
        total += all_losses
        present = np.flatnonzero(np.isin(held, problem.objects))
        sets = np.searchsorted(problem.objects, held[present])[:, None]
        without = leave_out(problem, sets, settings, everyone.weights[0])
        total[1 + present] += (without.losses * _votes(problem, sets)).sum(axis=1) - all_losses
    return total


def _votes(problem: KernelProblem, sets: Ints) -> Floats:
    """Weigh each attribute by its labels' variance without the sets, (S,P).

    A balanced loss is as noisy as the rarer class is small.
    """
    true = np.add.reduceat((problem.targets > 0).astype(float), problem.starts[:-1], axis=1)
    sizes = np.diff(problem.starts)
    number = sizes.sum() - sizes[sets].sum(axis=1)
    share = (true.sum(axis=1) - true.T[sets].sum(axis=1)) / np.maximum(number, 1)[:, None]
    return np.asarray(share * (1.0 - share))
