"""Recordings of the arm in physics: every behavior, executed on objects drawn from a seed."""

import contextlib
import hashlib
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path

from joblib import Parallel, delayed
from numpy.typing import ArrayLike
from platformdirs import user_cache_path

from meal_bayes import Dataset, Domain, RobotError, load_dataset, load_domain, save_csv_folder
from simulated_arm.arm import DOMAIN, GRASPED, LEGAL, LIFTED, READY, SimulatedArm
from simulated_arm.objects import ObjectParameters, attributes_of, draw_object

TRAINING_SEED = 0
ORDER = ("look", "press", "grasp", "lift", "hold", "lower", "shake", "drop", "push")
ATTEMPTS = 4  # at each behavior of a recording
FAULT = "fault"

_TOWARDS = {READY: "grasp", GRASPED: "lift"}  # what comes nearer to `LIFTED`

Progress = Callable[[int, int], None]
Recording = Mapping[tuple[str, str], ArrayLike]  # (behavior, modality) -> (D,)
Happened = Counter[tuple[str, str, str]]  # (state, behavior, state after, or `FAULT`)


@dataclass(frozen=True, slots=True)
class Recorded:
    """The recordings of one object."""

    name: str
    parameters: ObjectParameters
    recordings: tuple[Recording, ...]  # without the behaviors that never succeeded
    happened: Happened


def record_object(
    number: int,
    *,
    recordings: int,
    seed: int,
    population: str = "training",
    alter: Callable[[ObjectParameters], ObjectParameters] | None = None,
) -> Recorded:
    """Record every behavior on an object of a population; `alter` changes what was drawn of it."""
    parameters = draw_object(seed, population, number)
    happened = Happened()
    if alter is not None:
        parameters = alter(parameters)
    rows = list[Recording]()
    for row in range(recordings):
        path = (population, number, "recording", row)  # names the random streams of the arm
        rows.append(_record(SimulatedArm(parameters, seed, *path), happened))
    return Recorded(f"object_{number:03d}", parameters, tuple(rows), happened)


def _record(arm: SimulatedArm, happened: Happened) -> Recording:
    """Execute every behavior; what fails is tried again."""
    recording: dict[tuple[str, str], ArrayLike] = {}
    state = arm.start()
    for behavior in ORDER:
        for _ in range(ATTEMPTS):
            state, features = _attempt(arm, state, behavior, happened)
            if features is not None:
                for modality, row in features.items():
                    recording[behavior, modality] = row
                break
    return recording


def _attempt(
    arm: SimulatedArm, state: str, behavior: str, happened: Happened
) -> tuple[str, Mapping[str, ArrayLike] | None]:
    """Execute a behavior once it is legal; return the state, and the features of a success."""
    while True:
        legal = state in LEGAL[behavior]
        step = behavior
        if not legal:  # go towards a state where it is
            step = "reinit" if READY in LEGAL[behavior] else _TOWARDS.get(state, "reinit")
        try:
            outcome = arm.execute(step)
        except RobotError:
            happened[state, step, FAULT] += 1
            return arm.start(), None
        happened[state, step, outcome.state] += 1
        # A slip on the way counts as a failed attempt, or objects that slip are tried for ever.
        slipped = step in _TOWARDS.values() and outcome.state not in (GRASPED, LIFTED)
        state = outcome.state
        if legal:
            return state, outcome.features
        if slipped:
            return state, None


def record_objects(
    objects: int,
    recordings: int,
    seed: int,
    *,
    jobs: int = 1,
    progress: Progress = lambda *_: None,
    population: str = "training",
    alter: Callable[[ObjectParameters], ObjectParameters] | None = None,
) -> list[Recorded]:
    """Record objects of a population, as `record_object` does, in processes."""
    work = partial(
        record_object, recordings=recordings, seed=seed, population=population, alter=alter
    )
    finished = []
    for recorded in Parallel(jobs, return_as="generator")(map(delayed(work), range(objects))):
        finished.append(recorded)
        progress(len(finished), objects)
    return finished


def to_dataset(domain: Domain, recorded: Sequence[Recorded]) -> Dataset:
    """Join the recordings of objects, labeled by what their parameters make true."""
    features: dict[tuple[str, str], dict[str, list[ArrayLike]]] = {}
    for context in domain.contexts:
        features[context] = {}
        for entry in recorded:
            rows = [row[context] for row in entry.recordings if context in row]
            if rows:
                features[context][entry.name] = rows
    labels = {entry.name: attributes_of(entry.parameters) for entry in recorded}
    return Dataset.from_frames(domain, features, labels)


def save_recordings(recorded: Sequence[Recorded], folder: Path) -> Path:
    """Write recordings and the domain's table; return the table's path."""
    save_csv_folder(to_dataset(load_domain(DOMAIN), recorded), folder)
    path = folder / DOMAIN.name
    path.write_bytes(DOMAIN.read_bytes())
    return path


def training_recordings(
    objects: int = 30,
    recordings: int = 3,
    *,
    jobs: int = 1,
    progress: Progress = lambda *_: None,
    cache: Path | None = None,
) -> Dataset:
    """Return the recordings of training objects.

    They are recorded once and kept in a cache folder, under a name with a digest of the physics.
    """
    digest = hashlib.sha256(metadata.version("mujoco").encode())
    for file in sorted(Path(__file__).parent.iterdir()):
        if file.suffix in (".py", ".xml", ".toml") and not file.name.startswith("__"):
            digest.update(file.read_bytes())
    cache = user_cache_path("meal_bayes_simulated_arm") if cache is None else cache
    folder = cache / f"{objects}x{recordings}-{digest.hexdigest()[:8]}"
    if not folder.is_dir():
        recorded = record_objects(objects, recordings, TRAINING_SEED, jobs=jobs, progress=progress)
        cache.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=cache))  # renamed when it is whole
        save_recordings(recorded, draft)
        with contextlib.suppress(OSError):  # another process may have been first
            draft.rename(folder)
        if draft.is_dir():
            shutil.rmtree(draft)
    return load_dataset(folder / DOMAIN.name, root=folder)
