import fnmatch
import json
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from meal_bayes import read_trials
from meal_bayes.agents import load_agent
from meal_bayes.datasets import load_percepts
from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import Estimate, estimate_mean
from meal_bayes.momdp import build_momdp
from meal_bayes.perception import table_counts
from paper_repro import frame, offline, online, pages, published
from paper_repro.statements import RECORDED, THEIRS

FOLDER = Path(frame.__file__).parent
NOBODY = np.full(3, nan)


class Stop(Exception):
    """Ends a run that has shown how it counts."""


RUNS = {
    "trials": (
        offline,
        lambda setting: offline.run_agent(
            setting, RECORDED, "roc36", n=1, agent="random", trials=5
        ),
    ),
    "batches": (
        online,
        lambda setting: online.run_curves(setting, "cy101", n=1, agent=online.BASE, repeats=1),
    ),
}


@pytest.mark.parametrize("noun", RUNS)
def test_runs_say_of_what_their_totals_are(monkeypatch, noun):
    module, start = RUNS[noun]
    told = []

    def run(config, *, on_progress, **how):
        on_progress(1, 220)
        raise Stop

    name = module.__name__.rpartition(".")[2]
    monkeypatch.setattr(module, f"run_{name}", run)
    with pytest.raises(Stop):
        start(frame.Setting(on_progress=lambda *facts: told.append(facts)))
    assert told == [(1, 220, noun)]


PARTIAL = ({"quick": True}, {"as_published": True}, {"seed": 1}, {"trials": 5}, {"repeats": 1})


@pytest.mark.parametrize("part", PARTIAL, ids=str)
def test_only_a_full_run_replaces_the_committed_results(elsewhere, tmp_path, part):
    setting = frame.Setting(logs=tmp_path / "logs", jobs=2, **part)
    assert not setting.full
    frame.reproduce("table5", setting)
    assert not elsewhere.exists()
    assert (tmp_path / "logs" / "paper_repro" / "table5.json").is_file()


def test_panels_that_do_not_exist_are_refused_with_those_that_do(elsewhere, tmp_path):
    setting = frame.Setting(logs=tmp_path / "logs", only="nothing")
    with pytest.raises(SettingsError, match=r"'nothing'; expected .* CY101, 1 attribute; "):
        frame.reproduce("fig10", setting)
    with pytest.raises(frame.NotRun, match="no panels"):
        frame.reproduce("table5", setting)
    assert not elsewhere.exists()


@pytest.mark.quick(2)
@pytest.mark.parametrize("item", ["table5", "fig7", "fig5", "t1t2"])
def test_a_full_run_again_gives_the_committed_files(elsewhere, tmp_path, item):
    frame.reproduce(item, frame.Setting(logs=tmp_path / "logs"))
    assert frame.provenance(elsewhere)[item]["seconds"] >= 0
    made = sorted(path for path in elsewhere.iterdir() if path.name != frame.PROVENANCE)
    assert (elsewhere / f"{item}.json") in made
    for path in made:
        committed = FOLDER / "results" / path.name
        if path.suffix == ".json":  # pixels depend on the version of matplotlib
            assert path.read_text() == committed.read_text()
        else:
            assert committed.is_file()


def test_offline_trials_are_taken_from_the_logs(tmp_path):
    setting = frame.Setting(quick=True, logs=tmp_path)
    once, again = (
        offline.run_agent(setting, RECORDED, "roc36", n=2, agent="random", trials=5)
        for _ in range(2)
    )
    (unit,) = tmp_path.rglob("*.mcap")
    assert len(once) == len(again) == 5
    ((path, seconds),) = setting.spent.items()  # once for both
    assert path == unit
    assert seconds > 0
    assert once.report.shape == (5, 2)
    assert (once.success == (once.report == once.truth).all(axis=1)).all()
    unit.with_name("unit-0000.timing.csv").unlink()
    third = offline.run_agent(setting, RECORDED, "roc36", n=2, agent="random", trials=5)
    assert (third.cost == once.cost).all()
    assert setting.spent == {unit: 0.0}


