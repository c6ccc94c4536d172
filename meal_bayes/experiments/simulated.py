"""The arm in physics, from recordings to answers: through the public `Learner` alone.

`training_recordings` gives what a learner is fitted on; `ask_new` lets it meet a new object;
`learn_live` lets it learn while it answers, from nothing if it knows nothing.
"""

import hashlib
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path

from meal_bayes.datasets import Dataset, cache_folder, load_dataset, save_csv_folder
from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import RobotError
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.learner import Learner
from meal_bayes.robots.simulated_arm import (
    ObjectParameters,
    OnFrame,
    Recorded,
    SimulatedArm,
    attributes_of,
    draw_object,
    record_object,
    to_dataset,
)
from meal_bayes.seeds import stream
from meal_bayes.trials import Trial

DOMAIN = "simulated_arm"
TRAINING_SEED = 0

Progress = Callable[[int, int], None]
Happened = Counter[tuple[str, str, str]]


def record_objects(
    objects: int,
    recordings: int,
    seed: int,
    *,
    population: str = "training",
    alter: Callable[[ObjectParameters], ObjectParameters] | None = None,
    jobs: int = 1,
    progress: Progress = lambda *_: None,
) -> list[Recorded]:
    """Record objects drawn from a seed, in processes.

    Parameters
    ----------
    alter : changes objects that were drawn; see `record_object`.
    progress : called with (objects recorded, objects in all).
    """
    work = partial(
        record_object, recordings=recordings, seed=seed, population=population, alter=alter
    )
    found = []
    for recorded in in_parallel(work, range(objects), jobs=jobs):
        found.append(recorded)
        progress(len(found), objects)
    return sorted(found, key=lambda one: one.name)


def outcomes_of(recorded: Sequence[Recorded]) -> Happened:
    """Sum the outcomes of each behavior."""
    return sum((one.happened for one in recorded), Happened())


def save_recordings(recorded: Sequence[Recorded], folder: Path) -> Path:
    """Write recordings and the domain's table; return the table's path."""
    save_csv_folder(to_dataset(load_domain(DOMAIN), recorded), folder)
    table = resources.files("meal_bayes.domain") / "tables" / f"{DOMAIN}.toml"
    path = folder / f"{DOMAIN}.toml"
    path.write_text(table.read_text(encoding="utf-8"), encoding="utf-8")
    return path


def training_recordings(
    objects: int = 30,
    recordings: int = 3,
    *,
    jobs: int = 1,
    progress: Progress = lambda *_: None,
) -> Dataset:
    """Return the recordings of training objects.

    They are recorded once and kept in the cache folder, under a name with a digest of the physics.
    """
    name = f"{DOMAIN}-{objects}x{recordings}-{_physics_digest()}"
    folder = cache_folder() / name
    if not folder.is_dir():
        made = record_objects(objects, recordings, TRAINING_SEED, jobs=jobs, progress=progress)
        cache_folder().mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache_folder(), prefix=f"{name}.") as unfinished:
            save_recordings(made, Path(unfinished) / name)
            if not folder.is_dir():  # another process may have been quicker
                (Path(unfinished) / name).replace(folder)
    return load_dataset(DOMAIN, root=folder)


def _physics_digest() -> str:
    """Compute a digest of the simulator: the package's files and the version of MuJoCo."""
    from importlib.metadata import version  # noqa: PLC0415  costs as much as the rest

    digest = hashlib.sha256(version("mujoco").encode())
    files = resources.files("meal_bayes.robots.simulated_arm").iterdir()
    for file in sorted(files, key=lambda file: file.name):
        if file.name.endswith((".py", ".xml")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:8]


def ask_new(
    learner: Learner,
    question: str | Query,
    seed: int,
    number: int = 0,
    *,
    population: str = "new",
    on_frame: OnFrame | None = None,
    log: Path | None = None,
    learn: bool = False,
) -> Trial:
    """Ask a learner about an object of which nothing is recorded; by default in a test.

    Raises
    ------
    RobotError : a fault of the robot; the trial is logged as far as it went.
    """
    parameters = draw_object(seed, population, number)
    arm = SimulatedArm(parameters, seed, population, number, on_frame=on_frame)
    name = f"{population} {seed}-{number}"
    return learner.ask(
        question, arm, truth=attributes_of(parameters), object_name=name, log=log, learn=learn
    )


@dataclass(frozen=True, slots=True)
class LiveTrial:
    """One trial of a learner that learns while it works.

    Attributes
    ----------
    number : of the object, from 1.
    agent : who decided.
    attribute : what was asked.
    trial : None where the robot failed.
    fault : why it did.
    """

    number: int
    agent: str
    attribute: str
    trial: Trial | None
    fault: str = ""


def learn_live(
    learner: Learner, trials: int, seed: int, *, logs: Path | None = None
) -> Iterator[LiveTrial]:
    """Answer questions about one new object after another, and learn from each.

    It is asked one random attribute of each new object; after its answer a person says all that is
    true of it.

    Parameters
    ----------
    learner : Learner
        Of the simulated arm; it may have learned nothing.
    trials, seed : int
        How many, of which objects.
    logs : path, optional
        Folder of the logs; None logs nothing.
    """
    for number in range(1, trials + 1):
        yield _live_trial(learner, seed, number, logs)


def _live_trial(learner: Learner, seed: int, number: int, logs: Path | None) -> LiveTrial:
    """Ask, and give feedback."""
    rng = stream(seed, "simulated questions", number)
    attribute = str(rng.choice(learner.domain.attributes))
    log = None if logs is None else logs / f"{number:05d}.mcap"
    try:
        trial = ask_new(
            learner, Query((attribute,)), seed, number, population="live", log=log, learn=True
        )
    except RobotError as fault:
        return LiveTrial(number, learner.agent.name, attribute, None, str(fault))
    learner.tell(trial, attributes_of(draw_object(seed, "live", number)))
    return LiveTrial(number, learner.agent.name, attribute, trial)
