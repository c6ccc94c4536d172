"""Yes or no on the command line."""

import json


def test_the_command_line_says_yes_or_no(run, tmp_path):
    words = ("ask", "--yes-no", "heavy or rice", "--object", "heavy_blue_beans")
    logs = ("--agent", "olfc", "--logs", str(tmp_path))
    assert "yes (" in run(*words, *logs).stdout
    values = json.loads(run(*words, *logs, "--json").stdout)["trial"]
    assert values["report"] == {"heavy or rice": True}
    assert values["probability"] > 0.5


def test_rates_of_answers_that_never_were_right_are_none(run, tmp_path):
    words = ("run", "offline", "--agent", "prior", "--trials", "1", "--yes-no", "--json")
    result = json.loads(run(*words, "--logs", str(tmp_path)).stdout)
    assert None in result["rates"]["prior"].values()