def test_every_behavior_costs_what_the_paper_prints(tmp_path):
    setting = frame.Setting(quick=True, logs=tmp_path)
    for protocol in (RECORDED, THEIRS):
        run = offline.run_agent(
            setting, protocol, published.EVERY_ACTION, n=2, agent="predefined_plus", trials=5
        )
        assert run.cost == pytest.approx(37.10, abs=1e-9)
        assert run.cost.std(ddof=1) == pytest.approx(0, abs=1e-9)


@pytest.mark.long
@pytest.mark.statistical
@pytest.mark.parametrize(("n", "cost", "sd"), [(2, 19.2, 28.0), (3, 9.7, 18.0)])
def test_the_published_random_pays_for_all_actions(tmp_path, n, cost, sd):
    """Costs of an independent simulation of the published code."""
    setting = frame.Setting(quick=True, logs=tmp_path)
    run = offline.run_agent(
        setting, THEIRS, published.EVERY_ACTION, n=n, agent="random", trials=400
    )
    assert abs(run.cost.mean() - cost) <= 2 * estimate_mean(run, "cost").se
    assert run.cost.std(ddof=1) == pytest.approx(sd, rel=0.25)


@pytest.mark.long
def test_the_published_random_ends_a_trial_by_what_is_illegal_on_ispy32_alone(tmp_path):
    """At the start 2 of 10 behaviors are legal, so that 8 of 12 first draws end the trial."""
    setting = frame.Setting(quick=True, logs=tmp_path)
    run = offline.run_agent(setting, THEIRS, "ispy32_published", n=1, agent="random", trials=400)
    ended = (~run.answered) & (run.steps == 1)
    assert abs(ended.mean() - 8 / 12) < 4 * (8 / 12 * 4 / 12 / 400) ** 0.5
    assert (run.cost[ended] == 0).all()
    every = offline.run_agent(
        setting, THEIRS, published.EVERY_ACTION, n=2, agent="random", trials=20
    )
    assert every.answered.all()


def test_random_legal_asks_at_the_start_alone_as_published_and_never_on_recordings(tmp_path):
    asks = {}
    for protocol in (RECORDED, THEIRS):
        setting = frame.Setting(quick=True, logs=tmp_path / protocol)
        offline.run_agent(setting, protocol, "ispy32", n=1, agent="random_legal", trials=30)
        for path in setting.logs.rglob("*.mcap"):
            for trial in read_trials(path):
                ask = trial.momdp.behavior_names.index("ask")
                start = trial.momdp.start
                where = [step.x == start for step in trial.steps if step.decision.action == ask]
                asks.setdefault(protocol, []).extend(where)
    assert asks[THEIRS]
    assert all(asks[THEIRS])
    assert not asks[RECORDED]


def test_counts_are_those_of_every_object_that_is_left_out():
    table = load_percepts("roc36")
    shape = (len(table.domain.attributes), len(table.domain.behaviors), 2, 2)
    counts = np.random.default_rng(0).integers(0, 1800, shape)
    changed = published.with_counts(table, counts)
    for held_out in (0, 17):
        known = table_counts(changed, held_out, levels=2).sum(axis=0)  # (P,E,2,K)
        sensing = [bool(behavior.modalities) for behavior in table.domain.behaviors]
        np.testing.assert_array_equal(known[:, sensing], counts[:, sensing])


def test_the_simulators_percepts_depend_on_the_state_reached_alone():
    """PM src_py/constructor.py, generate_obs_fun: state -> what shows something there."""
    shows = {"x1": {"look"}, "x2": {"grasp"}, "x3": {"lift_slow"}, "x4": {"hold"},
             "x5": {"tap", "poke", "push", "shake", "high_velocity_shake", "low_drop"}}  # fmt: skip
    domain = load_domain(published.SIMULATOR)
    rates = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    momdp = build_momdp(domain, Query(domain.attributes[:1]), rates)
    possible = momdp.transition * momdp.observation_probability > 0
    for e, x in np.argwhere(possible.any(axis=1)).tolist():  # behavior, state reached
        name = momdp.behavior_names[e]
        assert name in shows.get(momdp.x_names[x], set()) | {"crush", "ask"}
    by_state = possible.any(axis=1).sum(axis=0)[:6].tolist()
    assert by_state == [2, 3, 3, 3, 3, 8]


