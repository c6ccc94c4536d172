"""Sound files of every kind that the package reads, and what may happen to them."""

import random
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import numpy as np

from meal_bayes.agents import OfflineRunner, load_agent
from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.percept_file import save_percepts
from meal_bayes.datasets.percepts import BIN_EDGES, PerceptTable
from meal_bayes.datasets.synthetic import make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.experiments.tasks import offline_tasks
from meal_bayes.momdp import write_pomdp, write_pomdpx
from meal_bayes.trial_log import TrialOutcomes, write_trials

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
_TOKENS = (
    b"nan",
    b"inf",
    b"-inf",
    b"1e999",
    b"3_4",
    b"0x10",
    b"\xd9\xa3",
    b"\0",
    b"\xef\xbb\xbf",
    b"\xff",
    b'"',
    b"'",
    b"[",
    b"]",
    b"{",
    b"}",
    b",",
    b";",
    b":",
    b"\n",
    b"\r",
    b"\t",
    b"#",
    b"=",
    b"*",
    b"<",
    b">",
    b"&",
    b"-",
    b".",
    b"9" * 400,
    b"\x1b[31m",
    b" ",
    b"term",
    b"uniform",
    b"identity",
)


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
    morc = OfflineRunner(table, load_agent("greedy"), seed=0)
    trials = [morc.run(task) for task in offline_tasks(table, 2, TRIALS, 0)]
    write_trials(folder / "run.mcap", trials, header={"config": {"dataset": "roc36"}, "seed": 0})
    header = {"config": {"dataset": "roc36"}}
    write_trials(folder / "outcomes.mcap", [TrialOutcomes.of(trials)], header=header)
    paper = OfflineRunner(table, load_agent("morc"), seed=0)
    momdp, _ = paper.prepare(offline_tasks(table, 1, 1, 0)[0])
    write_pomdp(momdp, folder / "own.pomdp")
    write_pomdpx(momdp, folder / "own.pomdpx")


def damages(data: bytes, count: int, seed: str) -> Iterator[tuple[str, bytes]]:
    """Yield name and bytes of damaged copies: bits, cuts, holes, blocks twice, tokens put in."""
    rng = random.Random(seed)
    kinds = (_bits, _cut, _hole, _twice, _without, _token, _tail, _swap)
    for index in range(count):
        kind = kinds[index % len(kinds)]
        yield f"{kind.__name__[1:]} {index}", bytes(kind(bytearray(data), rng))


def _span(data: bytearray, rng: random.Random) -> tuple[int, int]:
    begin = rng.randrange(len(data))
    return begin, min(len(data), begin + rng.choice((1, 2, 5, 30, 300, 3000)))


def _bits(data: bytearray, rng: random.Random) -> bytearray:
    for _ in range(rng.randint(1, 3)):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return data


def _cut(data: bytearray, rng: random.Random) -> bytearray:
    return data[: rng.randrange(len(data))]


def _hole(data: bytearray, rng: random.Random) -> bytearray:
    begin, end = _span(data, rng)
    data[begin:end] = bytes(end - begin)
    return data


def _twice(data: bytearray, rng: random.Random) -> bytearray:
    begin, end = _span(data, rng)
    place = rng.choice((end, rng.randrange(len(data))))
    data[place:place] = data[begin:end]
    return data


def _without(data: bytearray, rng: random.Random) -> bytearray:
    begin, end = _span(data, rng)
    del data[begin:end]
    return data


def _token(data: bytearray, rng: random.Random) -> bytearray:
    place = rng.randrange(len(data))
    width = rng.choice((0, 0, 1, 3))
    data[place : place + width] = rng.choice(_TOKENS)
    return data


def _tail(data: bytearray, rng: random.Random) -> bytearray:
    more = rng.choice((bytes(100), rng.randbytes(100), data[-50:], b"\n1,2,3\n", b"x = 1\n"))
    return data + more


def _swap(data: bytearray, rng: random.Random) -> bytearray:
    lines = data.split(b"\n")
    first, second = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[first], lines[second] = lines[second], lines[first]
    return bytearray(b"\n".join(lines))
