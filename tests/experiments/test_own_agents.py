"""Agents given as values, in processes and after an edit, and what their digest covers."""

import importlib
import json
import os
import subprocess
import sys
import threading
from collections import defaultdict
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from meal_bayes.agents import AGENTS, Agent, as_agent
from meal_bayes.cli import main
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import OfflineConfig, OnlineConfig, run_offline, run_online, store
from meal_bayes.experiments.store import own_agent_digest
from meal_bayes.momdp import best_report
from meal_bayes.planners import RandomLegal, unvalued


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.long)])
def test_an_edited_planner_runs_again(module, tmp_path, jobs):
    lengths = {}
    for looks in (1, 2, 1):
        config = OfflineConfig("cy101", 1, 4, (module(looks).Looker(),), seed=1)
        run = run_offline(config, logs=tmp_path / "logs", jobs=jobs)
        lengths.setdefault(looks, []).append([len(trial.steps) for trial in run.trials()])
        folder = run.folder
    assert set(lengths[1][0]) == {2}
    assert set(lengths[2][0]) == {3}
    assert lengths[1][0] == lengths[1][1]
    assert len({path.name for path in folder.parent.iterdir()}) == 2


def test_on_the_command_line(module, tmp_path, monkeypatch):
    name = module(2).__name__
    monkeypatch.chdir(tmp_path / "mine")
    words = ["run", "offline", "--dataset", "cy101", "--attributes", "1", "--trials", "3",
             "--json", "--logs", str(tmp_path / "logs"), "--agent"]  # fmt: skip
    done = CliRunner().invoke(main, [*words, f"{name}:Looker,predefined"])
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["rows"]
    assert [row["agent"] for row in rows] == ["Looker", "predefined"]
    for wrong, says in (
        ("no_such_module:x", "cannot be imported"),
        (f"{name}:Nobody", "'Nobody': expected one of: LOOKS, Looker, LookerPolicy, best_report"),
        (f"{name}:LOOKS", "a planner with a method solve"),
    ):
        done = CliRunner().invoke(main, [*words, wrong])
        assert done.exit_code == 2
        assert says in done.stderr
        assert "Traceback" not in done.output


def test_online_runs_take_them_too(own_data, module, tmp_path, contents):
    looker = module(2).Looker()
    config = OnlineConfig(
        str(own_data), root=str(own_data.parent), agents=(looker,), batches=1, trials=4
    )
    runs = [run_online(config, logs=tmp_path / f"jobs{jobs}", jobs=jobs) for jobs in (1, 2)]
    assert contents(runs[0].folder) == contents(runs[1].folder)
    assert runs[0].config.reward == 100.0  # the domain's own
    assert {result.agent for result in runs[0].results()} == {"Looker"}


def test_two_planners_of_one_class_are_told_apart_by_their_names(module):
    first, second = (module(looks).Looker() for looks in (1, 2))
    with pytest.raises(SettingsError, match=r"named twice.*an attribute `name`"):
        OfflineConfig("roc36", agents=(first, second))
    second.name = "two looks"
    config = OfflineConfig("roc36", agents=(first, second))
    assert [agent.name for agent in config.agents] == ["Looker", "two looks"]


def test_what_an_agent_is():
    solver = RandomLegal(9.0)
    for value in (solver, RandomLegal, lambda domain, query: solver):
        agent = as_agent(value)
        assert agent.levels == 4
        assert agent.object_level
        assert hasattr(agent.solver(None, None), "solve")
    assert as_agent("bayes") is AGENTS["bayes"]
    assert as_agent(AGENTS["bayes"]) is AGENTS["bayes"]
    for wrong in (7, None, object()):
        with pytest.raises(SettingsError, match="a planner with a method solve"):
            as_agent(wrong)
    assert isinstance(OfflineConfig("roc36", agents=("bayes",)).agents[0], Agent)