@pytest.mark.long
def test_in_plotted_settings_a_person_is_right_in_each_attribute(tmp_path):
    table = load_percepts(published.plotted_ispy32(frame.Setting(logs=tmp_path)))
    ask = table.domain.behaviors[table.domain.behavior_index("ask")]
    assert (ask.cost, ask.answer_accuracy) == (100.0, 0.65)
    assert table.domain.legal_budget == (100.0,)


@pytest.mark.long
@pytest.mark.real_data
def test_published_matrices_give_the_papers_predefined_plus(tmp_path, recordings, monkeypatch):
    """Table 3 prints .583; what its simulator loads comes within .05 of it."""
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", str(recordings))
    monkeypatch.delenv("MEAL_BAYES_OFFLINE", raising=False)
    setting = frame.Setting(logs=tmp_path)
    table = published.table_path(
        setting, "roc36", name="roc36_every", domain=published.EVERY_ACTION, matrices="train5"
    )
    run = offline.run_agent(setting, THEIRS, table, n=2, agent="predefined_plus", trials=400)
    assert abs(run.success.mean() - 0.583) < 0.05


def test_the_papers_agents_share_one_planner():
    base, best = (load_agent(name) for name in (online.BASE, online.BEST))
    assert base.solver is best.solver
    assert replace(best, name=base.name, exploration=base.exploration) == base


def test_items_are_named_in_the_papers_order():
    assert frame.named(["all"]) == frame.items()
    assert frame.named(["table5", "fig7"]) == frame.named(["table5,fig7"]) == ("fig7", "table5")
    with pytest.raises(SettingsError, match="Unknown item 'tabel5': did you mean 'table5'"):
        frame.named(["tabel5"])


def test_an_item_is_a_script_and_a_section():
    scripts = {path.stem for path in FOLDER.glob("items/*.py")} - {"__init__"}
    assert scripts == set(frame.items())


def test_runs_are_as_long_as_asked_for():
    assert frame.Setting().trials_of(400, 6) == 400
    assert frame.Setting(quick=True).trials_of(400, 6) == 6
    assert frame.Setting(trials=100).trials_of(400, 6) == 100
    for setting, column in ((frame.Setting(repeats=0), THEIRS),
                            (frame.Setting(as_published=True), RECORDED)):  # fmt: skip
        with pytest.raises(frame.NotRun):
            setting.repeats_of(20, column=column)
    part = frame.Setting(repeats=5, only="CY101, 1")
    assert frame.command("fig10", part) == (
        'meal-bayes reproduce fig10 --repeats 5 --only "CY101, 1" --seed 0'
    )
    assert frame.Setting(quick=True).repeats_of(20) == 2


def test_every_item_names_its_place_and_central_statements_that_there_are():
    assert set(frame.paper_values("table3")["margin"]) == {"accuracy", "cost"}
    for item in frame.items():
        paper = frame.paper_values(item)
        path = frame.RESULTS / f"{item}.json"
        assert paper["where"]
        if not path.is_file() or frame.is_marked_older(item):  # older ones may lack statements
            continue
        texts = [row["text"] for row in json.loads(path.read_text("utf-8"))["statements"]]
        for pattern in paper.get("central", []):
            assert fnmatch.filter(texts, pattern), (item, pattern)


def test_a_mean_that_nobody_has_is_a_dash():
    table = {"title": "", "columns": ["a"], "rows": frame.plain([[online.mean_of(NOBODY, 0.5)]])}
    facts = dict.fromkeys(("item", "title", "sentence", "verdict", "size", "command", "shows"), "")
    page = pages.result_page(facts | {"statements": [], "tables": [table], "figures": [],
                                      "notes": []})  # fmt: skip
    assert page.endswith("| \N{EN DASH} |")


def test_plain_values_are_json_of_six_digits():
    plain = frame.plain
    assert plain(1 / 3) == 0.333333
    assert plain(Estimate(2 / 3, nan, 3)) == [0.666667, None]
    assert plain(inf) is None
    assert json.dumps([plain(nan), plain(None), plain("a"), plain(3)]) == '[null, null, "a", 3]'
