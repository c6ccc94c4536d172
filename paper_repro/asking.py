"""What asking a person is worth in the published code, exactly and without a planner.

There a person's whole answer is right with one probability, however many attributes are asked, and
wrong answers are equally likely (errata, 25). Who asks until two answers agree, and reports these,
earns a lower bound of the optimum, whatever else a robot may do, and however it plans.
"""

from typing import NamedTuple


class Asked(NamedTuple):
    """Expected outcome of a trial that asks until two answers agree."""

    asks: float
    accuracy: float

    def reward(self, cost: float, worth: float) -> float:
        """Return the expected reward where an ask has a cost and a report is worth +-`worth`."""
        return worth * (2 * self.accuracy - 1) - cost * self.asks


def ask_until_two_agree(attributes: int, right: float) -> Asked:
    """Compute how often it asks, and how often the answer that came twice is right.

    With K = 2^N answers a wrong one comes with probability (1 - right) / (K - 1). All answers so
    far differ: whether the right one is among them, and how many wrong ones, is all that matters.

    Parameters
    ----------
    attributes : N that are asked at once.
    right : Pr(the whole answer is right).

    >>> ask_until_two_agree(1, 1.0)
    Asked(asks=2.0, accuracy=1.0)
    """
    others = 2**attributes - 1
    wrong = (1 - right) / others
    # What follows, where the right answer is among those so far, and where it is not; from the end
    # backwards: when all wrong answers have come, one of those so far comes again.
    with_right = Asked(asks=0.0, accuracy=0.0)
    without = Asked(asks=0.0, accuracy=0.0)
    for heard in range(others, -1, -1):  # wrong ones so far; one of them again ends it as well
        new = (others - heard) * wrong  # Pr(a wrong answer that has not come yet)
        with_right = Asked(
            asks=1 + new * with_right.asks,
            accuracy=right + new * with_right.accuracy,
        )
        without = Asked(
            asks=1 + new * without.asks + right * with_right.asks,
            accuracy=new * without.accuracy + right * with_right.accuracy,
        )
    return without
