"""Files that no accident makes: claims that ask for memory, time or trust."""

import io
import itertools
import json
import math
import os
import random
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_cases import Case, sparse, writes
from fuzz_logs import Log, logs, read_log
from fuzz_oracles import Wrong

from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.csv_folder import load_csv_folder
from meal_bayes.domain import load_domain
from meal_bayes.momdp import read_pomdp
from meal_bayes.trial_log import OutcomeWriter, read_outcomes
from meal_bayes.trial_log.compact import encode_outcomes
from meal_bayes.trial_log.encode import Packed
from meal_bayes.trial_log.outcomes import INTEGERS, REALS, TEXTS
from meal_bayes.trial_log.schema import OUTCOMES, OutcomesMessage


def make_crafted(sound: Path, count: int, seed: int) -> Iterator[Case]:
    """Yield so many cases: all that have names, then random ones."""
    rng = random.Random(f"crafted {seed}")
    log = Log(sound / "run.mcap")
    named = [*logs(log), *_tables(sound), *_texts(sound), *_places()]
    yield from itertools.islice(named, count)
    for index in range(count - len(named)):
        yield Case("log", f"random fields {index}", "a.mcap", log.garbled(rng), read_log, True)


def _tables(sound: Path) -> Iterator[Case]:
    with zipfile.ZipFile(sound / "own.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    meta = json.loads(np.load(sound / "own.npz")["meta"].tobytes())

    def case(told: str, **changed: Any) -> Case:
        def make(path: Path) -> None:
            with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
                for name, data in {**members, **_arrays(changed)}.items():
                    archive.writestr(name, data)

        return Case("table", told, "a.npz", make, load_percepts)

    for depth in (100, 50_000):
        yield case(f"meta {depth} deep", meta=("[" * depth + "]" * depth).encode())
    rows = [{"name": f"b{i}", "cost": 1.0} for i in range(900)]
    effects = [{"from": "*", "do": row["name"], "to": "*"} for row in rows]
    for count in (1, 500, 900):
        plain = json.loads(json.dumps(meta["domain_table"]))
        plain["behaviors"] += rows[:count]
        plain["diagram"]["effects"] += effects[:count]
        plain["diagram"]["states"] += [f"s{i}" for i in range(count)]
        text = json.dumps({**meta, "domain_table": plain}).encode()
        yield case(f"{count} behaviors and states more", meta=text)
    for name, value in (
        ("name", "\x1b[2J"),
        ("data", "../../../../etc/passwd"),
        ("name", "a" * 9999),
    ):
        plain = {**meta["domain_table"], name: value}
        yield case(
            f"{name} {value[:20]!r}", meta=json.dumps({**meta, "domain_table": plain}).encode()
        )
    for shape in ((4000, 4000, 1, 1, 1), (1, 1, 1, 1, 60_000_000)):
        yield case(f"bins {shape}", training_bins=np.zeros(shape, np.uint8))
    yield case("endless recordings", log_odds=np.zeros((6, 1_000_000, 2, 2), "<f2"))
    for value in (np.nan, np.inf):
        yield case(f"edges of {value}", edges=np.full(7, value))
    yield case(
        "objects with control characters",
        meta=json.dumps({**meta, "objects": [f"\x1b[{i}m" for i in range(6)]}).encode(),
    )
    yield case("objects alike", meta=json.dumps({**meta, "objects": ["a"] * 6}).encode())


def _arrays(changed: dict[str, Any]) -> dict[str, bytes]:
    made = {}
    for name, value in changed.items():
        array = np.frombuffer(value, np.uint8) if isinstance(value, bytes) else value
        buffer = io.BytesIO()
        np.lib.format.write_array(buffer, array, version=(1, 0))
        made[f"{name}.npy"] = buffer.getvalue()
    return made


def _texts(sound: Path) -> Iterator[Case]:
    toml = (sound / "own.toml").read_text(encoding="utf-8")
    for depth in (40, 5000, 60_000):
        yield _domain(f"lists {depth} deep", f"x = {'[' * depth}{']' * depth}\n")
        yield _domain(f"a dotted key {depth} deep", f"{'.'.join('a' * depth)} = 1\n{toml}")
        yield _domain(
            f"tables {depth} deep", "x = " + "{a=" * depth + "1" + "}" * depth + "\n" + toml
        )
    for text in (
        toml.replace('"red"', '"\\u001b[2J"'),
        "extends = 'a.toml'\n",
        "extends = '/dev/zero'\n",
        "extends = '../a.toml'\n",
        toml.replace('"red"', f'"{"r" * 9000}"'),
        toml.replace("cost = 1", "cost = " + "9" * 4000),
        "a = 1\n" * 30_000,
        "\n".join(f"[t{i}]" for i in range(40_000)),
        toml.replace("\n", "\r\n"),
        f"attributes = [{','.join(f'{chr(34)}a{i}{chr(34)}' for i in range(20_000))}]",
    ):
        yield _domain(f"{text[:30]!r} ...", text)
    for states, behaviors in ((990, 1), (300, 300), (1, 990)):
        yield _domain(f"{states} states, {behaviors} behaviors", _large(states, behaviors))
    header = "discount: 0.9\nvalues: reward\nstates: 2\nactions: 1\nobservations: 1\n"
    rest = "T: 0 identity\nO: 0\nuniform\n"
    for text in (
        header.replace("states: 2", "states: 999999999"),
        header + "T: 0 : 0 : 0 \N{ARABIC-INDIC DIGIT THREE}\n" + rest,
        header + rest + "R: * : * : * : * 1\n" * 100_000,
        header + "T : " * 200_000,
        ": " * 400_000,
        header.replace("states: 2", "states: 4000") + rest + "R: * : * : * : * 1\n" * 200,
        header + rest + "R: 0 : 0 : 0 : 0 1_0\n",
        header + rest + "R: 0 : 0 : 0 : 0 1e308\n" * 2,
        header.replace("states: 2", f"states: {' '.join(f's{i}' for i in range(90_000))}"),
        header.replace("0.9", "nan") + rest,
        header + rest + "start: 1e308 1e308\n",
    ):
        yield Case(
            "pomdp",
            f"pomdp {text[-30:]!r}",
            "a.pomdp",
            writes(lambda t=text: t.encode()),
            read_pomdp,
        )
    yield from _outcomes(sound)
    for cell in (
        "3_4",
        "\N{FULLWIDTH DIGIT THREE}",
        "nan",
        "1e39",
        "0x1p3",
        "1,2",
        '"1',
        "1" * 400_000,
        " 1",
        "\x1b[2J",
        "--1",
    ):
        yield _features(sound, f"cell {cell[:20]!r}", cell)


def _domain(told: str, text: str) -> Case:
    return Case("toml", told, "a.toml", writes(text.encode), load_domain)


def _large(states: int, behaviors: int) -> str:
    names = ", ".join(f'"s{i}"' for i in range(states))
    rows = "\n".join(f'[[behaviors]]\nname = "b{i}"\ncost = 1' for i in range(behaviors))
    effects = "\n".join(
        f'[[diagram.effects]]\nfrom = "*"\ndo = "b{i}"\nto = "*"' for i in range(behaviors)
    )
    head = f'name = "large"\nattributes = ["red"]\n{rows}\n[diagram]\nstart = "s0"\n'
    return f"{head}states = [{names}]\n{effects}\n"


def _outcomes(sound: Path) -> Iterator[Case]:
    """Yield compact logs with right checksums around outcomes that no trial has."""
    outcomes = read_outcomes(sound / "outcomes.mcap")
    data = encode_outcomes(outcomes, 0)
    for name, value in itertools.product((*REALS, *INTEGERS, *TEXTS), (math.nan, 1e300, -5, 0.5)):
        if name not in REALS and not isinstance(value, int):
            continue
        message = OutcomesMessage.FromString(data)
        getattr(message, name)[0] = value
        changed = Packed(OUTCOMES, 0, message.SerializeToString())

        def make(path: Path, changed: Packed = changed) -> None:
            with OutcomeWriter(path, {}) as log:
                log.put([changed])
                log.written = log.written.after(outcomes)

        yield Case("outcomes", f"outcomes, {name} {value}", "a.mcap", make, _load_outcomes)


def _load_outcomes(path: Path) -> None:
    found = read_outcomes(path)
    positive = found.positive[found.attribute != ""]
    fine = np.isfinite(found.cost).all() and not np.isinf(found.reward).any()
    if not fine or not ((positive >= 0) & (positive <= 1)).all():
        raise Wrong("outcomes that no trial has")


def _features(sound: Path, told: str, cell: str) -> Case:
    """Change one cell of a feature file, which is read with its whole folder."""

    def read(path: Path) -> None:
        folder = path.parent
        for file in sound.glob("*"):
            if file.suffix in (".csv", ".toml") and not (folder / file.name).exists():
                (folder / file.name).symlink_to(file)
        try:
            dataset = load_csv_folder(load_domain(folder / "own.toml"), folder)
        finally:
            for link in folder.iterdir():
                if link.is_symlink():
                    link.unlink()
        if cell.strip() != "1" or not np.isfinite(dataset.features["look", "color"]).all():
            raise Wrong(f"the cell {cell[:20]!r} passes")

    def make(path: Path) -> None:
        header, first, *rest = (sound / path.name).read_text().splitlines()
        cells = first.split(",")
        cells[2] = cell
        path.write_text("\n".join([header, ",".join(cells), *rest]) + "\n", encoding="utf-8")

    return Case("csv", told, "look_color.csv", make, read)


def _places() -> Iterator[Case]:
    """Endless files, pipes that nobody writes to, links to devices, folders: by every reader."""
    makers = {
        "1 TB of holes": sparse(b"name = 1\n"),
        "a pipe": os.mkfifo,
        "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
        "a folder": lambda path: path.mkdir(),
        "a link to itself": lambda path: path.symlink_to(path),
        "a link to nothing": lambda path: path.symlink_to("/nowhere/at/all"),
        "no rights": lambda path: (path.write_bytes(b""), path.chmod(0)),
    }
    files = (
        ("log", "a.mcap", read_log),
        ("table", "a.npz", load_percepts),
        ("toml", "a.toml", load_domain),
        ("pomdp", "a.pomdp", read_pomdp),
        ("outcomes", "a.mcap", read_outcomes),
    )
    for (told, make), (kind, name, read) in itertools.product(makers.items(), files):
        if told != "a folder" or kind != "log":  # a folder of logs may be empty
            yield Case(kind, f"{kind}: {told}", name, make, read)
