"""Logs to look at, and recordings read back."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from meal_bayes.learner import ask
from meal_bayes.trial_log import read_header, read_trials, write_trials
from meal_bayes.trials import Trial
from meal_bayes.viewer import write_recording

Rows = dict[str, dict[str, list[Any]]]
ASKED = (
    ("Is it heavy, and does it hold beans?", "heavy_blue_beans", "greedy"),
    ("Is it blue?", "light_blue_rice", "predefined"),
    ("Is it heavy, green, and does it hold rice?", "medium_green_glass", "random"),
    ("Is it heavy?", "light_brown_screws", "greedy"),
)
HEADER = {"config": {"dataset": "roc36", "agents": ["greedy"]}, "seed": 3, "note": "a|b <c>"}


@pytest.fixture(scope="session")
def trials() -> list[Trial]:
    """Trials of several agents and queries."""
    return [
        ask(question, dataset="roc36", object=name, agent=agent, seed=3, logs=None)
        for question, name, agent in ASKED
    ]


@pytest.fixture(scope="session")
def log(trials: list[Trial], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same as a log."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    write_trials(path, trials, header=HEADER)
    return path


@pytest.fixture(scope="session")
def read_back() -> Callable[[Path], Rows]:
    """Read an .rrd file: by entity, columns of its rows; static ones under `static <entity>`."""

    def read(path: Path) -> Rows:
        rows: Rows = {}
        for chunk in RrdReader(str(path)).stream():
            entity = f"static {chunk.entity_path}" if chunk.is_static else chunk.entity_path
            table = chunk.to_record_batch().to_pydict()
            edges = " edges" if "GraphEdges:edges" in table else ""
            columns = rows.setdefault(entity + edges, {})
            for name, values in table.items():
                if name != "rerun.controls.RowId":
                    columns.setdefault(name, []).extend(values)
        return rows

    return read


@pytest.fixture(scope="session")
def recorded(
    log: Path, read_back: Callable[[Path], Rows], tmp_path_factory: pytest.TempPathFactory
) -> Rows:
    """The log as a recording, read back."""
    path = tmp_path_factory.mktemp("rrd") / "run.rrd"
    assert write_recording(read_trials(log), path, read_header(log)) == len(ASKED)
    return read_back(path)
