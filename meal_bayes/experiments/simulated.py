"""The arm in physics, from recordings to answers: through the public `Learner` alone.

`training_recordings` gives what a learner is fitted on; `ask_new` lets it meet a new object;
`learn_live` lets it learn while it answers, from nothing if it knows nothing.
"""

import contextlib
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from meal_bayes.datasets import Dataset, cache_folder, load_dataset, save_csv_folder
from meal_bayes.digests import digest_of
from meal_bayes.domain import Domain, Query, load_domain
from meal_bayes.errors import RobotError
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.learner import Learner
from meal_bayes.learner.sessions import open_session
from meal_bayes.robots.simulated_arm import OnFrame, SimulatedArm, attributes_of, draw_object
from meal_bayes.robots.simulated_arm.arm import GRASPED, LEGAL, LIFTED, READY
from meal_bayes.robots.simulated_arm.objects import ObjectParameters
from meal_bayes.seeds import stream
from meal_bayes.trials import Trial, run_trial

DOMAIN = "simulated_arm"
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
    rows = tuple(
        _record(SimulatedArm(parameters, seed, population, number, "recording", row), happened)
        for row in range(recordings)
    )
    return Recorded(f"object_{number:03d}", parameters, rows, happened)


def _record(arm: SimulatedArm, happened: Happened) -> Recording:
    """Execute every behavior; what fails is tried again."""
    recording: dict[tuple[str, str], ArrayLike] = {}
    state = arm.start()
    for behavior in ORDER:
        for _ in range(ATTEMPTS):
            state, features = _attempt(arm, state, behavior, happened)
            if features is not None:
                recording |= {(behavior, modality): row for modality, row in features.items()}
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
        slipped = step in _TOWARDS.values() and outcome.state not in (GRASPED, LIFTED)
        state = outcome.state
        if legal or slipped:
            return state, outcome.features if legal else None


def record_objects(
    objects: int, recordings: int, seed: int, *, jobs: int = 1,
    progress: Progress = lambda *_: None, **options: Any,
) -> list[Recorded]:  # fmt: skip
    """Record objects drawn from a seed, in processes, with options of `record_object`."""
    work = partial(record_object, recordings=recordings, seed=seed, **options)
    done = []
    for recorded in in_parallel(work, range(objects), jobs=jobs):
        done.append(recorded)
        progress(len(done), objects)
    return sorted(done, key=lambda recorded: recorded.name)


def to_dataset(domain: Domain, recorded: Sequence[Recorded]) -> Dataset:
    """Join the recordings of objects, labeled by what their parameters make true."""
    features = {
        context: {
            entry.name: rows
            for entry in recorded
            if (rows := [row[context] for row in entry.recordings if context in row])
        }
        for context in domain.contexts
    }
    labels = {entry.name: attributes_of(entry.parameters) for entry in recorded}
    return Dataset.from_frames(domain, features, labels)


def save_recordings(recorded: Sequence[Recorded], folder: Path) -> Path:
    """Write recordings and the domain's table; return the table's path."""
    save_csv_folder(to_dataset(load_domain(DOMAIN), recorded), folder)
    table = resources.files("meal_bayes.domain") / "tables" / f"{DOMAIN}.toml"
    path = folder / f"{DOMAIN}.toml"
    path.write_bytes(table.read_bytes())
    return path


def training_recordings(
    objects: int = 30, recordings: int = 3, *, jobs: int = 1, progress: Progress = lambda *_: None
) -> Dataset:
    """Return the recordings of training objects.

    They are recorded once and kept in the cache folder, under a name with a digest of the physics.
    """
    room = Path(str(resources.files("meal_bayes.robots.simulated_arm")))
    sources = sorted(file for file in room.iterdir() if file.suffix in (".py", ".xml"))
    digest = digest_of(metadata.version("mujoco"), *sources, Path(__file__))
    name = f"{DOMAIN}-{objects}x{recordings}-{digest[:8]}"
    folder = cache_folder() / name
    if not folder.is_dir():
        recorded = record_objects(objects, recordings, TRAINING_SEED, jobs=jobs, progress=progress)
        cache_folder().mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache_folder(), prefix=f"{name}.") as unfinished:
            save_recordings(recorded, Path(unfinished) / name)
            if not folder.is_dir():  # another process may have been quicker
                (Path(unfinished) / name).replace(folder)
    return load_dataset(DOMAIN, root=folder)


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

    Where the robot fails, the trial goes as far as it went, and says why it `ended`.
    """
    parameters = draw_object(seed, population, number)
    arm = SimulatedArm(parameters, seed, population, number, on_frame=on_frame)
    session = open_session(
        learner, question, f"{population} {seed}-{number}", truth=attributes_of(parameters),
        log=log, learn=learn,
    )  # fmt: skip
    with contextlib.suppress(RobotError):
        run_trial(session, arm)
    return session.trial


def learn_live(
    learner: Learner, trials: int, seed: int, *, logs: Path | None = None
) -> Iterator[Trial]:
    """Answer questions about one new object after another, and learn from each.

    It is asked one random attribute of each new object; after its answer a person says all that is
    true of it. Objects are numbered from 1.
    """
    for number in range(1, trials + 1):
        rng = stream(seed, "simulated questions", number)
        query = Query((str(rng.choice(learner.domain.attributes)),))
        log = None if logs is None else logs / f"{number:05d}.mcap"
        trial = ask_new(learner, query, seed, number, population="live", log=log, learn=True)
        if not trial.ended:
            learner.tell(trial, attributes_of(draw_object(seed, "live", number)))
        yield trial
