"""Statements on online runs are made to stand, to fall and to stay undecided."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from meal_bayes.evaluation import Effect
from meal_bayes.evaluation.outcome_model import AgentEffect
from paper_repro import online
from paper_repro.items import fig10, fig11, fig12
from paper_repro.items.hierarchical import agree
from paper_repro.items.table4 import judge as judge_table_4
from paper_repro.items.table4 import places
from paper_repro.online import Curves
from paper_repro.statements import CONSTRUCTED, FALLS, STANDS, UNDECIDED, Evidence

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
    return Curves(x, values, 100 * values, 100 * values, np.zeros((REPEATS, 4, 0)), ())


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
    hours, reward = np.array([[0.0, 1.0, 2.0]] * 2), np.array([[0.0, 10.0, 20.0]] * 2)
    slow = replace(curves(0.8), hours=3 * hours, accuracy=hours, reward=reward + 5.0)
    base = replace(slow, hours=hours, reward=reward)
    table = fig10.compared({"morc_itrs": slow, "iterative_morc": base}, "CY101, 1 attribute")
    ahead, itself = (dict(zip(table.columns, row, strict=True)) for row in table.rows)
    assert ahead["reward over H h, less its"].estimate < 0
    assert itself["reward over H h, less its"].estimate == 0.0


def test_no_lead_is_shown_where_an_agent_explored_for_less():
    hours, reward = np.array([[0.0, 1.0, 2.0]] * 2), np.array([[0.0, 10.0, 20.0]] * 2)
    long = replace(curves(0.8), hours=hours, reward=reward)
    short = replace(long, hours=hours / np.array([[1.0], [4.0]]))  # one repeat ends after 0.5 h
    assert fig10.lead_at(long, short, 0.5).estimate == pytest.approx(-7.5)
    assert fig10.lead_at(long, short, 1.0) is None
    assert fig10.lead_at(long, long, 2.0).estimate == 0.0


def test_areas_are_means_over_hours():
    hours, values = np.array([[0.0, 1.0, 3.0]]), np.array([[0.0, 1.0, 1.0]])
    curve = Curves(hours, values, values, values, np.zeros((1, 3, 0)), ())
    for end, mean in ((2.0, 0.75), (4.0, 0.875)):
        until = replace(curve, hours=np.array([[0.0, 1.0, end]]))
        assert fig10.area(curve, until, "reward")[0] == pytest.approx([mean])
    assert online.at_hours(hours, values, 0.5) == pytest.approx([0.5])
    assert np.isnan(online.at_hours(hours, values, 9.0))  # nobody explored for so long


@pytest.mark.parametrize(("kind", "lead"), kinds(0.1, -0.1, 0.0))
def test_fig_11_judges_attributes(kind, lead):
    rng = np.random.default_rng(0)

    def scores():
        noise = 0.02 * rng.standard_normal((REPEATS, 10))
        return 0.8 + noise - noise.mean(axis=0)

    itrs, legal, base = (scores() for _ in range(3))
    itrs += lead
    legal -= lead
    for agent in (itrs, legal, base):  # easy ones above the rest, hard ones below
        agent[:, [fig11.NAMES.index(name) for name in ("blue", "full", "container")]] += lead
        for name in ("plastic", "hard", "empty"):
            agent[:, fig11.NAMES.index(name)] = scores()[:, 0] - lead
    evidence = fig11.judge(
        {"iterative_random_legal": legal, "iterative_morc": base, "morc_itrs": itrs}, 0.5
    )
    outcomes = [outcome(claim) for claim in evidence.values()]
    ahead = fig11.wins({"iterative_random_legal": legal, "iterative_morc": base, "morc_itrs": itrs})
    spread = ahead.std(ddof=1) * math.sqrt(1 + 1 / REPEATS)
    reach = stats.t.ppf(0.975, REPEATS - 1) * spread
    assert outcomes[0] == (FALLS if abs(7 - ahead.mean()) > reach else UNDECIDED)
    assert outcomes[1:4] == [kind] * 3
    if kind != FALLS:
        assert outcomes[4:] == [kind] * 4
    else:
        assert FALLS in outcomes[4:]


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


@pytest.mark.parametrize(
    ("kinds", "late", "more"),
    [
        ([STANDS, STANDS, STANDS], 0.63, 0.5),
        ([FALLS, STANDS, FALLS], -0.3, -0.5),
    ],
)
def test_table_4_judges_tables_and_choices(kinds, late, more):
    def around(level, seed):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(REPEATS)
        return level + noise - noise.mean()

    nothing = np.zeros(REPEATS)
    traits = {"early 0": nothing, "early 1": around(0.18, 1), "late 0": nothing,
              "late 1": around(late, 2), "grasp": around(0.05, 3),
              "experience": around(0.67, 4), "early presses": around(0.5, 5),
              "late presses": around(0.5 + more, 6)}  # fmt: skip
    evidence = judge_table_4(traits, 0.5, printed=True)
    assert [outcome(claim) for claim in evidence.values()] == kinds
    assert len(judge_table_4(traits, 0.5, printed=False)) == 2  # ideas alone
    traits["experience"] = np.full(REPEATS, 0.02)
    (fallen,) = (c for text, c in judge_table_4(traits, 0.5, printed=True).items() if "IE" in text)
    assert outcome(fallen) == FALLS
    (_, _, printed, mean, _, below), *_ = places({"theirs": traits})
    assert (printed, below) == (pytest.approx(0.18), pytest.approx(0.5, abs=0.3))
    assert mean == pytest.approx(0.18)
    traits["early 1"] = np.full(REPEATS, np.nan)  # a batch that never asked
    assert outcome(next(iter(judge_table_4(traits, 0.5, printed=True).values()))) == UNDECIDED


def test_the_model_s_probability_is_withheld_where_the_design_disagrees():
    effect = AgentEffect("bayes", "morc", "success", 9, 0.1, 0.08, 0.01, 0.2, 0.9, 0.1, 0.02, "red")
    assert agree(effect, Effect(0.1, 0.01, 9))
    assert not agree(effect, Effect(0.1, 0.1, 9))  # holds 0
    assert agree(replace(effect, low=-0.1), Effect(0.1, 0.1, 9))


def test_repeats_are_units_where_the_objects_are_the_whole_population():
    values = np.array([0.1, 0.3, 0.2, 0.6])
    alone = online.paired(values, np.zeros(4), 0.0)
    assert alone.method == "Student's t over splits"
    low, high = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    assert alone.interval()[2:] == pytest.approx((low, high))
    shared = online.paired(values, np.zeros(4), 0.5)
    assert shared.se == pytest.approx(values.std(ddof=1) * math.sqrt(1 / 4 + 0.5))
    assert shared.method == "corrected resampled t"
