import json
import re
from math import inf, nan
from pathlib import Path

import pytest

from meal_bayes import read_trials
from meal_bayes.errors import SettingsError
from paper_repro import frame, offline
from paper_repro.items import table3

FOLDER = Path(frame.__file__).parent


def test_quick_and_partial_runs_leave_the_committed_results(elsewhere, tmp_path):
    for kind in ({"quick": True}, {"as_published": True}):
        frame.reproduce("table5", frame.Setting(logs=tmp_path / "logs", **kind))
    assert not elsewhere.exists()
    assert (tmp_path / "logs" / "paper_repro" / "table5.json").is_file()
    frame.reproduce("table5", frame.Setting(logs=tmp_path / "logs"))
    assert (elsewhere / "table5.json").is_file()


@pytest.mark.parametrize("item", ["table5", "fig7", "fig5", "t1t2"])
def test_a_full_run_again_gives_the_committed_files(elsewhere, tmp_path, item):
    frame.reproduce(item, frame.Setting(logs=tmp_path / "logs"))
    made = sorted(path for path in elsewhere.iterdir() if path.name != "timing.json")
    assert (elsewhere / f"{item}.json") in made
    for path in made:
        kept = FOLDER / "results" / path.name
        if path.suffix == ".json":  # pixels depend on the version of matplotlib
            assert path.read_text() == kept.read_text()
        else:
            assert kept.is_file()


def test_a_run_writes_its_own_timing(elsewhere, tmp_path):
    for item in ("table5", "fig7"):
        frame.reproduce(item, frame.Setting(logs=tmp_path))
    timing = json.loads((elsewhere / "timing.json").read_text())
    assert set(timing) == {"table5", "fig7"}
    assert all(seconds >= 0 for seconds in timing.values())


def test_offline_trials_are_taken_from_the_logs(tmp_path):
    setting = frame.Setting(quick=True, logs=tmp_path)
    once, again = (
        offline.run_agent(setting, "recorded", "roc36", 2, "random", 5) for _ in range(2)
    )
    (unit,) = tmp_path.rglob("*.mcap")
    assert len(once) == len(again) == 5
    ((path, seconds),) = setting.spent.items()  # once for both
    assert path == unit
    assert seconds > 0
    assert once.report.shape == (5, 2)
    assert (once.success == (once.report == once.truth).all(axis=1)).all()
    unit.with_name("unit-0000.timing.csv").unlink()
    third = offline.run_agent(setting, "recorded", "roc36", 2, "random", 5)
    assert (third.cost == once.cost).all()
    assert setting.spent == {unit: 0.0}


def test_every_behavior_costs_what_the_paper_prints(tmp_path):
    setting = frame.Setting(quick=True, logs=tmp_path)
    for protocol in setting.protocols:
        run = offline.run_agent(
            setting, protocol, "roc36", 2, "predefined_plus", 5,
            domain=offline.domain_path("roc36_every_action"),
        )  # fmt: skip
        assert run.cost == pytest.approx(37.10, abs=1e-9)
        assert run.cost.std(ddof=1) == pytest.approx(0, abs=1e-9)


@pytest.mark.long
@pytest.mark.statistical
@pytest.mark.parametrize(("n", "cost", "sd"), [(2, 19.2, 28.0), (3, 9.7, 18.0)])
def test_the_published_random_pays_for_all_actions(tmp_path, n, cost, sd):
    """Costs of an independent simulation of the published code."""
    setting = frame.Setting(quick=True, logs=tmp_path)
    run = offline.run_agent(
        setting, "published", "roc36", n, "random", 400,
        domain=offline.domain_path("roc36_every_action"),
    )  # fmt: skip
    assert abs(run.cost.mean() - cost) <= 2 * offline.estimate(run, "cost").se
    assert run.cost.std(ddof=1) == pytest.approx(sd, rel=0.25)


def test_random_legal_asks_at_the_start_alone_as_published_and_never_on_recordings(tmp_path):
    setting = frame.Setting(quick=True, logs=tmp_path)
    for protocol in setting.protocols:
        offline.run_agent(setting, protocol, "ispy32", 1, "random_legal", 30)
    asks = {}
    for path in tmp_path.rglob("*.mcap"):
        for trial in read_trials(path):
            ask, start = trial.momdp.behavior_names.index("ask"), trial.momdp.start
            where = [step.x == start for step in trial.steps if step.decision.action == ask]
            asks.setdefault("published" in str(path.parent.parent), []).extend(where)
    assert asks[True]
    assert all(asks[True])
    assert not asks[False]


def test_items_are_named_in_the_papers_order():
    assert frame.named(["all"]) == frame.items()
    assert frame.named(["table5", "fig7"]) == frame.named(["table5,fig7"]) == ("fig7", "table5")
    with pytest.raises(SettingsError, match="Unknown item 'tabel5': did you mean 'table5'"):
        frame.named(["tabel5"])


def test_an_item_is_a_script_and_a_section():
    scripts = {path.stem for path in FOLDER.glob("items/*.py")} - {"__init__"}
    assert scripts == set(frame.items())
    shared = [path for path in FOLDER.glob("*.py") if path.stem != "pages"]  # its head shows one
    for path in shared:
        words = set(re.findall(r"\w+", path.read_text(encoding="utf-8")))
        assert not words & (scripts - {"errata"}), path.name  # errata.toml is a file as well


@pytest.mark.parametrize(
    ("repeats", "steps"), [(None, (10, 20, 40)), (12, (10, 12)), (2, (2,)), (0, ())]
)
def test_steps_end_at_the_most_repeats(repeats, steps):
    assert frame.Setting(repeats=repeats).repeat_steps((10, 20, 40)) == steps
    assert frame.Setting(trials=repeats).trial_steps((10, 20, 40), quick=6) == steps
    quick = frame.Setting(quick=True, repeats=repeats).repeat_steps((10, 20, 40))
    assert quick == ((1,) if repeats != 0 else ())


def test_margins_are_written_down_before_the_run(outcomes):
    margin = frame.paper_values("table3")["margin"]
    assert set(margin) == {"accuracy", "cost"}
    plus = table3.judge(
        {name: outcomes(37.10, 0.0) for name in ("random", table3.ALL, "morc")}, 2
    )[f"{table3.ALL}, 2 attributes: cost 37.10"]  # fmt: skip
    assert plus.rule == "cost is in [37.095, 37.105]"


def test_plain_values_are_json_of_six_digits():
    plain = frame.plain_cell
    assert plain(1 / 3) == 0.333333
    assert plain(frame.Estimate(2 / 3, nan)) == [0.666667, None]
    assert plain(inf) is None
    assert json.dumps([plain(nan), plain(None), plain("a"), plain(3)]) == '[null, null, "a", 3]'
