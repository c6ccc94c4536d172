"""A log cut or flipped anywhere opens in view and report with a warning, or is one clear error."""

import random

import pytest
from click.testing import CliRunner

from meal_bayes.cli import main
from meal_bayes.trial_log import write_trials

FEW, MANY = range(16), range(16, 64)  # damages, each of them another


@pytest.fixture(scope="module")
def data(trials, tmp_path_factory):
    """Bytes of a small log, whose trials are written one by one."""
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    write_trials(path, trials, header={"seed": 1})
    return path.read_bytes()


def damaged(data, number):
    rng = random.Random(f"damage {number}")
    if number % 2:
        return data[: rng.randrange(len(data))]
    changed = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


@pytest.mark.parametrize("numbers", [FEW, pytest.param(MANY, marks=pytest.mark.long)])
def test_view_and_report_open_what_can_be_opened(data, numbers, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, opened, refused = tmp_path / "a.mcap", 0, 0
    for number in numbers:
        changed = damaged(data, number)
        if changed == data:
            continue
        path.write_bytes(changed)
        commands = [["view", "a.mcap", "--save", "a.rrd"]]
        if number % 8 in (0, 1):  # a page takes longer
            commands.append(["report", "a.mcap", "-o", "a.html"])
        for command in commands:
            result = CliRunner().invoke(main, command)
            if result.exit_code == 0:
                opened += 1
                assert "warning: a.mcap: " in result.stderr, (number, result.stderr)
                assert "whole trials" in result.stderr
                assert "Traceback" not in result.output
            else:
                refused += 1
                assert result.exit_code == 2, (number, command, result.output, result.exception)
                assert result.stderr.count("\n") == 1
                assert result.stderr.startswith("error: ")
                assert "a.mcap" in result.stderr
    assert opened > len(numbers) / 2
    assert refused > 0


def test_a_whole_log_warns_of_nothing(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.mcap").write_bytes(data)
    result = CliRunner().invoke(main, ["view", "a.mcap", "--save", "a.rrd"])
    assert result.exit_code == 0
    assert "warning" not in result.stderr
