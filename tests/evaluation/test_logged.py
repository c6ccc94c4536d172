"""What logs measure: pairs of one task, tests after the last batch, the same on every surface."""

import re
from collections import Counter
from fractions import Fraction

import numpy as np
import pytest

from meal_bayes.errors import LogError, SettingsError
from meal_bayes.evaluation import compare, summarize
from meal_bayes.evaluation.learning import POOLED, summarize_learning
from meal_bayes.evaluation.logged import LoggedOutcomes
from meal_bayes.evaluation.report import write_report
from meal_bayes.trial_log import Logs, write_trials
from meal_bayes.trials import TrialOutcomes

OBJECTS = ("mug", "can", "box", "jar")


def outcomes_of(agent, keys, objects, rewards, costs=None):
    """Trials of one attribute; the answer is right where the reward is above 0."""
    n = len(keys)
    right = np.asarray(rewards) > 0
    return TrialOutcomes(
        behaviors=("look",), agent=np.full(n, agent, object), key=np.array(keys, object),
        object_index=np.zeros(n, int), object_name=np.array(objects, object),
        attribute=np.full((n, 1), "red", object), truth=np.ones((n, 1)), report=right[:, None],
        positive=np.where(right, 0.875, 0.25)[:, None],
        cost=np.full(n, 5.0) if costs is None else np.asarray(costs, float),
        reward=np.asarray(rewards, float), ended=np.full(n, "", object), steps=np.full(n, 2),
        executed=np.ones((n, 1), int), failed=np.zeros((n, 1), int),
    )  # fmt: skip


def logs_of(folder, rng):
    """Write logs of two or three agents as some run may leave them; return their rows.

    A row is (agent, repeat, batch, part, key, object, reward). Tests of an online run come again
    after every batch; agents and tasks may be missing, and a key may stand twice in a log.
    """
    online = rng.random() < 0.7
    agents = ["a", "b", "c"][: rng.integers(1, 4)]
    tasks = [(f"task {n}", str(rng.choice(OBJECTS))) for n in range(rng.integers(1, 6))]
    batches = rng.integers(1, 4) if online else 1
    rows = []
    for agent in agents:
        for repeat in range(rng.integers(1, 3) if online else 1):
            for batch in range(batches):
                for part in ("test", "train") if online else ("",):
                    chosen = [task for task in tasks if rng.random() < 0.9]
                    if rng.random() < 0.05:
                        chosen += chosen[:1]
                    if not chosen:
                        continue
                    keys, objects = zip(*chosen, strict=True)
                    rewards = rng.integers(-4, 5, len(chosen)) * 25.0
                    header = {"repeat": repeat, "batch": batch, "part": part} if online else {}
                    path = folder / agent / f"repeat-{repeat}" / f"{batch}-{part}.mcap"
                    write_trials(path, [outcomes_of(agent, keys, objects, rewards)], header=header)
                    where = (repeat, batch, part) if online else (-1, -1, "")
                    rows += [(agent, *where, *task, reward) for task, reward in zip(
                        chosen, rewards.tolist(), strict=True)]  # fmt: skip
    return rows


def by_hand(rows, first, second):
    """Return the mean difference over tasks that both have; None where a task stands twice."""
    sides = []
    for name in (first, second):
        of_agent = [row for row in rows if row[0] == name]
        if max(Counter(row[1:5] for row in of_agent).values(), default=0) > 1:
            return None
        sides.append({row[1:5]: Fraction(row[6]) for row in of_agent})
    shared = sides[0].keys() & sides[1].keys()
    if not shared:
        return None
    return float(sum(sides[0][key] - sides[1][key] for key in shared) / len(shared))


