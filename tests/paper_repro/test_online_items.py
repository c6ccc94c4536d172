"""Statements on online runs are made to stand, to fall and to stay undecided."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from paper_repro import online
from paper_repro.frame import Setting
from paper_repro.items import fig10, fig11, fig12, table4
from paper_repro.online import Curves
from paper_repro.statements import (
    CONSTRUCTED,
    FALLS,
    RECORDED,
    STANDS,
    THEIRS,
    UNDECIDED,
    Evidence,
)

KINDS = (STANDS, FALLS, UNDECIDED)
REPEATS = 20


def outcome(evidence: Evidence | None) -> str:
    """Judge a statement alone."""
    assert evidence is not None
    return evidence.judge(0.05)["outcome"]


def kinds(*values):
    """Pair what makes a statement stand, fall and stay undecided with these outcomes."""
    return list(zip(KINDS, values, strict=True))


def curves(accuracy, *, hours=4.0, first=0.5, seed=0):
    """Learning curves of a level and of a first batch that takes some hours."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((REPEATS, 1)) * 0.02
    values = accuracy + np.repeat(noise - noise.mean(), 4, axis=1)
    x = np.array([0.0, first, 2.0, hours]) + np.zeros((REPEATS, 4))
    x[:, 1::2] += 0.02 * (noise - noise.mean())
    nothing = np.zeros_like(values)
    return Curves(x, values, 100 * values, 100 * values, nothing, np.zeros((REPEATS, 4, 0)), ())


@pytest.mark.parametrize(("kind", "lead"), kinds(0.1, -0.1, 0.0))
def test_fig_10_judges_areas_ends_and_starts(kind, lead):
    panel = {"morc_itrs": curves(0.8 + lead, seed=1, hours=4.0 - lead),
             "iterative_morc": curves(0.8, seed=2),
             "iterative_random_legal": curves(0.8, seed=3)}  # fmt: skip
    evidence = fig10.judge(panel, "CY101, 1 attribute", one_agent=False)
    assert tuple(evidence) == fig10.texts("CY101, 1 attribute")
    assert {outcome(claim) for claim in evidence.values()} == {kind}
    same = fig10.judge(panel, "CY101, 1 attribute", one_agent=True)
    starts = [outcome(claim) for text, claim in same.items() if "before training" in text]
    assert starts == [CONSTRUCTED] * 2


def test_fig_10_compares_over_equal_hours():
    hours = np.array([[0.0, 1.0, 2.0]] * 2)
    reward = np.array([[0.0, 10.0, 20.0]] * 2)
    slow = replace(curves(0.8), hours=3 * hours, accuracy=hours, reward=reward + 5.0)
    base = replace(slow, hours=hours, reward=reward)
    table = fig10.compared({"morc_itrs": slow, "iterative_morc": base}, "CY101, 1 attribute")
    ahead, itself = (dict(zip(table.columns, row, strict=True)) for row in table.rows)
    assert ahead["reward over H h, less its"].estimate < 0
    assert itself["reward over H h, less its"].estimate == 0.0


def test_no_lead_is_shown_where_an_agent_explored_for_less():
    hours = np.array([[0.0, 1.0, 2.0]] * 2)
    reward = np.array([[0.0, 10.0, 20.0]] * 2)
    long = replace(curves(0.8), hours=hours, reward=reward)
    short = replace(long, hours=hours / np.array([[1.0], [4.0]]))  # one repeat ends after 0.5 h
    assert fig10.lead_at(long, short, "reward", 0.5).estimate == pytest.approx(-7.5)
    assert fig10.lead_at(long, short, "reward", 1.0) is None
    assert fig10.lead_at(long, long, "reward", 2.0).estimate == 0.0


def test_areas_are_means_over_hours():
    hours = np.array([[0.0, 1.0, 3.0]])
    values = np.array([[0.0, 1.0, 1.0]])
    curve = Curves(hours, values, values, values, 0 * values, np.zeros((1, 3, 0)), ())
    for end, mean in ((2.0, 0.75), (4.0, 0.875)):
        until = replace(curve, hours=np.array([[0.0, 1.0, end]]))
        assert fig10.area(curve, until, "reward")[0] == pytest.approx([mean])
    assert online.at_hours(hours, values, 0.5) == pytest.approx([0.5])
    assert np.isnan(online.at_hours(hours, values, 9.0))  # nobody explored for so long


