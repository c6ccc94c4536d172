"""What a command writes, reports and problems: never over what it reads, tried before the work."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from meal_bayes.cli import console
from meal_bayes.domain import load_domain
from meal_bayes.learner import ask
from meal_bayes.trial_log import write_trials

OWN = ("--dataset", "kitchen.npz")


@pytest.fixture
def log(run, table):
    """A log of one trial."""
    run("ask", "Is it red?", *OWN, "--object", "red_mug", "--agent", "greedy")
    (path,) = Path("logs").glob("*.mcap")
    return path


def test_a_report_does_not_replace_its_logs(log, fails):
    before = log.read_bytes()
    assert "is also an input" in fails("report", log, "-o", log)
    for words, name in ((("report", "-o"), "p.html"), (("view", "--save"), "p.rrd")):
        Path(name).write_bytes(before)
        assert "is a trial log" in fails(words[0], log, words[1], name)
    log.write_bytes(before[:300])  # torn, so that its name alone tells
    assert "is also an input" in fails("report", "logs", "-o", log)
    assert log.read_bytes() == before[:300]


def test_an_export_does_not_replace_its_table(table, fails):
    before = Path("kitchen.npz").read_bytes()
    words = ("--query", "red", "--format", "pomdp", *OWN)
    assert "is also an input" in fails("export", "kitchen.npz", *words)
    assert Path("kitchen.npz").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "work"),
    [
        (("report", "{log}", "-o", "file/a.html"), "meal_bayes.evaluation.logged.telling_merits"),
        (("export", "file/a.pomdp", "--query", "red", *OWN), "meal_bayes.datasets.load_percepts"),
        (("posterior", "--out", "file/p", *OWN), "meal_bayes.posterior.draws.draw_grid"),
        (("data", "percepts", "--dataset", "kitchen.toml", "--root", ".", "--out", "file/a.npz"),
         "meal_bayes.perception.build_percept_table"),
        (("ask", "Is it red?", "--object", "red_mug", "--logs", "file/logs", *OWN),
         "meal_bayes.learner.Learner.resume"),
        (("run", "offline", "--trials", "2", "--agent", "random", "--logs", "file/logs", *OWN),
         "meal_bayes.experiments.offline.Learner"),
        (("view", "{log}", "--save", "file/a.rrd"), "meal_bayes.viewer.send_recording"),
        (("view", "{log}", "--screenshot", "file/a.png"), "meal_bayes.viewer.send_recording"),
    ],
    ids=lambda words: words[0] if isinstance(words, tuple) else "",
)  # fmt: skip
def test_the_place_is_tried_before_the_work(log, fails, monkeypatch, words, work):
    Path("file").touch()
    worked = []
    monkeypatch.setattr(work, lambda *arguments, **named: worked.append(arguments))
    assert "cannot be written: " in fails(*(word.format(log=log) for word in words))
    assert worked == []


def test_one_page_of_several_logs(run, fails):
    for agent in ("greedy", "predefined"):
        trial = ask("heavy", dataset="roc36", object="heavy_blue_beans", agent=agent)
        write_trials(f"{agent}.mcap", [trial], header={"seed": 0})
    told = run("report", "greedy.mcap", "predefined.mcap", "-o", "out/page.html")
    assert told.exit_code == 0
    assert told.stdout.startswith("out/page.html: 2 trials of 2 agents, ")
    text = Path("out/page.html").read_text()
    assert "greedy" in text
    assert "predefined" in text
    assert run("report", "greedy.mcap").stdout.startswith("report.html: 1 trial of 1 agent,")
    assert "no log none.mcap" in fails("report", "none.mcap")
    assert "Missing argument" in fails("report")


def test_a_torn_log_is_warned_of(run, trials):
    write_trials("a.mcap", trials, header={"seed": 0})
    data = Path("a.mcap").read_bytes()
    Path("a.mcap").write_bytes(data[: int(len(data) * 0.6)])
    told = run("report", "a.mcap")
    assert told.exit_code == 0
    assert "warning: a.mcap: " in told.stderr
    assert "Warning" in Path("report.html").read_text()


def test_a_table_of_ones_own_is_counted_over_all_objects(run, table):
    """Its percepts are always right: two recordings of four objects a truth, +1 a cell."""
    result = run("export", "own.pomdp", "--dataset", "kitchen.npz", "--query", "full,red")
    size = Path("own.pomdp").stat().st_size
    expected = f"own.pomdp: 9 states, 7 actions, 6 observations, {size:,} bytes\n"
    assert result.stdout == expected
    assert "pomdpsol --timeout 5 --output own.policy own.pomdp" in result.stderr
    rates = {line.split()[-2]: float(line.split()[-1]) for line in _lines("O: ") if "s0p00" in line}
    assert rates == pytest.approx({"na": 0, "p00": 0.81, "p01": 0.09, "p10": 0.09, "p11": 0.01})
    assert {line.split()[-1] for line in _lines("R: a")} == {"100.0", "-100.0", "0.0"}


YES_NO = ("--yes-no", "--payoffs", "10", "-20", "30", "-40")


@pytest.mark.parametrize(
    ("question", "holds"),
    [("Is it full and not red?", {"10"}), ("full or not red", {"00", "10", "11"})],
)
def test_a_question_of_yes_or_no_is_exported_with_its_payoffs(run, table, question, holds):
    run("export", "own.pomdp", "--dataset", "kitchen.npz", "--query", question, *YES_NO)
    truths = ("00", "01", "10", "11")
    earned = {}  # by action and truth, of each place of the robot
    for line in _lines("R: ano") + _lines("R: ayes"):
        _, action, _, state, *_, reward = line.split()
        if state != "term":
            for y in truths if state == "*" else [state.partition("p")[2]]:
                earned[action, y] = float(reward)
    assert earned == {("ayes", y): 10.0 if y in holds else -20.0 for y in truths} | {
        ("ano", y): -40.0 if y in holds else 30.0 for y in truths
    }
    assert {line.split()[1] for line in _lines("R: a")} == {"ano", "ayes", "abstain"}


def test_a_question_is_exported_as_it_is_asked(run, table):
    for number, words in enumerate([("--query", "red"), ("--query", "Is it red?", "--yes-no")]):
        run("export", f"{number}.pomdp", "--dataset", "kitchen.npz", *words)
    assert Path("0.pomdp").read_bytes() == Path("1.pomdp").read_bytes()


def _lines(start, name="own.pomdp"):
    return [line for line in Path(name).read_text().splitlines() if line.startswith(start)]


def test_what_cannot_be_exported_is_told(fails):
    assert "give --format" in fails("export", "own.txt", "--query", "heavy")
    assert "--query" in fails("export", "own.pomdp")
    many = ",".join(load_domain("cy101").attributes[:9])
    told = fails("export", "own.pomdp", "--dataset", "cy101", "--query", many)
    assert "9 attributes" in told
    mixed = ("--query", "heavy and blue or green", "--yes-no")
    assert 'mixes "and" with "or"' in fails("export", "own.pomdp", *mixed)
    several = ("--query", "heavy, blue", *YES_NO[1:])
    assert "ask a yes-or-no question" in fails("export", "own.pomdp", *several)
    assert not list(Path.cwd().iterdir())


@pytest.fixture
def clock(monkeypatch):
    """Times that are looked at, in turn; the first is that of the beginning."""
    times = []
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: times.pop(0)))
    return times


def test_the_time_left_is_that_of_the_run_under_way(clock, capsys):
    """Several runs advance one line: what the earlier took is no measure of the next."""
    clock += [0.0, 0.0, 900.0, 900.0, 920.0]
    with console.progress("item", "trials") as advance:
        for done in (0, 110, 10, 60):  # of the second run ten trials were there already
            advance(done, 110)
    assert capsys.readouterr().err == "item, run 2: 60 of 110 trials, 920 s, 20 s left\n"


def test_a_piece_of_the_first_unit_tells_no_time_left(clock, capsys):
    """It came after what each process does once; of few units a share of one tells."""
    clock += [0.0, 0.0, 36.0, 60.0]
    with console.progress("item", "batches") as advance:
        for done in (183, 183.02, 184):
            advance(done, 220)
    assert capsys.readouterr().err == (
        "item: 183 of 220 batches, 36 s\nitem: 184 of 220 batches, 60 s, 2160 s left\n"
    )
    clock += [0.0, 0.0, 36.0]
    with console.progress("item", "batches") as advance:
        for done in (0, 0.2):
            advance(done, 2)
    assert capsys.readouterr().err == "item: 0 of 2 batches, 36 s, 324 s left\n"


def test_units_have_the_name_of_the_run_that_counts_them(clock, capsys):
    clock += [0.0, 0.0, 20.0, 20.0, 40.0]
    with console.progress("item", "pieces") as bar:
        for noun in ("trials", "batches"):
            for done in (0, 5):
                bar(done, 10, noun)
    assert capsys.readouterr().err == (
        "item: 5 of 10 trials, 20 s, 20 s left\nitem, run 2: 5 of 10 batches, 40 s, 20 s left\n"
    )


def test_a_folder_whose_name_is_no_text_has_a_report(run, tmp_path):
    folder = os.fsdecode(b"n\xff\xfe")
    asked = ("ask", "heavy", "--object", "heavy_blue_beans", "--agent", "greedy", "--json")
    assert run(*asked, "--logs", folder).exit_code == 0
    assert run("report", folder).exit_code == 0
    assert "n\\udcff\\udcfe" in (tmp_path / "report.html").read_text(encoding="utf-8")