ROOT = Path(store.__file__).resolve().parents[2]
PLANNER = """import numpy
from rules import best

class Planner:
    name = "mine"

    def solve(self, *arguments, **options):
        raise NotImplementedError
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A planner in a module, what it imports from beside it, and a module that nobody imports."""
    (tmp_path / "kept").mkdir()
    (tmp_path / "planner_of_mine.py").write_text(PLANNER)
    (tmp_path / "rules.py").write_text("import json\nfrom kept import deep\nbest = 1\n")
    (tmp_path / "kept" / "__init__.py").write_text("")
    (tmp_path / "kept" / "deep.py").write_text("depth = 3\n")
    (tmp_path / "other.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("planner_of_mine", "rules", "kept", "kept.deep"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "matters"),
    [("planner_of_mine.py", True), ("rules.py", True), ("kept/deep.py", True), ("other.py", False)],
)
def test_what_a_planner_imports_from_beside_it_is_in_its_digest(folder, changed, matters):
    agent = as_agent(importlib.import_module("planner_of_mine").Planner())
    before = own_agent_digest(agent)
    with (folder / changed).open("a") as file:
        file.write("\nmore = 1\n")
    assert (own_agent_digest(agent) != before) == matters


def test_settings_matter_and_shipped_agents_have_no_sources(folder):
    planner = importlib.import_module("planner_of_mine").Planner

    def digest(**settings):
        value = planner()
        vars(value).update(settings)
        return own_agent_digest(as_agent(value))

    values = [{}, {"a": 1}, {"a": 2}, {"a": {"x", "y"}}, {"a": np.arange(5000)}]
    values.append({"a": np.append(np.arange(4999), 0)})  # another where its repr says nothing
    assert len({digest(**settings) for settings in values}) == len(values)
    assert digest(a={"x", "y"}) == digest(a={"y", "x"})
    assert {own_agent_digest(agent) for agent in AGENTS.values()} == {""}


def planner_of(sure):
    class Untried:
        def solve(self, momdp, rng):
            self.momdp = momdp
            return self

        def decide(self, history, rng):
            momdp = self.momdp
            belief = history.belief
            legal = np.flatnonzero(momdp.legal[belief.x, : momdp.n_behaviors])
            untried = [int(e) for e in legal if e not in history.actions]
            done = belief.certainty > sure or not untried
            return unvalued(momdp, best_report(momdp, belief) if done else untried[0])

    return Untried()


class Settled:
    """A planner whose settings are values."""

    limit = 0.5

    def __init__(self, **settings):
        vars(self).update(settings)

    def solve(self, momdp, rng):
        raise NotImplementedError


UNKNOWN = [
    planner_of(0.4),
    lambda domain, query: 0.4,
    Settled(sure=lambda: 0.4),
    Settled(lock=threading.Lock()),
    Settled(later=(n for n in [1])),
    Settled(inside=[{"deep": {1: (lambda: 1,)}}]),
    Settled(keyed=defaultdict(lambda: 1)),
    Settled(called=partial(planner_of, lambda: 1)),
    replace(AGENTS["bayes"], observation_model=lambda knowledge, columns: None),
    replace(AGENTS["morc"], trained_by=as_agent(planner_of(0.4))),
]


@pytest.mark.parametrize("value", UNKNOWN, ids=range(len(UNKNOWN)))
def test_what_cannot_be_known_is_told_and_never_the_same(value, caplog):
    agent = as_agent(value)
    assert own_agent_digest(agent) != own_agent_digest(agent)
    assert "a folder of its own" in caplog.text


def test_two_planners_of_one_function_do_not_share_a_run(tmp_path):
    lengths = []
    for sure in (0.4, 0.9999):
        config = OfflineConfig("roc36", 1, 3, agents=(planner_of(sure),))
        run = run_offline(config, logs=tmp_path)
        lengths.append([len(trial.steps) for trial in run.trials()])
    assert lengths[0] == [1, 1, 1]
    assert min(lengths[1]) > 1


def test_a_shipped_agent_with_other_settings_is_another(folder):
    ships = AGENTS["bayes"]
    digests = {own_agent_digest(replace(ships, discount=d)) for d in (0.5, 0.6, ships.discount)}
    assert len(digests) == 3
    assert own_agent_digest(ships) == ""
    assert own_agent_digest(replace(ships, discount=0.5)) in digests


@pytest.mark.long
def test_the_digest_is_that_of_every_process(folder):
    """Strings have another hash in each, and so sets another order."""
    code = (
        "from planner_of_mine import Planner; from meal_bayes.agents import as_agent;"
        "from meal_bayes.experiments.store import own_agent_digest;"
        "p = Planner(); p.words = set('abcdefgh'); print(own_agent_digest(as_agent(p)))"
    )
    digests = set()
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": f"{folder}:{ROOT}"}
        digests.add(subprocess.check_output([sys.executable, "-c", code], env=environment))
    assert len(digests) == 1
