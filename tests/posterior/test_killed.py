"""NUTS that is killed: its chains are processes of their own, and end with it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from meal_bayes import posterior

ROOT = Path(posterior.__file__).resolve().parents[2]
CODE = """
import numpy as np
from meal_bayes.posterior.hierarchical import Sampling, fit_hierarchical
counts = np.full((3, 1, 1, 2, 2), 2)
fit_hierarchical(counts, attributes=["heavy"], behaviors=["lift"],
                 sampling=Sampling(10**7, tune=10, chains=2, cores=2),
                 progress=lambda done, total: print(done, flush=True))
"""


def chains_of(pid):
    """Processes that a process has forked or spawned to sample."""
    found = Path(f"/proc/{pid}/task").glob("*/children")
    return {int(word) for path in found for word in path.read_text().split()}


@pytest.mark.long
def test_chains_end_with_a_killed_fit(running, eventually):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTENSOR_FLAGS": "mode=FAST_COMPILE"}
    with subprocess.Popen(
        [sys.executable, "-c", CODE], env=environment, stdout=subprocess.PIPE, text=True
    ) as fit:
        assert fit.stdout.readline().strip().isdigit()
        chains = chains_of(fit.pid)
        assert len(chains) >= 2
        fit.send_signal(signal.SIGKILL)
        fit.wait()
        eventually(lambda: not any(map(running, chains)), "chains were left running")
