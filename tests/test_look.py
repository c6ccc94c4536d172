"""What objects show of themselves: short texts, tables for a notebook, data frames."""

import dataclasses
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import meal_bayes
from meal_bayes.agents import knowledge_without
from meal_bayes.datasets import TrainingSet, load_percepts, make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.evaluation import summarize
from meal_bayes.experiments import OfflineConfig, offline_tasks, run_offline
from meal_bayes.learner import Learner
from meal_bayes.look import percent
from meal_bayes.perception import fit_and_validate
from meal_bayes.planners import RULE
from meal_bayes.trial_log import read_trials
from meal_bayes.trials import Trial, trials_frame

LONGEST = 2000  # characters


class Outline(HTMLParser):
    """Counts what a page holds; fails where tags are not closed in order."""

    VOID = frozenset({"br", "img", "source"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open = list[str]()
        self.count = dict[str, int]()
        self.text = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.count[tag] = self.count.get(tag, 0) + 1
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def trial() -> Trial:
    return meal_bayes.ask(
        "Is it heavy, and does it hold beans?",
        dataset="roc36", object="heavy_green_beans", agent="greedy", logs=None,
    )  # fmt: skip


@pytest.fixture(scope="module")
def things(trial):
    """Return one of every public kind of object."""
    table = load_percepts("cy101")
    domain = load_domain("toy")
    dataset = make_synthetic(domain, objects=40, recordings=3, rng=np.random.default_rng(0))
    everything = TrainingSet.everything(dataset)
    perception, _ = fit_and_validate(dataset, everything)
    roc36 = load_percepts("roc36")
    known = knowledge_without(roc36, 0)
    learner = Learner("roc36", agent="bayes", logs=None).fit(roc36)
    return [
        trial, trial.momdp, trial.last_belief, trial.task, trial.steps[0], trial.task.query,
        trial.steps[0].decision, table, table.domain, load_domain("ispy32").diagram, dataset,
        dataset.instance(0, "look", 0), everything, perception, learner.agent,
        learner, known, known.posterior, known.trait,
        OfflineConfig("roc36"), summarize([trial]), summarize([trial])[0], load_domain("ispy32"),
    ]  # fmt: skip


def test_every_public_object_shows_itself_briefly(things):
    sizes = {type(thing).__name__: len(repr(thing)) for thing in things}
    assert {name: size for name, size in sizes.items() if size > LONGEST} == {}


def test_main_objects_show_themselves_in_a_few_lines(things):
    for name in ("Trial", "MOMDP", "Belief", "Dataset", "PerceptTable", "Domain"):
        thing = next(thing for thing in things if type(thing).__name__ == name)
        assert 3 <= len(repr(thing).splitlines()) <= 6


def test_a_learner_shows_what_it_has_learned():
    table = load_percepts("roc36")
    replays = Learner("roc36", agent="greedy", logs=None).fit(table)
    shown = Outline(replays._repr_html_()).text
    assert "learned from 36 objects with labels" in shown
    heavy = shown.partition("heavy")[2]
    assert heavy.startswith(f"12, 24{percent(13 / 39)}")  # labels; rate of three values


def test_a_learner_says_what_to_do_next():
    learner = Learner("toy", logs=None)
    nothing = Outline(learner._repr_html_())
    assert "0 recordings of 0 objects" in nothing.text
    assert "learner.fit(dataset)" in nothing.text
    assert "table" not in nothing.count
    first = learner.domain.attributes[0]
    learner.tell("a mug", {first: True})
    page = Outline(learner._repr_html_())
    assert page.count["tr"] == 1 + len(learner.domain.attributes)
    rate = learner.knowledge().base_rates[0]
    assert rate > 0.5
    assert f"{first}1, 0{percent(rate)}none yet" in page.text


@pytest.mark.parametrize("seed", range(3))
def test_the_best_behavior_of_a_learner_has_the_largest_youden(seed):
    domain = load_domain("toy")
    rng = np.random.default_rng(seed)
    dataset = make_synthetic(domain, objects=12, recordings=3, rng=rng)
    learner = Learner(domain, logs=None).fit(dataset)
    known = learner.knowledge()
    rows = learner._repr_html_().split("<tr>")[2:]
    for p, row in enumerate(rows):
        cells = re.findall("<td[^>]*>(.*?)</td>", row)
        best = np.where(known.posterior.informative, known.posterior.youden, -1)[p].argmax()
        false, true = known.posterior.mean[p, best][:, known.posterior.mean.shape[-1] // 2 :].sum(1)
        rate = known.base_rates[p]
        right = rate * true + (1 - rate) * (1 - false)
        expected = [domain.behavior_names[best], f"{true - false:.2f}", percent(right)]
        told_apart = known.posterior.informative[p].any()
        assert cells[3:] == (expected if told_apart else ["none yet", "", ""])


def test_a_trial_is_a_table_with_a_bar_a_belief(trial):
    page = Outline(trial._repr_html_())
    assert page.count["tr"] == 2 + len(trial.steps)  # header, before
    assert page.count["span"] == 2 * 2 * (1 + len(trial.steps))
    for word in ("Pr(heavy)", "Pr(beans)", "before", "report heavy, beans", "(right)"):
        assert word in page.text


def test_a_decision_names_what_it_compared(tmp_path):
    asked = {"dataset": "roc36", "object": "heavy_green_beans", "log": tmp_path / "one.mcap"}
    trial = meal_bayes.ask("Is it heavy?", agent="bayes", **asked)
    behaviors = trial.momdp.behavior_names
    for shown in (trial, *read_trials(tmp_path / "one.mcap")):
        for step in shown.steps:
            decision = step.decision
            valued = np.flatnonzero(~np.isnan(decision.values[:-1]))
            text = repr(decision)
            assert f"Decision: {shown.momdp.action_name(decision.action)}" in text
            assert "behavior" not in text
            named = sum(behaviors[e] in text for e in valued)
            assert named == len(valued) or "..." in text
    bare = dataclasses.replace(decision, momdp=None)
    assert "Decision: answer" in repr(bare)


def test_a_decision_by_a_rule_says_so():
    asked = {"dataset": "roc36", "object": "heavy_green_beans", "logs": None}
    trial = meal_bayes.ask("Is it heavy?", agent="predefined", **asked)
    text = repr(trial.steps[0].decision)
    assert "Decision: look" in text
    assert RULE in text


def test_names_cannot_break_out_of_a_table(trial):
    task = dataclasses.replace(trial.task, object_name="<script>alert(1)</script>")
    page = Outline(dataclasses.replace(trial, task=task)._repr_html_())
    assert "script" not in page.count
    assert "<script>" in page.text


def test_a_trial_without_truth_or_report_is_shown(trial):
    unknown = dataclasses.replace(trial, truth=np.array([-1, 1]), report=None)
    assert "report  none" in repr(unknown)
    unknown = dataclasses.replace(trial, truth=np.array([-1, 1]))
    assert "(truth unknown)" in repr(unknown)
    row = trials_frame([unknown]).iloc[0]
    assert pd.isna(row["success"])
    assert pd.isna(row["truth"])


def test_the_frame_of_a_trial_holds_its_steps(trial):
    frame = trial.to_frame()
    assert len(frame) == len(trial.steps)
    assert frame["cost_s"].sum() == pytest.approx(trial.cost)
    assert frame["reward"].sum() == pytest.approx(trial.reward)
    assert frame["belief_heavy"].iloc[-1] == trial.last_belief.positive[0]
    assert "probability" not in frame
    silent = [step.observation is None for step in trial.steps]
    assert frame["percept_beans"].isna().tolist() == silent
    assert frame["action"].iloc[-1] == "report heavy, beans"
    assert not frame["warning"].any()
    warned = (dataclasses.replace(trial.steps[0], warning="no percept of look: dark"),)
    broken = dataclasses.replace(trial, steps=(*warned, *trial.steps[1:]))
    assert broken.to_frame()["warning"].iloc[0] == "no percept of look: dark"
    assert "no percept of look: dark" in repr(broken)


def test_frames_of_a_run_say_what_its_summary_says(tmp_path):
    config = OfflineConfig("roc36", trials=6, agents=("greedy", "predefined"))
    run = run_offline(config, logs=tmp_path)
    frame = run.to_frame()
    summary = summarize(run.trials())
    assert len(frame) == 12
    means = frame.groupby("agent", sort=False)[["success", "cost_s", "reward"]].mean()
    expected = summary.to_frame().set_index("agent")
    for name, column in (("success", "accuracy"), ("cost_s", "cost_s"), ("reward", "reward")):
        np.testing.assert_allclose(means[name].astype(float), expected[column])
    tasks = offline_tasks(load_percepts("roc36"), 2, 6, 0)
    assert frame["object"].tolist() == [task.object_name for task in tasks] * 2
    assert "greedy" in repr(summary)


def test_empty_lists_are_frames_too():
    assert len(trials_frame([])) == 0
    assert "accuracy" in summarize([]).to_frame().columns


def test_only_learners_and_trials_have_html(things):
    assert {type(thing) for thing in things if hasattr(thing, "_repr_html_")} == {Trial, Learner}


@pytest.mark.long
@pytest.mark.parametrize("backend", ["module://no_such.backend", "nonsense"])
def test_pictures_do_not_depend_on_a_notebook_s_backend_or_a_user_s_matplotlibrc(tmp_path, backend):
    (tmp_path / "matplotlibrc").write_text(
        "text.usetex: True\nfont.size: 30\naxes.facecolor: red\nsavefig.bbox: tight\n"
    )
    settings = {"MPLBACKEND": backend, "MATPLOTLIBRC": os.fspath(tmp_path / "matplotlibrc")}
    sample = Path(__file__).resolve().parents[1] / "logs" / "sample.mcap"
    for name, more in (("plain", {}), ("set", settings)):
        for words in (
            ("log", "show", sample, "--trial", "1", "--picture", tmp_path / f"{name}.svg"),
            ("report", sample, "-o", tmp_path / f"{name}.html"),
        ):
            done = subprocess.run(
                [sys.executable, "-m", "meal_bayes", *map(str, words)],
                env={**os.environ, **more}, capture_output=True, text=True, check=False,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
    for kind in ("svg", "html"):
        drawn = [(tmp_path / f"{name}.{kind}").read_bytes() for name in ("plain", "set")]
        assert drawn[0] == drawn[1]


@pytest.mark.quick(1)
@pytest.mark.parametrize("backend", ["nonsense", "agg", ""])
def test_a_picture_in_a_user_s_program_does_not_depend_on_the_backend(backend):
    """Nor does a bad one go on behind it; a good one is what the user's own figures have."""
    program = (
        "import os, meal_bayes.look as look\n"
        "with look.axes_to_draw(None) as ax: pass\n"
        "look.render(ax, 'svg')\n"
        "import matplotlib\n"
        "print(os.environ['MPLBACKEND'], matplotlib.get_backend())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "MPLBACKEND": backend}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1].lower() == "agg"
    assert done.stdout.startswith(f"{backend} ")
