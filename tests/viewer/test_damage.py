"""A log cut or flipped anywhere opens in view and report with a warning, or is one clear error."""

import random

from click.testing import CliRunner

from meal_bayes.cli import main
from meal_bayes.trial_log import write_trials


def damaged(data, number):
    rng = random.Random(f"damage {number}")
    if number % 2:
        return data[: rng.randrange(len(data))]
    changed = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def test_view_and_report_open_what_can_be_opened(trials, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, codes, view = tmp_path / "a.mcap", [], ["view", "a.mcap", "--save", "a.rrd"]
    write_trials(path, trials, header={"seed": 1})
    data = path.read_bytes()
    assert "warning" not in CliRunner().invoke(main, view).stderr
    for number in range(16):
        path.write_bytes(damaged(data, number))
        for words in (view, ["report", "a.mcap"])[: 1 + (number % 8 < 2)]:  # which takes longer
            result = CliRunner().invoke(main, words)
            codes.append(result.exit_code)
            if result.exit_code == 0:
                assert "warning: a.mcap: " in result.stderr, (number, result.stderr)
            else:
                assert result.exit_code == 2, (number, words, result.output, result.exception)
                assert result.stderr.count("\n") == 1
                assert result.stderr.startswith("error: ")
    assert codes.count(0) > 8
    assert 2 in codes
