"""The rules by which a statement stands, falls, or is undecided."""

import doctest
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from meal_bayes.evaluation import Estimate, clustered, paired_fractions, resampled
from paper_repro import frame, inference, statements
from paper_repro.inference import (
    bootstrap_interval,
    change_of_means,
    holm,
    level_above,
    level_below,
    needed,
)
from paper_repro.statements import (
    CONSTRUCTED,
    FALLS,
    RECORDED,
    STANDS,
    THEIRS,
    UNDECIDED,
    above,
    below,
    best,
    constructed,
    every,
    fact,
    judged,
    placed,
    placed_below,
    verdict,
    within,
)

KEYS = {"text", "where", "protocol", "central", "outcome", "rule", "method", "estimate",
        "interval", "units", "level", "needed", "smallest", "parts", "error", "cases",
        "sides"}  # fmt: skip


def effect(mean, se=0.5, **options):
    return Estimate(mean, se, 20, **options)


def outcome(evidence, level=0.05):
    return evidence.judge(level)["outcome"]


@pytest.mark.parametrize("module", [frame, inference, statements])
def test_examples_hold(module):
    tally = doctest.testmod(module)
    assert tally.attempted > 0
    assert tally.failed == 0


@pytest.mark.parametrize(("mean", "kind"), [(2, STANDS), (-2, FALLS), (0.5, UNDECIDED)])
def test_a_difference_is_decided_by_its_whole_interval(mean, kind):
    assert outcome(above(effect(mean), 0)) == kind
    assert outcome(below(effect(-mean), 0)) == kind
    told = above(effect(mean), 0).judge(0.05)
    assert (told["interval"][0] > 0) == (kind == STANDS)
    assert (told["interval"][1] < 0) == (kind == FALLS)


@pytest.mark.parametrize(
    ("mean", "kind"), [(1.0, STANDS), (4.0, FALLS), (1.8, UNDECIDED), (2.5, UNDECIDED)]
)
def test_a_number_stands_within_its_margin(mean, kind):
    assert outcome(within(effect(mean, 0.3), 0.2, 2.0)) == kind


def test_what_would_decide_is_told_in_splits():
    assert above(effect(0.5), 0).judge(0.05)["needed"] is None  # nobody can draw objects
    told = above(effect(0.5, cluster="splits"), 0).judge(0.05)
    assert told["needed"].endswith(" splits")
    assert int(told["needed"].split()[0]) > 20
    fixed = above(effect(0.5, fixed=0.2, cluster="splits"), 0).judge(0.05)
    assert fixed["needed"] is None  # more splits are not more objects
    assert above(effect(0.0), 0).judge(0.05)["needed"] is None
    assert above(effect(2.0), 0).judge(0.05)["needed"] is None


def test_best_is_ahead_of_every_other_one():
    clear = effect(3)
    tie = effect(0.2)
    behind = effect(-3)
    assert outcome(best({"a": clear, "b": clear}, of="it")) == STANDS
    assert outcome(best({"a": clear, "b": tie}, of="it")) == UNDECIDED
    told = best({"a": clear, "b": behind, "c": tie}, of="it").judge(0.05)
    assert (told["outcome"], told["estimate"]) == (FALLS, -3)
    assert told["rule"] == "it: the lead over b is above 0"


def test_many_parts_pay_for_the_one_that_falls():
    close = effect(-1.2)  # p = .027
    assert outcome(above(close, 0)) == FALLS
    assert outcome(every([above(close, 0), above(effect(3), 0)])) == UNDECIDED


def test_a_family_is_judged_by_holm():
    close = {f"{n}": above(effect(1.2), 0) for n in range(4)}  # p = .027 each
    rows = judged({RECORDED: close}, ["*"], "Fig. 1")
    assert [row["outcome"] for row in rows] == [UNDECIDED] * 4
    assert rows[0]["level"] == pytest.approx(0.05 / 4)
    alone = judged({RECORDED: {"1": above(effect(1.2), 0)}, THEIRS: close}, ["*"], "Fig. 1")
    assert alone[0]["outcome"] == STANDS


@pytest.mark.long
def test_no_effect_gives_few_false_outcomes_over_fig_10_s_family():
    rng = np.random.default_rng(0)
    false = 0
    for _ in range(400):
        drawn = rng.normal(0, 0.5, 30)
        family = {
            f"{n}": above(Estimate(estimate, 0.5, 200), 0) for n, estimate in enumerate(drawn)
        }
        false += any(row["outcome"] != UNDECIDED for row in judged({RECORDED: family}, ["*"], ""))
    assert false / 400 <= 0.08  # 5 %, and three standard errors of 400 families


