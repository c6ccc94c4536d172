"""The same command several times at once, some killed: the files of one run that is left alone."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from meal_bayes import experiments
from meal_bayes.experiments import OfflineConfig, run_offline
from meal_bayes.trial_log import read_trials

ROOT = Path(experiments.__file__).resolve().parents[2]
CONFIG = OfflineConfig("roc36", 2, 130, ("random", "predefined_plus"), seed=3)
CODE = """
import os, signal, sys
from meal_bayes.learner import Learner
from meal_bayes.experiments import OfflineConfig, run_offline

run, last = Learner.ask, int(sys.argv[2])

def run_until(self, task, **options):
    global last
    last -= 1
    if last == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return run(self, task, **options)

Learner.ask = run_until
run_offline(OfflineConfig("roc36", 2, 130, ("random", "predefined_plus"), seed=3), logs=sys.argv[1])
"""


@pytest.fixture(scope="module")
def alone(tmp_path_factory, contents):
    """What one run writes that nobody disturbs."""
    return contents(run_offline(CONFIG, logs=tmp_path_factory.mktemp("alone")).folder)


@pytest.mark.long
def test_what_is_killed_beside_another_ends_the_same(alone, tmp_path, contents):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    started = [
        subprocess.Popen([sys.executable, "-c", CODE, str(tmp_path), str(last)], env=environment)
        for last in (40, 170, 0)  # killed in the first unit, in a later one, never
    ]
    codes = [process.wait() for process in started]
    assert codes[0] == -signal.SIGKILL
    assert codes[2] == 0
    run = run_offline(CONFIG, logs=tmp_path)
    assert contents(run.folder) == alone
    assert not list(run.folder.rglob("*.active"))
    assert len([trial for path in run.paths for trial in read_trials(path)]) == 260
