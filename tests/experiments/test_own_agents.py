"""Agents given as values, in processes and after an edit, and what their digest covers."""

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
from meal_bayes.experiments.store import agent_digest
from meal_bayes.momdp import best_report
from meal_bayes.planners import RandomLegal, unvalued


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.long)])
def test_an_edited_planner_runs_again(module, tmp_path, jobs):
    """Without a key nothing is reused; with one, what ran under it."""
    lengths = []
    for looks, key in ((1, ""), (2, ""), (1, "one"), (2, "two"), (1, "two"), (2, "one")):
        config = OfflineConfig("cy101", 1, 4, (module(looks).Looker(),), seed=1, key=key)
        run = run_offline(config, logs=tmp_path / "logs", jobs=jobs)
        lengths.append({len(trial.steps) for trial in run.trials()})
    assert lengths == [{2}, {3}, {2}, {3}, {3}, {2}]
    assert len({path.name for path in run.folder.parent.iterdir()}) == 4


def test_values_set_after_the_import_are_seen(module, tmp_path):
    """Nothing of a run without a key is reused, whatever a program changes."""
    mine = module(1)
    lengths = []
    for looks in (1, 2):
        mine.LOOKS = looks
        run = run_offline(OfflineConfig("cy101", 1, 4, (mine.Looker(),), seed=1), logs=tmp_path)
        lengths.append({len(trial.steps) for trial in run.trials()})
    assert lengths == [{2}, {3}]


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
    with pytest.raises(SettingsError, match=r"listed twice.*attributes `name`"):
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


def test_settings_and_key_matter_and_shipped_agents_have_neither(module):
    planner = module(1).Looker

    def digest(key="one", **settings):
        value = planner()
        vars(value).update(settings)
        return agent_digest(as_agent(value), key)

    values = [{}, {"a": 1}, {"a": 2}, {"a": {"x", "y"}}, {"a": np.arange(5000)}]
    values.append({"a": np.append(np.arange(4999), 0)})  # another where its repr says nothing
    assert len({digest(**settings) for settings in values}) == len(values)
    assert digest() == digest() != digest("two")
    assert digest("") != digest("")
    assert digest(a={"x", "y"}) == digest(a={"y", "x"})
    assert {agent_digest(agent, "one") for agent in AGENTS.values()} == {""}


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
    assert agent_digest(agent, "") != agent_digest(agent, "")
    assert "gets a new folder" in caplog.text


def test_two_planners_of_one_function_do_not_share_a_run(tmp_path):
    lengths = []
    for sure in (0.4, 0.9999):
        config = OfflineConfig("roc36", 1, 3, agents=(planner_of(sure),))
        run = run_offline(config, logs=tmp_path)
        lengths.append([len(trial.steps) for trial in run.trials()])
    assert lengths[0] == [1, 1, 1]
    assert min(lengths[1]) > 1


def test_a_shipped_agent_with_other_settings_is_another_and_needs_no_key():
    ships = AGENTS["bayes"]
    others = [replace(ships, discount=d) for d in (0.5, 0.6)]
    others += [replace(ships, solver=as_agent(RandomLegal(b)).solver) for b in (9.0, 10.0)]
    digests = [agent_digest(agent, "") for agent in (*others, ships)]
    assert len(set(digests)) == 5
    assert digests[-1] == ""
    assert [agent_digest(agent, "") for agent in (*others, ships)] == digests


class Bolder(RandomLegal):
    """A class of the user's, below one of the package's."""


@pytest.mark.parametrize("value", [Bolder(9.0), Settled(limit=0.4)])
def test_classes_of_the_user_need_a_key(value):
    agent = as_agent(value)
    assert agent_digest(agent, "") != agent_digest(agent, "")
    assert agent_digest(agent, "one") == agent_digest(agent, "one")


@pytest.mark.long
def test_the_digest_is_that_of_every_process(module):
    """Strings have another hash in each, and so sets another order."""
    mine = module(1)
    folder = Path(mine.__file__).parent
    code = (
        f"from {mine.__name__} import Looker; from meal_bayes.agents import as_agent;"
        "from meal_bayes.experiments.store import agent_digest;"
        "p = Looker(); p.words = set('abcdefgh'); print(agent_digest(as_agent(p), 'one'))"
    )
    digests = set()
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": f"{folder}:{ROOT}"}
        digests.add(subprocess.check_output([sys.executable, "-c", code], env=environment))
    assert len(digests) == 1


ROOT = Path(store.__file__).resolve().parents[2]