def test_every_statement_is_written_with_all_that_it_rests_on():
    evidence = {
        THEIRS: {"a": above(effect(1), 0), "b": fact(holds=True, rule="it does")},
        RECORDED: {"a": placed(np.arange(10.0), 4.0, of="x"), "c": constructed("fitted")},
    }
    rows = judged(evidence, ["a"], "Fig. 1")
    assert all(set(row) == KEYS for row in rows)
    assert [row["central"] for row in rows] == [True, False, True, False]


@pytest.mark.parametrize(("printed", "kind"), [(4.5, UNDECIDED), (40.0, FALLS)])
def test_a_single_trial_falls_or_proves_nothing(printed, kind):
    evidence = placed([*range(10), np.nan], printed, of="x")
    assert evidence.outcome == kind
    assert outcome(placed([1.0], printed, of="x")) == UNDECIDED


@pytest.mark.parametrize(("printed", "kind"), [(40.0, UNDECIDED), (4.5, UNDECIDED), (-9.0, FALLS)])
def test_no_more_than_a_number_falls_where_our_splits_are_all_above_it(printed, kind):
    evidence = placed(np.arange(10.0), printed, of="x", at_most=True)
    assert evidence.outcome == kind
    assert evidence.rule == f"x is {printed:.3g} at most, as one more of our splits might give"


def test_no_more_than_a_number_for_several_falls_by_any_one_of_them():
    low = np.linspace(0.4, 0.9, 20)
    high = np.linspace(0.85, 0.95, 20)
    falls = placed_below({"a": low, "b": high}, 0.7, of="accuracy").judge(1.0)
    assert (falls["outcome"], falls["level"]) == (FALLS, pytest.approx(0.025))
    assert falls["rule"].startswith("b's accuracy is 0.7 at most")
    assert falls["rule"].endswith("and 1 more")
    assert outcome(placed_below({"a": low, "b": low + 0.05}, 0.7, of="accuracy")) == UNDECIDED
    edge = 0.9 + np.array([-1.0, 1.0] * 10) * 0.047  # outside of 95 %, inside of 98.3 %
    assert placed(edge, 0.795, of="x", at_most=True).outcome == FALLS
    assert outcome(placed_below(dict.fromkeys("abc", edge), 0.795, of="accuracy")) == UNDECIDED


def test_an_interval_without_width_decides_nothing():
    nobody = clustered(np.zeros(20), range(20))
    assert outcome(below(nobody, 25)) == UNDECIDED
    assert outcome(below(clustered(np.zeros(20), range(20), fraction=True), 0.5)) == STANDS


def row(text, protocol, kind, *, central=True, method="Student's t"):
    return {"text": text, "protocol": protocol, "outcome": kind, "central": central,
            "method": method}  # fmt: skip


@pytest.mark.parametrize(
    ("rows", "begins"),
    [
        ([row("a", RECORDED, STANDS), row("b", RECORDED, STANDS)], "reproduced (2 stand)"),
        ([row("a", RECORDED, STANDS), row("a", THEIRS, FALLS)], "reproduced (1 stands)"),
        ([row("number", THEIRS, FALLS), row("a", RECORDED, STANDS)], "reproduced in part"),
        ([row("a", RECORDED, FALLS), row("b", RECORDED, UNDECIDED)], "not reproduced (1 falls"),
        ([row("a", RECORDED, UNDECIDED)], "undecided"),
        ([row("a", RECORDED, STANDS), row("b", RECORDED, FALLS, central=False)], "reproduced (1"),
        ([row("a", RECORDED, CONSTRUCTED)], "by construction (1 by construction)"),
        ([row("a", THEIRS, STANDS, method="a fact")], "consistent (1 stands)"),
        ([row("a", THEIRS, FALLS, method="a fact")], "not consistent (1 falls)"),
        ([row("a", THEIRS, STANDS), row("b", THEIRS, STANDS, method="a fact")], "reproduced (2"),
        ([row("a", RECORDED, None)], "not run"),
        ([row("a", RECORDED, STANDS), row("b", RECORDED, None)], "run in part (1 stands, 1 not"),
        ([row("a", RECORDED, FALLS, central=False)], "nothing central"),
        ([], "nothing to judge"),
    ],
)
def test_a_verdict_rests_on_the_central_statements(rows, begins):
    assert verdict(rows).startswith(begins)


