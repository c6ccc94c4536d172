"""What a robot's detectors said so far: in words or in scores, and on which scale."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from meal_bayes.datasets.percepts import Said

_FEW = 5  # scores before which no scale is known
_SOME = 10  # scores of which all lie in 0 to 1 where the scale does
_BEYOND = 10.0  # times the largest score: another scale
_UNIT = 2.0  # what no probability or cosine exceeds, but for rounding
_SHARE = 0.25  # of the scores before that are as small as all of the last few

Pair = tuple[str, str]  # (behavior, attribute)


@dataclass
class Heard:
    """The words and scores of detectors, which a change of kind or of scale is told by.

    Attributes
    ----------
    words : set[Pair]
        Of which behaviors and attributes a detector said yes or no.
    scores : dict[Pair, list[float]]
        The scores of the others, in the order in which they came.
    """

    words: set[Pair] = field(default_factory=set)
    scores: dict[Pair, list[float]] = field(default_factory=dict)

    def take(self, behavior: str, said: Said) -> tuple[Said, list[str]]:
        """Return what of it can be believed, and what is wrong with the rest, a line each.

        A score that is beyond the scale of those before, and what is of another kind than they
        were, are left aside. A scale that has become smaller is told after a few scores, which
        count.
        """
        faults = list[str]()
        taken = Said({}, {})
        for name, sure in said.sure.items():
            if before := self.scores.get((behavior, name)):
                faults.append(
                    f"{name!r} is yes or no, and earlier it was a score, from {_range(before)}; "
                    "give one kind; it is left aside"
                )
                continue
            self.words.add((behavior, name))
            taken.sure[name] = sure
        for name, score in said.scores.items():
            if (behavior, name) in self.words:
                faults.append(
                    f"{name!r} is the score {score:.3g}, and earlier it was yes or no; give one "
                    "kind; it is left aside"
                )
                continue
            before = self.scores.setdefault((behavior, name), [])
            if _beyond(before, score):
                faults.append(
                    f"{name!r} is the score {score:.3g}, and the {len(before)} before were from "
                    f"{_range(before)}: another scale; it is left aside"
                )
                continue
            before.append(score)
            taken.scores[name] = score
            faults.extend(_shrunk(name, before))
        return taken, faults


def _beyond(before: list[float], score: float) -> bool:
    """Return whether a score can hardly be of the scale of those before it."""
    if len(before) < _FEW:
        return False
    most = max(map(abs, before))
    if len(before) >= _SOME and min(before) >= 0 and most <= 1:
        return abs(score) > _UNIT
    return abs(score) > _BEYOND * max(most, 1.0)


def _shrunk(name: str, scores: list[float]) -> Iterator[str]:
    """Yield a line where the last few scores are of a smaller scale than those before."""
    before, last = np.abs(scores[:-_FEW]), np.abs(scores[-_FEW:])
    if len(before) < _SOME:
        return
    most = last.max()
    if _BEYOND * most < before.max() and (before <= most).mean() < _SHARE:
        yield (
            f"the last {_FEW} scores of {name!r} are from {_range(scores[-_FEW:])}, and the "
            f"{len(before)} before were from {_range(scores[:-_FEW])}: another scale? They count"
        )


def _range(scores: list[float]) -> str:
    return f"{min(scores):.3g} to {max(scores):.3g}"
