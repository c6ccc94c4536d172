import doctest
import json
from math import inf, nan
from pathlib import Path

import pytest

from meal_bayes.errors import SettingsError

SCRIPTS = Path(__file__).resolve().parents[2] / "paper_repro"


def test_examples_hold(scripts):
    assert doctest.testmod(scripts.frame).attempted > 0
    assert doctest.testmod(scripts.frame).failed == 0


@pytest.mark.parametrize(
    ("claims", "begins"),
    [
        ([("a", True, None)], "reproduced: 1 of 1"),
        ([("a", True, False)], "reproduced: 1 of 1"),
        ([("a", False, True), ("b", True, True)], "reproduced only in the published protocol"),
        ([("a", False, True), ("b", True, False)], "not reproduced: 1 of 2"),
        ([("a", False, None)], "not reproduced: 0 of 1"),
        ([("a", False, False)], "not reproduced: 0 of 1 statements stand, 0 of 1 in the"),
        ([("a", False, None, True), ("b", True, None)], "reproduced where the paper agrees"),
        ([("a", False, None, True), ("b", False, None)], "not reproduced"),
        ([("a", None, True)], "on recordings not run: 1 of 1"),
        ([], "the paper says nothing"),
    ],
)
def test_verdicts_follow_from_the_claims(scripts, claims, begins):
    found = scripts.frame.verdict([scripts.frame.Claim(*claim) for claim in claims])
    assert found.startswith(begins)


def test_a_verdict_names_what_fell(scripts):
    fell = [scripts.frame.Claim(f"number {n}", recorded=False) for n in range(9)]
    found = scripts.frame.verdict([scripts.frame.Claim("good", recorded=True), *fell])
    assert "number 0" in found
    assert "and 5 more" in found
    assert "good" not in found


@pytest.mark.parametrize(
    ("paper", "ours", "same"),
    [
        ((0.245, 0.02), (0.27, 0.02), True),
        ((0.245, 0.02), (0.31, 0.02), False),
        ((37.10, 0.0), (37.1, 0.0), True),
        ((37.10, 0.0), (37.104, 0.0), True),
        ((37.10, 0.0), (37.2, 0.0), False),
        ((0.5, 0.1), (0.6, nan), True),
        ((0.5, 0.1), (inf, 0.1), False),
    ],
)
def test_estimates_agree_within_two_standard_errors(scripts, paper, ours, same):
    estimate = scripts.frame.Estimate
    assert scripts.frame.agrees(estimate(*paper), estimate(*ours), printed=2) is same


def test_quick_and_partial_runs_leave_the_committed_results(scripts, elsewhere, tmp_path):
    setting = scripts.frame.Setting
    for kind in ({"quick": True}, {"as_published": True}):
        scripts.reproduction.reproduce("table5", setting(logs=tmp_path / "logs", **kind))
    assert not elsewhere.exists()
    assert (tmp_path / "logs" / "paper_repro" / "table5.json").is_file()
    scripts.reproduction.reproduce("table5", setting(logs=tmp_path / "logs"))
    assert (elsewhere / "table5.json").is_file()


@pytest.mark.parametrize("item", ["table5", "fig7", "fig5"])
def test_a_full_run_again_gives_the_committed_files(scripts, elsewhere, tmp_path, item):
    scripts.reproduction.reproduce(item, scripts.frame.Setting(logs=tmp_path / "logs"))
    made = sorted(path for path in elsewhere.iterdir() if path.name != "timing.json")
    assert (elsewhere / f"{item}.json") in made
    for path in made:
        kept = SCRIPTS / "results" / path.name
        if path.suffix == ".json":  # pixels depend on the version of matplotlib
            assert path.read_text() == kept.read_text()
        else:
            assert kept.is_file()


def test_offline_trials_are_taken_from_the_logs(scripts, tmp_path):
    setting = scripts.frame.Setting(quick=True, logs=tmp_path)
    once, again = (
        scripts.trials.run_agents(setting, "recorded", "roc36", 2, ["random"], 5) for _ in range(2)
    )
    (unit,) = tmp_path.rglob("*.mcap")
    assert len(once.trials) == len(again.trials) == 5
    assert once.seconds == again.seconds > 0
    unit.with_name("unit-0000.timing.csv").unlink()
    third = scripts.trials.run_agents(setting, "recorded", "roc36", 2, ["random"], 5)
    assert third.mean("random", "cost") == once.mean("random", "cost")


def test_every_behavior_costs_what_the_paper_prints(scripts, tmp_path):
    setting = scripts.frame.Setting(quick=True, logs=tmp_path)
    for protocol in setting.protocols:
        run = scripts.trials.run_agents(
            setting, protocol, "roc36", 2, ["predefined_plus"], 5, domain=scripts.table3.EVERY
        )
        assert {len(trial.steps) for trial in run.trials} == {12}
        assert run.mean("predefined_plus", "cost").mean == pytest.approx(37.10, abs=1e-9)
        assert run.sd_of_cost("predefined_plus") == pytest.approx(0, abs=1e-9)


def test_items_are_named_in_the_papers_order(scripts):
    named = scripts.reproduction.named
    assert named(["all"]) == scripts.reproduction.ITEMS
    assert named(["table5", "fig7"]) == named(["table5,fig7"]) == ("fig7", "table5")
    with pytest.raises(SettingsError, match="Unknown item 'tabel5': did you mean 'table5'"):
        named(["tabel5"])


def test_scripts_are_short_and_all_are_items(scripts):
    scripted = {
        path.stem for path in SCRIPTS.glob("*.py") if "\ndef run(" in path.read_text("utf-8")
    }
    assert scripted == set(scripts.reproduction.ITEMS)
    for item in scripted:
        lines = (SCRIPTS / f"{item}.py").read_text(encoding="utf-8").splitlines()
        assert len(lines) < 80, item


def test_plain_values_are_json_of_six_digits(scripts):
    plain = scripts.frame._plain
    assert plain(1 / 3) == 0.333333
    assert plain(scripts.frame.Estimate(2 / 3, nan)) == [0.666667, None]
    assert json.dumps([plain(nan), plain(None), plain("a"), plain(3)]) == '[null, null, "a", 3]'