def test_runs_that_share_no_object_leave_a_change_undecided():
    change = change_of_means([1, 0], [3, 4], [1], [5], fraction=True)
    shown = judged({"theirs": {"it rises": above(change, 0, of="rise")}}, ["it rises"], "here")
    assert "undecided" in repr(shown)


@pytest.mark.parametrize("fraction", [False, True])
def test_a_level_is_where_the_interval_meets_the_bound(fraction):
    rng = np.random.default_rng(1)
    effect = clustered(rng.random(40) < 0.7, np.arange(40) // 2, fraction=fraction)
    _, _, low, high = effect.interval(0.9)
    assert level_above(effect, low) == pytest.approx(0.1)
    assert level_below(effect, high) == pytest.approx(0.1)
    assert level_above(effect, high) > 1


def test_a_level_of_a_difference_of_fractions_is_too():
    rng = np.random.default_rng(0)
    objects = np.repeat(np.arange(36), 10)
    gain = (rng.random(360) < 0.3).astype(float) - (rng.random(360) < 0.1)
    effect = paired_fractions(gain, partial(clustered, clusters=objects))
    for level in (level_above(effect, 0.1), level_below(effect, 0.3)):
        assert min(abs(e - b) for e in effect.interval(1 - level)[2:] for b in (0.1, 0.3)) < 1e-6
    assert level_above(effect, 0.5) > 1


def test_needed_units_decide_at_80_percent_power():
    effect = clustered([0.5, 1.5, -0.5, 2.5], range(4))
    rng = np.random.default_rng(2)
    effect = replace(effect, cluster="splits")
    units = needed(effect, 0.0, 0.05)
    draws = rng.normal(effect.estimate, effect.se * 2, (400, units))
    decided = [level_above(clustered(sample, range(units)), 0.0) < 0.05 for sample in draws]
    assert 0.7 < np.mean(decided) < 0.95
    assert needed(resampled([0.0, 2.0, 1.0, 1.5], 0.5), 0.0, 0.05) is None  # by more splits
    assert needed(resampled([9.0, 11.0, 10.0, 10.5], 0.5), 7.0, 0.05) > 4


@pytest.mark.parametrize(("mean", "spread", "bound"), [(0.87, 0.1, 0.8), (0.7, 0.15, 0.75)])
def test_needed_splits_of_an_accuracy_go_by_its_own_spread(mean, spread, bound):
    """A split's accuracy is of many tests: it is no success or failure of the split."""
    tests = mean * (1 - mean) / spread**2 - 1
    rng = np.random.default_rng(3)

    def draw(*size):
        return rng.beta(mean * tests, (1 - mean) * tests, size)

    x = draw(20)
    x = mean + (x - x.mean()) * spread / x.std(ddof=1)
    seen = clustered(x, range(20), fraction=True)
    units = needed(replace(seen, cluster="splits"), bound, 0.01)
    outside = level_above if mean > bound else level_below
    again = [clustered(part, range(units), fraction=True) for part in draw(2000, units)]
    assert 0.74 < np.mean([outside(each, bound) <= 0.01 for each in again]) < 0.88


@pytest.mark.parametrize("successes", [1, 2])
def test_needed_splits_of_a_share_decide_at_80_percent_power(successes):
    effect = clustered(np.arange(10) < successes, range(10), fraction=True)
    units = needed(replace(effect, cluster="splits"), 0.5, 0.01)
    drawn = np.random.default_rng(0).random((2000, units)) < effect.estimate
    ahead = [clustered(sample, range(units), fraction=True) for sample in drawn]
    assert 0.77 < np.mean([level_below(sample, 0.5) <= 0.01 for sample in ahead]) < 0.9


def test_holm_keeps_the_level_of_a_family():
    rng = np.random.default_rng(3)
    levels = rng.random((20_000, 10))  # no effect: levels are uniform
    false = [(family <= holm(family)).any() for family in levels]
    assert np.mean(false) <= 0.055


def test_bootstrap_of_a_mean_agrees_with_the_clustered_error():
    rng = np.random.default_rng(1)
    clusters = np.repeat(np.arange(40), 5)
    x = np.repeat(rng.normal(size=40), 5) + rng.normal(size=200)
    interval = bootstrap_interval(x, clusters, rng)
    assert interval[:2] == pytest.approx((x.mean(), clustered(x, clusters).se), rel=0.1)
    assert interval.low < interval.estimate < interval.high
    median = bootstrap_interval(x, clusters, rng, statistic=np.median, draws=200)
    assert median.estimate == np.median(x)
