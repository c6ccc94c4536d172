"""The rules by which a statement stands, falls, or is undecided."""

import doctest
import math

import pytest

from meal_bayes.evaluation import Interval
from paper_repro import frame, online, statements
from paper_repro.statements import (
    FALLS,
    STANDS,
    UNDECIDED,
    Evidence,
    above,
    at_least,
    below,
    best,
    constructed,
    every,
    fact,
    joined,
    mean_interval,
    verdict,
    within,
)


def interval(mean, reach):
    return Interval(mean, reach / 2, mean - reach, mean + reach)


@pytest.mark.parametrize("module", [frame, statements, online])
def test_examples_hold(module):
    found = doctest.testmod(module)
    assert found.attempted > 0
    assert found.failed == 0


@pytest.mark.parametrize(
    ("low", "high", "outcome"), [(0.1, 2, STANDS), (-2, -0.1, FALLS), (-1, 2, UNDECIDED),
                                 (0, 0, UNDECIDED)],
)  # fmt: skip
def test_a_difference_is_decided_by_its_whole_interval(low, high, outcome):
    found = Interval((low + high) / 2, 1.0, low, high)
    assert above(found, 0, 10).outcome == outcome
    turned = Interval(-found.estimate, 1.0, -high, -low)
    assert below(turned, 0, 10).outcome == outcome
    assert below(turned, 0, 10).interval == turned


@pytest.mark.parametrize(
    ("mean", "outcome"), [(1.0, STANDS), (3.0, FALLS), (1.5, UNDECIDED), (2.2, UNDECIDED)]
)
def test_a_number_stands_within_its_margin(mean, outcome):
    assert within(interval(mean, 0.6), 0.3, 2.0, 10).outcome == outcome


def test_needed_repeats_would_decide():
    found = above(interval(1.0, 3.0), 0, 20)
    assert found.needed == 180
    shorter = interval(1.0, 3.0 * math.sqrt(20 / (found.needed + 1)))
    assert above(shorter, 0, found.needed).outcome == STANDS
    assert above(interval(0.0, 0.0), 0, 20).needed is None  # no number decides a tie
    assert above(Interval(1.0, math.nan, math.nan, math.nan), 0, 1).outcome == UNDECIDED


def test_best_is_ahead_of_every_other_one():
    clear, tie, behind = interval(3, 1), interval(0.5, 1), interval(-3, 1)
    assert best({"a": clear, "b": clear}, 10).outcome == STANDS
    assert best({"a": clear, "b": tie}, 10).outcome == UNDECIDED
    found = best({"a": clear, "b": behind, "c": tie}, 10, ("own",))
    assert (found.outcome, found.interval) == (FALLS, behind)  # with the sign of its mean
    assert found.agents == ("own", "b")


@pytest.mark.parametrize(("count", "outcome"), [(1, STANDS), (3, FALLS), (2, UNDECIDED)])
def test_at_least_so_many_parts(count, outcome):
    parts = [above(interval(mean, 1), 0, 10) for mean in (2, 0.5, -2)]
    found = at_least(count, parts, of="parts")
    assert found.outcome == outcome
    assert (found.needed is None) == (outcome != UNDECIDED)


def test_a_statement_is_written_with_five_keys():
    open_ = above(interval(1, 2), 0, 10)
    (one,) = joined({"a": open_}, {"a": above(interval(3, 2), 0, 40)})
    told = one.as_dict()
    assert told == {"text": "a", "recorded": UNDECIDED, "published": STANDS, "repeats": 10,
                    "needed": open_.needed}  # fmt: skip
    (never,) = joined({"a": None}, None)
    assert never.as_dict() == {"text": "a", "recorded": None, "published": None, "repeats": 0,
                               "needed": None}  # fmt: skip


@pytest.mark.parametrize(
    ("own", "code", "begins"),
    [
        ([STANDS, STANDS], [None, None], "reproduced (2 stand)"),
        ([STANDS, FALLS], [STANDS, STANDS], "reproduced only in the published protocol"),
        ([STANDS, FALLS], [FALLS, STANDS], "not reproduced (1 stands, 1 falls; in the published"),
        ([STANDS, FALLS], [None, None], "not reproduced (1 stands, 1 falls)"),
        ([STANDS, UNDECIDED], [STANDS, STANDS], "undecided (1 stands, 1 undecided; in"),
        ([statements.CONSTRUCTED], [None], "by construction (1 by construction)"),
        ([STANDS, statements.CONSTRUCTED], [None, None], "reproduced (1 stands, 1 by constr"),
        ([None], [STANDS], "not run on recordings"),
        ([None], [None], "not run"),
        ([], [], "nothing to judge"),
    ],
)
def test_verdicts_follow_from_the_outcomes(own, code, begins):
    found = [{"recorded": a, "published": b} for a, b in zip(own, code, strict=True)]
    assert verdict(found).startswith(begins)


def test_runs_go_on_until_decided_or_the_steps_end():
    ran = []

    def run(agent, count):
        ran.append((agent, count))
        return count

    def judge(found):
        decided = fact(holds=True, rule="it does")
        if found["a"] < 20:
            decided = Evidence(UNDECIDED, "more", agents=("a",))
        return {"of a": decided, "of b": Evidence(UNDECIDED, "never", agents=("b",)),
                "of d": Evidence(UNDECIDED, "too far", needed=41, agents=("d",))}  # fmt: skip

    found, evidence = frame.until_decided("abcd", (10, 20, 40), run, judge)
    assert found == {"a": 20, "b": 40, "c": 10, "d": 10}
    assert evidence["of a"].outcome == STANDS
    assert evidence["of b"].outcome == UNDECIDED
    assert len(ran) == 7


def test_what_was_fitted_is_no_evidence():
    (one,) = joined({"fitted": constructed("a rate was chosen")}, None)
    assert one.as_dict()["recorded"] == "by construction"
    assert every([fact(holds=True, rule="a"), fact(holds=False, rule="b")]).outcome == FALLS


def test_all_right_is_not_certain():
    """The rule of three: nobody knows a rate from twelve successes."""
    found = mean_interval([1.0] * 12, range(12))
    assert (found.estimate, found.low, found.high) == (1.0, 0.75, 1.0)
    assert mean_interval([0.0] * 6, range(6)).high == 0.5
    assert mean_interval([37.1] * 6, range(6)).low == 37.1  # no rate