@pytest.mark.quick(10)
@pytest.mark.parametrize("seed", range(200))
def test_differences_are_of_one_task_and_change_sign_with_the_order(seed, tmp_path):
    rows = logs_of(tmp_path, np.random.default_rng(seed))
    if not rows:
        return
    outcomes = LoggedOutcomes.read(Logs(tmp_path)).outcomes
    assert len(outcomes) == len(rows)
    for first, second in (("a", "b"), ("a", "c"), ("b", "c")):
        expected = by_hand(rows, first, second)
        for measure in ("reward", "cost", "success", "abstained"):
            if expected is None:
                for pair in ((first, second), (second, first)):
                    with pytest.raises(SettingsError) as fault:
                        compare(outcomes, *pair, measure=measure)
                    assert "\n" not in str(fault.value)
                continue
            there = compare(outcomes, first, second, measure=measure)
            back = compare(outcomes, second, first, measure=measure)
            assert np.array_equal(there, -back, equal_nan=True)  # exactly
            if measure == "reward":
                assert there.estimate == pytest.approx(expected, abs=1e-9)


def test_order_of_rows_changes_no_digit():
    rng = np.random.default_rng(0)
    keys = [f"{n}" for n in range(40)]
    objects = rng.choice(OBJECTS, 40)
    parts = [outcomes_of(name, keys, objects, rng.normal(size=40)) for name in "ab"]
    whole = compare(TrialOutcomes.join(parts), "a", "b")
    shuffled = [part.rows(rng.permutation(40)) for part in reversed(parts)]
    assert compare(TrialOutcomes.join(shuffled), "a", "b") == whole


def test_a_task_that_comes_twice_or_is_another_is_refused_in_one_line():
    twice = outcomes_of("a", ["k", "k"], ["mug", "mug"], [5.0, -5.0])
    once = outcomes_of("b", ["k"], ["mug"], [5.0])
    with pytest.raises(SettingsError, match="'a' has the task k twice; give trials of one run"):
        compare(TrialOutcomes.join([twice, once]), "b", "a")
    other = outcomes_of("a", ["k"], ["can"], [5.0])
    with pytest.raises(SettingsError, match="is about mug, red in one and about can, red in the"):
        compare(TrialOutcomes.join([once, other]), "b", "a")


# An online run of two agents: each knows more after every batch, and is tested on the same tasks.
GAIN = 100.0


@pytest.fixture
def online(tmp_path):
    folder = tmp_path / "run"
    rng = np.random.default_rng(1)
    keys = [f"[{n}]" for n in range(12)]
    objects = [OBJECTS[n % 4] for n in range(12)]
    luck = rng.integers(-3, 4, (4, 12)) * 20.0
    for agent, lead in (("bayes", 30.0), ("iterative_morc", 0.0)):
        for batch in range(4):
            header = {"repeat": 0, "batch": batch}
            path = folder / agent / "repeat-000" / f"{batch:02d}"
            if batch:
                trained = outcomes_of(agent, keys, objects, luck[batch] - 200, 300 + 0 * luck[0])
                write_trials(f"{path}-train.mcap", [trained], header=header | {"part": "train"})
            tests = outcomes_of(agent, keys, objects, luck[batch] + GAIN * (batch - 1.5) + lead)
            write_trials(f"{path}-test.mcap", [tests], header=header | {"part": "test"})
    return folder


