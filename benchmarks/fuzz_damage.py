"""Sound files of every kind that the package reads, and what may happen to them."""

from importlib import resources
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.percept_file import save_percepts
from meal_bayes.datasets.percepts import BIN_EDGES, PerceptTable
from meal_bayes.datasets.synthetic import make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.experiments.tasks import offline_tasks
from meal_bayes.learner import Learner
from meal_bayes.momdp import write_pomdp, write_pomdpx
from meal_bayes.trial_log import write_trials
from meal_bayes.trials import TrialOutcomes

SOUND = {  # kind -> the file that is damaged
    "log": "run.mcap",
    "table": "own.npz",
    "csv": "look_color.csv",
    "labels": "labels.csv",
    "toml": "own.toml",
    "pomdp": "own.pomdp",
    "pomdpx": "own.pomdpx",
    "outcomes": "outcomes.mcap",
}
OBJECTS, RECORDINGS, TRIALS = 6, 3, 6
_TOKENS = [
    *(sign.encode() for sign in "\"'[]{},;:\n\r\t#=*<>&-. \0\u0663\ufeff"),
    *b"nan inf -inf 1e999 3_4 0x10 term uniform identity \xff \x1b[31m".split(),
    b"9" * 400,
]  # fmt: skip


def make_sound(folder: Path) -> None:
    """Write one sound file of every kind, all of the toy domain."""
    text = (resources.files("meal_bayes") / "domain/tables/toy.toml").read_text(encoding="utf-8")
    (folder / "own.toml").write_text(text.replace('name = "toy"', 'name = "own"'), encoding="utf-8")
    domain = load_domain(folder / "own.toml")
    rng = np.random.default_rng(5)
    dataset = make_synthetic(domain, objects=OBJECTS, recordings=RECORDINGS, rng=rng)
    lines = [",".join(("object", *domain.attributes))]
    for name, values in zip(dataset.objects, dataset.labels.tolist(), strict=True):
        lines.append(",".join((name, *map(str, values))))
    (folder / "labels.csv").write_text("\n".join(lines) + "\n")
    for (behavior, modality), values in dataset.features.items():
        lines = ["object,recording," + ",".join(f"f{i}" for i in range(values.shape[2]))]
        for o, r in np.ndindex(values.shape[:2]):
            numbers = (f"{value:.5g}" for value in values[o, r].tolist())
            lines.append(f"{dataset.objects[o]},{r + 1}," + ",".join(numbers))
        (folder / f"{behavior}_{modality}.csv").write_text("\n".join(lines) + "\n")
    shape = (OBJECTS, RECORDINGS, len(domain.behaviors), len(domain.attributes))
    bins = np.zeros((OBJECTS, OBJECTS, shape[3], shape[2], len(BIN_EDGES) + 1), np.uint8)
    table = PerceptTable(
        domain, dataset.objects, dataset.labels, rng.normal(0, 2, shape), BIN_EDGES, bins, {}
    )
    save_percepts(table, folder / "own.npz")
    _make_runs(folder)


def _make_runs(folder: Path) -> None:
    """Run a few trials on recordings that ship, for what is written of runs and their problems."""
    table = load_percepts("roc36")
    learner = Learner("roc36", agent="greedy", logs=None).fit(table)
    trials = [learner.ask(task) for task in offline_tasks(table, 2, TRIALS, 0)]
    write_trials(folder / "run.mcap", trials, header={"config": {"dataset": "roc36"}, "seed": 0})
    header = {"config": {"dataset": "roc36"}}
    write_trials(folder / "outcomes.mcap", [TrialOutcomes.of(trials)], header=header)
    learner.agent = "morc"
    momdp = learner.problem(offline_tasks(table, 1, 1, 0)[0])
    write_pomdp(momdp, folder / "own.pomdp")
    write_pomdpx(momdp, folder / "own.pomdpx")


@st.composite
def damages(draw: st.DrawFn, data: bytes) -> bytes:
    """Draw a damaged copy: bits, cuts, holes, blocks twice, tokens put in."""
    begin = draw(st.integers(0, len(data) - 1))
    end = min(len(data), begin + draw(st.sampled_from((1, 2, 5, 30, 300, 3000))))
    span, rest = data[begin:end], data[end:]
    kind = draw(st.sampled_from(("bit", "cut", "hole", "twice", "without", "token", "tail")))
    if kind == "bit":
        return (
            data[:begin] + bytes([data[begin] ^ 1 << draw(st.integers(0, 7))]) + data[begin + 1 :]
        )
    if kind == "token":
        width = draw(st.sampled_from((0, 1, 3)))
        return data[:begin] + draw(st.sampled_from(_TOKENS)) + data[begin + width :]
    if kind == "tail":
        return data + draw(st.sampled_from((bytes(100), data[-50:], b"\n1,2,3\n", b"x = 1\n")))
    middle = {"cut": b"", "hole": bytes(end - begin), "twice": span + span, "without": b""}[kind]
    return data[:begin] + middle + (b"" if kind == "cut" else rest)
