"""The report: its figures are right, nothing leaves the page, damage and the unknown are told."""

import base64
import dataclasses
import html
import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from meal_bayes.errors import LogError
from meal_bayes.evaluation import compare, summarize
from meal_bayes.evaluation.logged import DEAREST, GAIN, LOSS, AgentPart, ShownTrials
from meal_bayes.evaluation.plots import trial_picture
from meal_bayes.evaluation.report import best_of, write_report
from meal_bayes.learner import ask
from meal_bayes.look import ordered_agents
from meal_bayes.trial_log import Feedback, Group, Logs, TrialWriter, write_trials
from meal_bayes.trial_log.folder import write_feedback
from meal_bayes.trials import TrialOutcomes, truth_text
from meal_bayes.viewer.labels import narrate
from meal_bayes.viewer.recorder import Clock

OBJECTS = ("heavy_blue_beans", "light_blue_rice", "medium_green_glass", "light_brown_screws")
AGENTS = ("predefined", "random", "greedy")


@pytest.fixture(scope="module")
def trials():
    return [
        ask(question, dataset="roc36", object=name, agent=agent, logs=None)
        for agent in AGENTS
        for name in OBJECTS
        for question in ("heavy, beans", "blue")
    ]


@pytest.fixture(scope="module")
def folder(trials, tmp_path_factory):
    path = tmp_path_factory.mktemp("run")
    header = {"config": {"dataset": "roc36", "note": "<script>alert(1)</script> & more"}}
    for agent in AGENTS:
        of_agent = [trial for trial in trials if trial.agent == agent]
        write_trials(path / agent / "unit-0000.mcap", of_agent, header=header)
    return path