@pytest.mark.parametrize(("kind", "lead"), kinds(0.1, -0.1, 0.0))
def test_fig_11_judges_attributes(kind, lead):
    rng = np.random.default_rng(0)

    def scores(level=0.8):
        noise = 0.02 * rng.standard_normal((REPEATS, 10))
        return level + noise - noise.mean(axis=0)

    agents = {"iterative_random_legal": scores(0.8 - lead), "iterative_morc": scores(),
              "morc_itrs": scores(0.8 + lead)}  # fmt: skip
    for name, level in (("plastic", 0.95), ("hard", 0.8), ("empty", 0.6)):
        agents["iterative_morc"][:, fig11.NAMES.index(name)] = scores(level)[:, 0]
    agents["iterative_random_legal"][:, fig11.EASY] -= lead
    evidence = fig11.judge(agents, 0.5, printed=True)
    weak = "Random Legal is relatively weak on the easy ones"
    assert outcome(evidence[weak]) == kind
    ideas = fig11.judge(agents, 0.5, printed=False)
    assert list(ideas) == [weak]  # recordings are not asked for what was read off one split
    number = fig11.wins(agents)
    reach = stats.t.ppf(0.975, REPEATS - 1) * number.std(ddof=1) * math.sqrt(1 + 1 / REPEATS)
    best = outcome(evidence["MORC-ITRS is best on 7 of 10"])
    assert best == (FALLS if abs(7 - number.mean()) > reach else UNDECIDED)
    limits = {name: outcome(evidence[f"{name} is no more than 0.8 for all three"])
              for name in ("plastic", "hard", "empty")}  # fmt: skip
    assert limits["plastic"] == FALLS  # one agent of three is above it in every split
    assert kind != UNDECIDED or limits["hard"] == UNDECIDED


def test_a_tie_is_half_a_win():
    """Agents that have all tests right are level, and are not behind each other."""
    level = {name: np.ones((REPEATS, 10)) for name in online.PAPERS}
    assert fig11.wins(level).tolist() == [5.0] * REPEATS
    assert fig11.wins(level, tie=0.0).tolist() == [0.0] * REPEATS
    level["morc_itrs"][0, :4] = 0.9
    level["iterative_morc"][1, :] = level["iterative_random_legal"][1, :] = np.nan  # not asked
    assert fig11.wins(level)[:3].tolist() == [3.0, 10.0, 5.0]
    told = {row[1]: row[2:] for row in fig11.counted("theirs", level, 7)}
    assert told["nothing"] == (0.5, pytest.approx(10 / math.sqrt(REPEATS)), 0.0, 10.0, "1 of 20")
    assert told["wins"][-1] == "19 of 20"


def test_an_easy_attribute_is_compared_with_those_that_are_not():
    accuracy = np.full((REPEATS, 10), 0.6)
    accuracy[:, fig11.EASY] = 0.9
    assert fig11.lead_of(accuracy, fig11.EASY[0], 0.5).estimate == pytest.approx(0.3)


@pytest.mark.parametrize(("kind", "lead"), kinds(0.05, -0.05, 0.0))
def test_fig_12_judges_the_grid(kind, lead):
    grid = {}
    for n, (alpha, beta) in enumerate((a, b) for a in fig12.ALPHAS for b in fig12.BETAS):
        noise = 0.005 * np.random.default_rng(n).standard_normal((REPEATS, 11))
        level = 0.8 + lead * (beta in (10, 30, 60)) + lead * (alpha in (3, 6))
        grid[f"{alpha}, {beta}"] = level + noise - noise.mean(axis=0)
        grid[f"{alpha}, {beta}"][:, 6:] += lead + lead * (alpha == fig12.ALPHAS[-1])
    evidence = fig12.judge(grid, 0.5)
    assert {outcome(claim) for claim in evidence.values()} == {kind}
    assert len(evidence) == 3  # not whether it rises at each pair


def test_fig_12_s_sentence_counts_the_pairs_that_rise():
    row = {"estimate": 0.066, "interval": [0.006, 0.127]}
    rows = [row | {"text": fig12.RISES}, row | {"text": fig12.MIDDLE, "estimate": -0.002}]
    told = fig12._sentence(rows, [0.05, -0.01, 0.09])
    assert "an end of the grid by -0.002 [+0.006, +0.127]" in told
    assert "+0.066 [+0.006, +0.127] on average, and the mean of the splits rises in 2 of 3" in told
    assert "(by -0.010 to +0.090)" in told