def test_a_report_of_an_online_run_measures_tests_after_the_last_batch(online, tmp_path, cells):
    write_report(Logs(online), tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    logged = LoggedOutcomes.read(Logs(online))
    results = logged.batches()
    assert [(r.agent, r.batch) for r in results[:4]] == [("bayes", n) for n in range(4)]
    assert [r.hours for r in results[:4]] == [0.0, 1.0, 2.0, 3.0]  # the batch's own training too
    table = {row[0]: row for row in cells(text) if len(row) == 8}
    for row in summarize_learning(results):  # what the terminal prints
        shown = table[row.agent]
        assert shown[1] == "12"
        assert shown[2].startswith(f"{row.accuracy_after:.3f} [")
        assert shown[4].startswith(f"{row.reward_after:.1f} ")
        assert shown[6] == f"{row.ece_after:.3f}"
    terminal = summarize_learning(
        [r for name in ("iterative_morc", "bayes") for r in results if r.agent == name]
    )
    (difference,) = (row for row in cells(text) if len(row) == 6 and row[0] == "bayes")
    assert difference[3].split()[0] == f"{terminal[1].reward_after_difference:+.1f}" == "+30.0"
    headings = re.findall(r'<h2>([^<]*)</h2>\s*<p class="lead">(.*?)</p>', text)
    assert [title for title, _ in headings] == [
        "Who is ahead", "Calibration", "Attributes", "Behaviors"
    ]  # fmt: skip
    for _, lead in headings:
        assert lead.startswith(f"Tests after batch 3; ECE is of the tests after the last {POOLED}")
        assert "The 144 trials of training and of earlier tests are not counted." in lead


def test_agents_are_measured_after_a_batch_that_all_of_them_reached(online):
    (online / "bayes" / "repeat-000" / "03-test.mcap").unlink()
    logged = LoggedOutcomes.read(Logs(online))
    assert logged.last_batch == 2
    assert len(logged.measured().outcomes) == 24
    assert "batch 2, the last that every agent was tested after" in logged.heading
    estimate = compare(logged.measured().outcomes, "bayes", "iterative_morc").estimate
    assert estimate == pytest.approx(30.0)


@pytest.mark.long
def test_the_other_reference_changes_every_sign(online, tmp_path, cells):
    shown = {}
    for reference, other in (("bayes", "iterative_morc"), ("iterative_morc", "bayes")):
        write_report(Logs(online), tmp_path / "r.html", reference=reference)
        (row,) = (
            row
            for row in cells((tmp_path / "r.html").read_text())
            if len(row) == 6 and row[0] == other
        )
        shown[reference] = row[3:]
    turned = [cell.translate(str.maketrans("+-", "-+")) for cell in shown["iterative_morc"]]
    for cell, expected in zip(shown["bayes"], turned, strict=True):
        numbers, others = (re.findall(r"[+-][\d.]+", text) for text in (cell, expected))
        assert numbers[0] == others[0] or float(numbers[0]) == float(others[0]) == 0
        assert sorted(map(float, numbers)) == pytest.approx(sorted(map(float, others)))
    with pytest.raises(SettingsError, match="reference 'nobody' has no trial here"):
        write_report(Logs(online), tmp_path / "r.html", reference="nobody")


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (({"reward": 100.0}, {"reward": 500.0}), "reward is 100.0 and 500.0"),
        (({"reward": 100.0}, {"reward": None}), "reward is 100.0 and 500.0"),
        (({"reward": None}, {"reward": 500.0}), ""),
        (({"percepts": "recorded"}, {"percepts": "model"}), "percepts is 'recorded' and 'model'"),
        (({"payoffs": None}, {"payoffs": [1.0, -1.0, 1.0, -1.0]}), "payoffs is None and"),
        (({"seed": 1}, {"seed": 2}), ""),
        (({"attributes": 1, "reward": 1.0}, {"attributes": 2, "reward": 2.0}), ""),
    ],
)
def test_trials_that_earn_differently_are_not_compared(settings, says, tmp_path):
    for name, setting in zip("ab", settings, strict=True):
        trials = outcomes_of(name, [*"xyz"], OBJECTS[:3], [1, -1, 1])
        config = {"dataset": "roc36", "attributes": 2, **setting}
        write_trials(tmp_path / f"{name}.mcap", [trials], header={"config": config})
    logs = Logs(tmp_path)
    if not says:
        assert len(LoggedOutcomes.read(logs).outcomes) == 6
        return
    with pytest.raises(LogError, match=says) as fault:
        LoggedOutcomes.read(logs)
    assert "\n" not in str(fault.value)


def test_trials_without_batches_are_all_measured(tmp_path):
    trials = outcomes_of("a", [*"xyz"], OBJECTS[:3], [1, -1, 1])
    write_trials(tmp_path / "a.mcap", [trials], header={})
    logged = LoggedOutcomes.read(Logs(tmp_path))
    assert logged.measured() is logged
    assert logged.heading == ""
    assert logged.batches() == []
    assert summarize(logged.outcomes)[0].trials == 3