@pytest.fixture(scope="module")
def page(folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(Logs(folder), path)
    return path


def test_the_table_holds_the_measures(trials, page, cells):
    rows = {row[0]: row for row in cells(page.read_text()) if row and len(row) == 8}
    for row in summarize(trials):
        shown = [cell.split(" ")[0] for cell in rows[row.agent]]
        numbers = (f"{row.accuracy:.3f}", f"{row.cost_s:.1f}", f"{row.reward:.1f}")
        assert shown[1:5] == [str(row.trials), *numbers]
        assert shown[5:7] == [f"{row.nll:.3f}", f"{row.ece:.3f}"]


def test_attributes_and_behaviors_are_counted(trials, page, cells):
    rows = {row[0]: row for row in cells(page.read_text()) if row}
    agents = ordered_agents(AGENTS)
    for name in ("heavy", "beans", "blue"):
        asked = [trial for trial in trials if name in trial.task.query.attributes]
        assert rows[name][1] == str(len(asked) // len(AGENTS))  # trials an agent
        for agent, shown in zip(agents, rows[name][2:], strict=True):
            right = []
            for trial in (trial for trial in asked if trial.agent == agent):
                i = trial.task.query.attributes.index(name)
                right.append(trial.report is not None and trial.report[i] == trial.truth[i])
            assert shown == f"{np.mean(right):.3f}"
    looks = sum(
        step.decision.action == 0 for t in trials if t.agent == "greedy" for step in t.steps
    )
    assert any(cell.startswith(f"{looks} (") for cell in rows["look"][1:])


def test_three_trials_of_an_agent_tell_most(trials):
    shown = ShownTrials()
    for at in range(0, len(trials), 7):
        part = tuple(trials[at : at + 7])
        places = tuple(range(at, at + len(part)))
        shown.take(Group({}, Path("a.mcap"), places, TrialOutcomes.of(part), part))
    assert [place.number for place in shown.places] == list(range(len(trials)))
    for agent in AGENTS:
        of_agent = [trial for trial in trials if trial.agent == agent]
        right = [trial for trial in of_agent if trial.success]
        telling = shown.telling([AgentPart(agent, -1, "")])
        assert len(telling) == 3
        assert len({entry.number for _, entry in telling}) == 3
        expected = {LOSS: min(trial.reward for trial in of_agent)}
        if right:
            expected |= {
                DEAREST: max(right, key=lambda trial: trial.cost).reward,
                GAIN: max(trial.reward for trial in right),
            }
        for kind, entry in telling:
            assert trials[entry.number] is entry.trial
            assert entry.trial.agent == agent
            if kind in expected:
                assert entry.trial.reward == pytest.approx(expected[kind])


def test_it_says_first_who_is_ahead_and_of_whom_that_cannot_be_said(trials, page):
    finding = html.unescape(re.search(r'<p class="finding">(.*?)</p>', page.read_text())[1])
    best = max(summarize(trials), key=lambda row: row.reward)
    for agent in set(AGENTS) - {best.agent}:
        lead = compare(trials, best.agent, agent)
        side = "is ahead of" if lead.low > 0 else "cannot be said whether"
        sentence = next(text for text in finding.split(". ") if side in text)
        assert best.agent in sentence
        assert f"{agent} (by {lead.text(signed=True)})" in sentence
    text = page.read_text()
    titles = re.findall(r"<h2>(.*?)</h2>", text)
    assert titles == [
        "Who is ahead", "Calibration", "Telling trials", "Attributes", "Behaviors",
        "All trials", "The run",
    ]  # fmt: skip


def test_it_says_who_surely_costs_more(tmp_path):
    agents = ("prior", "predefined_plus")  # the first touches nothing
    trials = [
        ask("heavy, beans", dataset="roc36", object=name, agent=agent, logs=None)
        for agent in agents
        for name in OBJECTS
    ]
    write_trials(tmp_path / "trials.mcap", trials, header={"config": {"dataset": "roc36"}})
    write_report(Logs(tmp_path), tmp_path / "report.html")
    best = max(summarize(trials), key=lambda row: row.reward).agent
    (other,) = set(agents) - {best}
    word = "less" if best == "prior" else "more"
    gap = compare(trials, *agents[::-1], measure="cost")  # of what acts, above nothing
    text = html.unescape((tmp_path / "report.html").read_text())
    assert f"{best} costs {word} than {other} (by {gap.text()} s)" in text


def test_its_head_names_the_worst_trial_of_all_agents_and_links_to_it(trials, page):
    text = html.unescape(page.read_text())
    head, rest = text.split("</header>")
    worst = min(trials, key=lambda trial: trial.reward)
    assert f"The lowest reward of a trial is {worst.reward:.1f}" in head
    (link,) = re.findall('<a href="#(.*?)">', head)
    part = re.search(f'<details id="{link}" open><summary>(.*?)</summary>', rest)[1]
    assert part.endswith(f"reward {worst.reward:.1f}")


def test_agents_of_different_tasks_cannot_be_compared_which_is_said_once(trials, tmp_path):
    for number, agent in enumerate(AGENTS):
        of_agent = [trial for trial in trials if trial.agent == agent]
        write_trials(tmp_path / f"{agent}.mcap", of_agent[number::3], header={})
    write_report(Logs(tmp_path), tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    assert "It cannot be said who is ahead" in text
    assert len(re.findall("shares? no task", text)) == 1


def test_every_trial_is_in_a_folded_list_with_agent_and_verdict(trials, page, cells):
    rows = [row for row in cells(page.read_text()) if len(row) == 10 and row[0] != "log, trial"]
    assert len(rows) == len(trials)
    rewards = [float(row[8]) for row in rows]
    assert rewards == sorted(rewards)
    for row in rows:
        agent, number = row[1], int(row[0].split(", ")[1])
        trial = [trial for trial in trials if trial.agent == agent][number]
        assert row[3] == trial.task.object_name
        assert row[2] == ("abstained" if trial.report is None else "right" if trial.success else
                          "wrong")  # fmt: skip
        assert float(row[8]) == pytest.approx(trial.reward, abs=0.051)


def test_the_page_is_dark_where_its_reader_prefers_that(page):
    text = page.read_text()
    assert "@media (prefers-color-scheme: dark)" in text
    assert not re.search(r"background[^;]*: ?#fff", text)
    assert (
        "fill: #ffffff"
        not in base64.b64decode(re.search(r"image/svg\+xml;base64,([^\"]+)", text)[1])
        .decode()
        .split("axes_1")[0]
    )


def test_a_lab_s_trials_are_listed_newest_first(trials, tmp_path, cells):
    for number, trial in enumerate(trials[:8]):
        path = tmp_path / f"2026010{number + 1}-120000-000001-thing-abcdef.mcap"
        shown = trial if number % 2 else dataclasses.replace(
            trial, truth=np.full(len(trial.truth), -1))  # fmt: skip
        write_trials(path, [shown], header={"config": {"command": "Learner.ask"}, "data": "roc36"})
    write_report(Logs(tmp_path), tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    rows = cells(text)
    (start,) = (n for n, row in enumerate(rows) if row[:1] == ["time (UTC)"])
    assert [row[0][:10] for row in rows[start + 1 : start + 9]] == [
        f"2026-01-0{n}" for n in range(8, 0, -1)
    ]
    assert [row[-1] == "unknown" for row in rows[start + 1 : start + 9]] == [False, True] * 4


def test_a_lab_s_report_says_what_was_learned_and_what_to_label_next(trials, tmp_path, cells):
    trial = next(t for t in trials if len(t.truth) == 2 and t.answer)
    for number in range(8):  # the second attribute is never right in the second half
        values = np.array([*map(int, trial.answer.values())])
        truth = values if number < 4 else np.array([values[0], 1 - values[1]])
        named = dataclasses.replace(trial.task, object_name=f"cup {number}", key=("lab", number))
        shown = dataclasses.replace(trial, task=named, truth=truth)
        path = tmp_path / f"2026010{number + 1}-120000-000001-thing-abcdef.mcap"
        write_trials(path, [shown], header={"config": {"command": "Learner.ask"}, "data": "roc36"})
    write_report(Logs(tmp_path), tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    first, second = trial.answer
    assert f"Learned: {first}." in text
    assert f"Still badly perceived: {second} (0% right)." in text
    assert "(4 so far)" in text
    assert [second, "8", "1.000", "0.000", "4", "4"] in [row[:6] for row in cells(text)]


def test_a_lab_s_trials_have_the_truth_as_it_was_told_later(trials, tmp_path):
    trial = dataclasses.replace(trials[0], truth=np.full(len(trials[0].truth), -1))
    path = tmp_path / "20260101-120000-000001-thing-abcdef.mcap"
    write_trials(path, [trial], header={"config": {"command": "Learner.ask"}, "data": "roc36"})
    labels = {name: not value for name, value in trial.answer.items()}
    write_feedback(tmp_path, Feedback(trial.task.object_name, labels, trial.task.key), header={})
    write_report(Logs(tmp_path), tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    told = ", ".join(f"not {name}" for name in labels)
    assert f"<b>{told}</b><span>truth</span>" in text
    assert "<b>wrong</b><span>verdict</span>" in text


def test_nothing_is_fetched_and_nothing_runs(page):
    text = page.read_text()
    links = re.findall(r"""<[^>]*\s(?:src|href|srcset|action|data|poster)=["']?([^"'>\s]+)""", text)
    assert "<script" not in text
    assert all(link.startswith(("data:", "#")) for link in links)
    assert len(links) > 7
    assert "default-src 'none'" in text
    assert "&lt;script&gt;alert(1)" in text
    assert not re.search(r"@import|url\((?!data:)", text)


def test_a_single_trial_is_shown_without_statistics(trials, tmp_path):
    write_trials(tmp_path / "a.mcap", trials[:1], header={})
    write_report(Logs(tmp_path / "a.mcap"), tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text()
    trial = trials[0]
    assert f"<h1>{trial.task.question}</h1>" in text
    for value, name in (
        ("heavy, beans", "answer"), ("heavy, beans", "truth"), ("right", "verdict"),
        (f"{trial.cost:.1f}", "seconds"), (f"{trial.reward:.1f}", "reward"),
    ):  # fmt: skip
        assert f"<b>{value}</b><span>{name}</span>" in text
    assert re.findall(r"<h2>(.*?)</h2>", text) == ["The trial", "The run"]
    assert text.count("<img") == 1


def test_all_of_the_best_stand_in_bold_and_no_cost_does(page, trials):
    text = page.read_text()
    bold = re.findall(r'<td class="best">(.*?)</td>', text)
    rows = summarize(trials)
    best = max(round(row.accuracy, 3) for row in rows)
    winners = sum(round(row.accuracy, 3) == best for row in rows)
    assert sum(cell.startswith(f"{best:.3f} [") for cell in bold) == winners * (winners < len(rows))
    assert not any("(" in cell for cell in bold)
    assert best_of([1.0, 2.0, 2.0, float("nan")]) == {1, 2}
    assert best_of([3.0, 3.0]) == best_of([float("nan"), 1.0]) == set()


@pytest.mark.long
def test_equal_logs_give_equal_pages(folder, page, tmp_path):
    write_report(Logs(folder), tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == page.read_bytes()


@pytest.mark.long
def test_batches_make_a_learning_curve(trials, tmp_path):
    for number in range(3):
        for part in ("train", "test"):
            header = {"batch": number, "part": part}
            write_trials(tmp_path / f"batch_{number}_{part}.mcap", trials[:8], header=header)
    write_report(Logs(tmp_path), tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    assert "hours of exploration before it" in text


def test_a_warning_names_an_unfinished_log(trials, tmp_path):
    with TrialWriter(tmp_path / "a.mcap", {}) as log:
        log.write(trials[0])
        write_report(Logs(tmp_path), tmp_path / "r.html")
    assert "was not finished by its writer" in (tmp_path / "r.html").read_text()
    with pytest.raises(LogError):
        write_report(Logs(tmp_path / "none"), tmp_path / "r.html")


BARS = """[...document.querySelectorAll("td.bar")].map(cell => {
  const bar = cell.querySelector("i"), text = cell.querySelector(".value");
  const track = cell.querySelector(".track");
  return [parseFloat(bar.style.width) / 100, bar.getBoundingClientRect().width,
          track.getBoundingClientRect().left, text.getBoundingClientRect().right];
})"""


@pytest.mark.long
def test_it_reads_well_in_a_real_browser(page, browser):
    from playwright.sync_api import sync_playwright  # noqa: PLC0415  slow

    said = []
    asked = []
    with sync_playwright() as driver:
        shown = driver.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        for width in (390, 1200):  # a phone, a desk
            tab = shown.new_page(viewport={"width": width, "height": 900})
            tab.on("console", lambda message: said.append(message.text))
            tab.on("pageerror", lambda fault: said.append(str(fault)))
            tab.on("request", lambda request: asked.append(request.url))
            tab.goto(page.as_uri())
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
            drawn = "[...document.images].filter(i => i.complete && i.naturalWidth).length"
            assert tab.evaluate(drawn) == tab.evaluate("document.images.length") >= 7
            bars = tab.evaluate(BARS)
            assert len(bars) > 20
            for fraction, length, track, value in bars:  # in pixels
                assert length == pytest.approx(fraction * 64, abs=0.5)
                assert track >= value  # beside the number, not through it
        shown.close()
    assert said == []
    assert {url for url in asked if not url.startswith("data:")} == {page.as_uri()}


@pytest.fixture(scope="module")
def unknown():
    """Four trials: of two the truth is known, of one in part, one was broken off."""
    names = ("heavy_blue_beans", "light_blue_rice", "medium_green_glass", "heavy_green_rice")
    made = [
        ask("heavy, blue", dataset="roc36", object=name, agent="greedy", logs=None)
        for name in names
    ]
    nan = dataclasses.replace(made[2].steps[-1], reward=float("nan"))
    partly = (*made[2].steps[:-1], nan)
    made[2] = dataclasses.replace(made[2], truth=np.array([0, -1]), steps=partly)
    made[3] = dataclasses.replace(
        made[3], report=None, steps=made[3].steps[:2], ended="robot error: hot"
    )
    return made


def test_words_for_what_is_unknown(unknown):
    assert truth_text(unknown[2].task.query, unknown[2].truth) == "not heavy, unknown"
    assert truth_text(unknown[0].task.query, unknown[0].truth) == "heavy, blue"
    assert unknown[2].success is unknown[3].success is None


def test_summaries_leave_the_unknown_out(unknown):
    (row,) = summarize(unknown)
    (known,) = summarize(unknown[:2])
    assert (row.trials, row.judged) == (4, 2)
    for name in ("accuracy", "accuracy_se", "reward", "answered_accuracy"):
        assert getattr(row, name) == getattr(known, name)


@pytest.mark.parametrize("chosen", [slice(None), slice(2, None)])
def test_a_report_is_made_of_the_unknown(unknown, tmp_path, chosen):
    log = tmp_path / "a.mcap"
    page = tmp_path / "a.html"
    write_trials(log, unknown[chosen], header={})
    write_report(Logs(log), page)
    text = page.read_text(encoding="utf-8")
    assert ">nan" not in text
    assert "1 truth unknown, 1 broken off" in text


def test_circles_stand_where_the_truth_is_known(unknown):
    for trial, known in ((unknown[0], 2), (unknown[2], 1)):
        axes = trial_picture(trial)
        lines = [line for band in axes.figure.axes for line in band.lines]
        ends = [line.get_ydata()[0] for line in lines if line.get_mfc() == "none"]
        assert np.isfinite(ends).sum() == known
        plt.close("all")


def test_the_viewer_says_what_is_unknown(unknown):
    for trial, words in (
        (unknown[2], "truth: not heavy, unknown"),
        (unknown[3], "robot error: hot"),
    ):
        last = list(Clock().frames(0, trial))[-1]
        assert words in narrate(last)
        assert "WRONG" not in narrate(last)
