"""A Dask cluster on this machine runs the same experiment, also when a worker dies."""

import json
import os
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import joblib
import numpy as np
import pytest

from meal_bayes.datasets import make_synthetic, save_percepts
from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import OfflineConfig, OnlineConfig, parallel, run_offline, run_online
from meal_bayes.experiments.parallel import in_parallel, on_cluster
from meal_bayes.perception import DEFAULT, build_percept_table

ROOT = Path(__file__).resolve().parents[2]
LOCAL = "127.0.0.1"

pytestmark = pytest.mark.usefixtures("dask")


@contextmanager
def process(folder, module, *words):
    """Run a part of the cluster in a folder of its own."""
    folder.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    with (folder / "output").open("w") as output:
        started = subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{module}", *words],
            cwd=folder, env=environment, stdout=output, stderr=output,
        )  # fmt: skip
        try:
            yield started
        finally:
            started.kill()
            started.wait()


def address_in(card):
    """Return the address in a scheduler's file, or nothing while it is not written whole."""
    try:
        return json.loads(card.read_text())["address"]
    except (OSError, json.JSONDecodeError):
        return None


@pytest.fixture
def cluster(tmp_path, eventually):
    """Start a scheduler and two workers; return its address, and the processes."""
    card = tmp_path / "scheduler.json"
    with ExitStack() as stack:
        words = ("--host", LOCAL, "--port", "0", "--no-dashboard", "--no-show")
        words = (*words, "--scheduler-file", str(card))
        scheduler = stack.enter_context(process(tmp_path / "scheduler", "dask_scheduler", *words))
        address = eventually(partial(address_in, card), "no scheduler")
        workers = [
            stack.enter_context(
                process(
                    tmp_path / f"worker{k}", "dask_worker", address, "--host", LOCAL,
                    "--no-nanny", "--no-dashboard", "--nthreads", "1", "--memory-limit", "0",
                    "--local-directory", str(tmp_path),
                )
            )
            for k in (1, 2)
        ]  # fmt: skip
        for k in (1, 2):
            log = tmp_path / f"worker{k}" / "output"
            eventually(lambda log=log: "Registered to" in log.read_text(), "no worker")
        yield address, workers, scheduler


@pytest.fixture
def config(own_data):
    return OnlineConfig(
        str(own_data), root=str(own_data.parent), batches=2, trials=6, repeats=2, seed=3,
        agents=("iterative_random_legal", "bayes_memory"),
    )  # fmt: skip


@pytest.mark.long
def test_a_dead_worker_s_units_go_to_the_other(
    cluster, config, tmp_path, monkeypatch, eventually, contents
):
    address, workers, _ = cluster
    expected = contents(run_online(config, logs=tmp_path / "here").folder)
    monkeypatch.chdir(tmp_path)
    seen = []

    def kill_one():
        """Kill a worker when both have begun and neither has ended."""
        logs = tmp_path / "there"
        eventually(lambda: len({*logs.rglob("repeat-*")}) >= 2, "nothing begun")
        os.kill(workers[0].pid, signal.SIGKILL)
        seen.append(len([*logs.rglob("02-test.mcap")]))

    killer = threading.Thread(target=kill_one)
    killer.start()
    with on_cluster(address):
        run = run_online(config, logs="there")  # workers have other folders
    killer.join()
    assert seen[0] < 4
    assert workers[0].poll() == -signal.SIGKILL
    assert workers[1].poll() is None
    assert contents(run.folder) == expected
    assert len(list(run.results())) == 2 * 2 * 3


@pytest.mark.long
def test_a_percept_table_is_the_same_by_one_process_by_two_and_by_a_cluster(cluster, tmp_path):
    address, *_ = cluster
    domain = load_domain("toy")
    dataset = make_synthetic(domain, objects=14, recordings=2, rng=np.random.default_rng(0))
    written = []
    for exact in (7, 20):
        settings = replace(DEFAULT, exact_objects=exact)
        for jobs, there in ((1, None), (2, None), (1, address)):
            each = partial(in_parallel, jobs=jobs)
            with on_cluster(there):
                table = build_percept_table(dataset, perception=settings, map_behaviors=each)
            save_percepts(table, tmp_path / "table.npz")
            written.append((tmp_path / "table.npz").read_bytes())
    assert len(set(written[:3])) == len(set(written[3:])) == 1
    assert written[0] != written[3]


@pytest.mark.long
def test_an_agent_of_one_s_own_goes_to_the_workers(cluster, tmp_path, module, contents):
    """Its module lies in a folder that the workers have never heard of."""
    address, *_ = cluster
    wanted = OfflineConfig("roc36", 1, 6, ("predefined", module(2).Looker()), seed=1)
    local = run_offline(wanted, logs=tmp_path / "here")
    with on_cluster(address):
        remote = run_offline(wanted, logs=tmp_path / "there")
    assert contents(remote.folder) == contents(local.folder)
    assert len(contents(local.folder)) == 2


@pytest.mark.long
def test_joblib_s_own_way_to_a_local_cluster(config, tmp_path, contents):
    """As a user writes it who has a client of Dask's."""
    from dask.distributed import Client, LocalCluster  # noqa: PLC0415  an extra

    expected = contents(run_online(config, logs=tmp_path / "here").folder)
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local,
        Client(local),
        joblib.parallel_config("dask"),
    ):
        run = run_online(config, logs=tmp_path / "there")
    assert contents(run.folder) == expected


@pytest.mark.long
def test_a_worker_of_other_code_is_refused(cluster, monkeypatch):
    address, *_ = cluster
    other = {**parallel.environment(), "numpy": "0.1"}
    monkeypatch.setattr(parallel, "environment", lambda: other)
    with (
        pytest.raises(SettingsError, match=r"other code: numpy [\d.]+ \(expected 0.1\)"),
        on_cluster(address),
    ):
        list(in_parallel(abs, [-1, -2]))


@pytest.mark.long
def test_a_scheduler_that_ends_is_one_line(cluster):
    address, _, scheduler = cluster
    threading.Timer(3.0, scheduler.kill).start()
    with (
        pytest.raises(SettingsError, match=f"cluster at {address} has ended"),
        on_cluster(address),
    ):
        list(in_parallel(wait_for_ever, [1, 2]))


def wait_for_ever(number):
    threading.Event().wait()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "127.0.0.1", "nonsense://127.0.0.1:1"])
def test_no_scheduler_is_said_with_the_way_out(monkeypatch, address):
    import dask  # noqa: PLC0415  an extra

    monkeypatch.setattr(parallel, "_PATIENCE", 0.3)
    with (
        pytest.raises(SettingsError, match=f"No Dask scheduler answers at {address}; start one"),
        on_cluster(address),
    ):
        pass
    assert dask.config.get("scheduler", None) is None  # or the next NetCDF file asks for a client


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    with (
        pytest.raises(SettingsError, match=r"pip install 'meal-bayes\[cluster\]'"),
        on_cluster("tcp://127.0.0.1:9"),
    ):
        pass