def traits_of_soft(late):
    """Traits of splits in which pressing rises from .18 to a level, as the paper prints it."""

    def around(level, seed):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(REPEATS)
        return level + noise - noise.mean()

    nothing = np.zeros(REPEATS)
    return {"early 0": nothing, "early 1": around(0.18, 1), "late 0": nothing,
            "late 1": around(late, 2), "grasp": around(0.05, 3), "asked": np.full(REPEATS, 32.0),
            "early presses": around(0.2, 5), "late presses": around(0.5, 6),
            "early grasps": around(0.4, 7), "late grasps": around(0.3, 8)}  # fmt: skip


@pytest.mark.parametrize(("late", "kind"), [(0.63, UNDECIDED), (0.18, FALLS), (0.98, FALLS)])
def test_table_4_places_the_printed_rise_among_our_splits(late, kind):
    rise, experience = table4.judge(traits_of_soft(late)).values()
    assert outcome(rise) == kind
    assert outcome(experience) == FALLS


def test_table_4_s_experience_is_arithmetic_on_what_is_asked():
    text = "late: IE of (SOFT, grasp) is 0.67, by the code's delta"
    traits = traits_of_soft(0.63)
    assert table4.judge(traits)[text].rule == (
        "labelled grasps in trials that ask for SOFT: it takes 134, 4.2 in each of the 32 that "
        "eight batches have on average; T1 grasps once, T2 never"
    )
    assert outcome(table4.judge(traits | {"asked": np.full(REPEATS, 134.0)})[text]) == STANDS
    assert outcome(table4.judge(traits | {"asked": np.zeros(REPEATS)})[text]) == UNDECIDED


def test_table_4_shows_single_trials_and_does_not_judge_them():
    traits = traits_of_soft(0.63)
    assert not [text for text in table4.judge(traits) if "presses late" in text]
    (when, trial, _, grasps, presses), *_ = table4.choices({"theirs": traits}, {"theirs": 0.0})
    assert (when, trial) == ("early", "T1: grasps")
    assert (grasps.estimate, presses.estimate) == (pytest.approx(0.4), pytest.approx(0.2))
    rows = {row[0]: row for row in table4.places({"theirs": traits})}
    assert rows["rise, press"][2:4] == (pytest.approx(0.45), pytest.approx(0.45))
    traits["early 1"] = np.full(REPEATS, np.nan)  # a batch that never asked
    assert outcome(next(iter(table4.judge(traits).values()))) == UNDECIDED


def test_fig_10_shows_who_gives_up_after_the_last_batch():
    panel = {name: curves(0.8, seed=n) for n, name in enumerate(("iterative_morc", "morc_itrs"))}
    panel["iterative_morc"].abstained[:, -1] = 0.25
    table = fig10.compared(panel, "CY101, 2 attributes")
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    assert [row["abstained"].estimate for row in rows] == [0.25, 0.0]
    assert rows[1]["accuracy"].estimate == pytest.approx(panel["morc_itrs"].accuracy[:, -1].mean())
    assert rows[1]["accuracy at 2 h"].estimate == pytest.approx(0.0)


def test_the_published_split_is_shown_and_not_judged():
    table = fig10.place("CY101", 0.3, np.array([0.1, 0.2, 0.4]))
    assert table.rows[0][-1] == "2 of 3"
    assert table.rows[1][1:3] == (3, pytest.approx(0.7 / 3))
    assert not [text for text in fig10.texts("CY101") if "one split" in text]


def test_the_published_settings_have_twenty_splits():
    repeats = {column: online.repeats_of(Setting(), column) for column in (THEIRS, RECORDED)}
    assert repeats == {THEIRS: 20, RECORDED: 10}
    assert online.repeats_of(Setting(repeats=5), THEIRS) == 5


def test_repeats_are_units_where_the_objects_are_the_whole_population():
    values = np.array([0.1, 0.3, 0.2, 0.6])
    alone = online.paired(values, np.zeros(4), 0.0)
    assert alone.method == "Student's t over splits"
    low, high = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    assert alone.interval()[2:] == pytest.approx((low, high))
    shared = online.paired(values, np.zeros(4), 0.5)
    assert shared.se == pytest.approx(values.std(ddof=1) * math.sqrt(1 / 4 + 0.5))
    assert shared.method == "corrected resampled t"
