"""Fig. 9: what asking a person is worth in the published code, exactly."""

from collections.abc import Mapping
from typing import NamedTuple

from paper_repro.frame import Result, Setting, Table, paper_values
from paper_repro.statements import THEIRS, Evidence, fact


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


IRRELEVANT = (0, 1, 2, 3, 4, 5)
RELEVANT = 2
NOTE = """In the published code a person's whole answer is right with .65, as the plotted files'
names say, however many attributes are asked, and wrong answers are equally likely (errata, 25).
Whoever asks until two answers agree, and reports these, earns what the table shows, ever more with
more attributes, up to 500 - 100 x 2 / .65 = 192, as two wrong answers hardly agree by chance. It is
arithmetic, without a planner and without percepts, and the optimum is no less. So a reward below 25
at the right end of Fig. 9 is that of another `ask`, or of a solver that had not converged. SARSOP
with 5 s, the paper's solver, gives up all where each attribute of an answer is right with .65 on
its own ([pomdpsol](pomdpsol.md)); by that `ask` tree search ends near 25 ([fig9](fig9.md))."""


def run(setting: Setting) -> Result:
    """Compute the policy's value at every number of irrelevant attributes."""
    right = paper_values("plotted")["ask_accuracy"]
    asked = {k: ask_until_two_agree(RELEVANT + k, right) for k in IRRELEVANT}
    first = reward_of(asked[IRRELEVANT[0]])
    last = reward_of(asked[IRRELEVANT[-1]])
    columns = ("irrelevant", "asks", "accuracy, all", "reward")
    rows = tuple((k, *asking, reward_of(asking)) for k, asking in asked.items())
    printed = paper_values("fig9")["last_reward_below"]
    return Result(
        title="What the published `ask` is worth beside irrelevant attributes, exactly",
        sentence=f"By the published code's `ask` the best reward with {IRRELEVANT[0]} to "
        f"{IRRELEVANT[-1]} irrelevant attributes is at least {first:.0f} to {last:.0f}; "
        f"the paper draws less than {printed:g} at the end.",
        tables=(Table("asking until two answers agree", columns, rows),),
        evidence={THEIRS: judge(asked)},
        notes=(NOTE,),
        effects={
            "25": f"the best reward on ISPY32 with 2 relevant attributes and {IRRELEVANT[-1]} "
            f"others is at least {last:.0f} where the whole answer is right with .65"
        },
    )


def judge(asked: Mapping[int, Asked]) -> dict[str, Evidence | None]:
    """Judge the end of the curve by a bound of the optimum; one that is too low decides nothing."""
    low = paper_values("fig9")["last_reward_below"]
    (k, last) = list(asked.items())[-1]
    bound = reward_of(last)
    rule = f"asking until two answers agree earns {bound:.1f} with {k} irrelevant attributes"
    text = f"by the published code's `ask` a planner that has converged ends below {low:g}"
    return {text: fact(False, rule) if bound >= low else Evidence(rule=rule)}


def reward_of(asking: Asked) -> float:
    """Return the expected reward by what the plotted files' names say."""
    return asking.reward(paper_values("plotted")["ask_cost"], paper_values("offline_reward"))
