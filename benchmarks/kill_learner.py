"""Kill robots' programs at random, two at a time, that share a folder of logs and one learner file.

A program does what one does in a lab: it loads the learner, goes on with trials that were broken
off, recalls what is only in the logs, and then asks, is told, and saves, over and over; where the
other program has saved since, it loads that, recalls, and saves again. It dies by a signal: half of
the programs while the robot moves, as that takes most of the time in a lab, half after so many
seconds of their own CPU time, in the middle of whatever they are doing then. Both begin again at
once, so that both find the same broken-off trials. What robots and people did stands in journals
beside, written by single system calls.

    python benchmarks/kill_learner.py --kills 500

When five pairs of programs are dead, one goes on undisturbed to where nothing is open. Then:

- lost: behaviors that no log holds, but for the last before each death, which was under way;
- doubled: behaviors, percepts or trials that a log or the experience holds more than once;
- labels lost: labels that the experience lacks though `tell` had returned, or that it holds wrong;
- unequal: files whose learner differs from one that recalls all logs;
- two drivers: objects that two living programs drove;
- errors: what is neither one of these nor an error that says what to do.
"""

import json
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from learning import TOY, DetectingRobot
from measuring import options_of, show

from meal_bayes import Learner, Outcome
from meal_bayes.errors import LogError, OutputError
from meal_bayes.learner import recall
from meal_bayes.trial_log import Logs, salvage
from meal_bayes.trial_log.file import stem_of
from meal_bayes.trials import Session, Trial

TOGETHER = 2  # programs at a time
LIVES = 5  # deaths of all of them, in one folder
SHORTEST = 0.02  # s of CPU until a program dies
LONGEST = 1.0
BEHAVIORS = 20  # or at most so many of its robot
FOUND = ("lost", "doubled", "labels lost", "unequal", "two drivers", "errors")


class Journal:
    """What one program's robot and person did: a line an event, on disk when `note` returns."""

    def __init__(self, place: Path, life: int, program: int, last: int = 0) -> None:
        self.name = f"{life}-{program}"
        self.left = last  # behaviors until the program dies; 0: it does not die of one
        folder = place / "journal"
        folder.mkdir(exist_ok=True)
        self._file = os.open(folder / self.name, os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    def note(self, event: str, what: str, **facts: object) -> None:
        """Write an event."""
        now = time.monotonic_ns()  # one clock for all programs
        line = json.dumps({"life": self.name, "at": now, "event": event, "what": what, **facts})
        os.write(self._file, f"{line}\n".encode())


class JournaledRobot(DetectingRobot):
    """Notes the behaviors that it executes of an object, whose name says what it is."""

    def __init__(self, journal: Journal, object_name: str) -> None:
        super().__init__(np.random.default_rng(), int(truth_of(object_name)["full"]))
        self.journal = journal
        self.object_name = object_name

    def execute(self, behavior: str) -> Outcome:
        """Draw a percept."""
        outcome = super().execute(behavior)
        self.journal.note("executed", self.object_name)
        self.journal.left -= 1
        if self.journal.left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return outcome


def truth_of(object_name: str) -> dict[str, bool]:
    """Return what is true of an object."""
    return {"full": object_name.endswith("full")}


def main() -> None:
    """Kill as many programs as asked, and print what was found."""
    parser = options_of(__doc__)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    moments = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as name:  # kernels are compiled, or loaded, once
        live(Path(name), Journal(Path(name), 0, 0), trials=3)
    found = Counter[str]()
    while found["killed"] < options.kills:
        with tempfile.TemporaryDirectory() as name:
            place = Path(name)
            for life in range(1, LIVES + 1):
                found["killed"] += die(place, life, moments)
            run(place, Journal(place, LIVES + 1, 0), trials=0)
            found += check(place)
        print(dict(found), file=sys.stderr)
    facts = ("killed", "trials", "behaviors", "labels", "resumed", "saved by another")
    row = {name: found[name] for name in (*facts, *FOUND)}
    show([row], row if options.json else None)
    sys.exit(any(found[name] for name in FOUND))


def die(place: Path, life: int, moments: random.Random) -> int:
    """Start programs at once, and wait until they are dead; return how many were killed."""
    children = []
    for program in range(TOGETHER):
        moving = moments.random() < 0.5
        last = moments.randint(1, BEHAVIORS) if moving else 0
        seconds = 0.0 if moving else moments.uniform(SHORTEST, LONGEST)  # 0: without end
        child = os.fork()
        if child == 0:
            signal.signal(signal.SIGPROF, signal.SIG_DFL)  # the system ends it, Python does nothing
            signal.setitimer(signal.ITIMER_PROF, seconds)
            run(place, Journal(place, life, program, last), trials=sys.maxsize)
            os._exit(0)
        children.append(child)
    ends = [os.waitpid(child, 0)[1] for child in children]
    return sum(os.WIFSIGNALED(end) for end in ends)


def run(place: Path, journal: Journal, trials: int) -> None:
    """Let a program live, and note what nobody would know how to mend."""
    try:
        live(place, journal, trials)
    except Exception:  # whatever it is, it is a finding
        journal.note("error", traceback.format_exc())


def live(place: Path, journal: Journal, trials: int) -> None:
    """Be a robot's program for so many trials of its own."""
    learner = load(place)
    learner = go_on(learner, place, journal)
    for number in range(trials):
        name = f"{journal.name}-{number}-{'full' if random.random() < 0.5 else 'empty'}"
        trial = learner.ask("Is it full?", JournaledRobot(journal, name), object_name=name)
        tell(learner, trial, journal)
        learner = save(learner, place, journal)


def load(place: Path) -> Learner:
    """Return the learner as it was saved last, or a new one."""
    if (place / "mind").exists():
        return Learner.load(place / "mind", logs=place / "logs")
    return Learner(TOY, logs=place / "logs")


def go_on(learner: Learner, place: Path, journal: Journal) -> Learner:
    """Resume what was broken off, recall what is only in the logs, tell what was not told."""
    drafts = {stem_of(draft): draft for draft in sorted((place / "logs").rglob("*.active"))}
    for name, draft in drafts.items():
        try:
            session = learner.resume(draft)
        except LogError:
            continue  # another program drives it, or has ended it; or nothing had begun
        journal.note("resumed", name)
        finish(session, journal)
    remember(learner, place)
    record = learner.experience
    untold = {key for key in record.trials if record.labels_of_trial(key).max() < 0}
    for trial in trials_in(place) if untold else ():
        if trial.task.key in untold:
            tell(learner, trial, journal)
    return save(learner, place, journal)


def finish(session: Session, journal: Journal) -> None:
    """Drive a robot to the end of a trial that was broken off."""
    robot = JournaledRobot(journal, session.task.object_name)
    while session.behavior is not None:
        session.observe(robot.execute(session.behavior))


def remember(learner: Learner, place: Path) -> None:
    """Recall the logs, if there is a whole one."""
    try:
        recall(learner, place / "logs")
    except LogError:
        if trials_in(place):
            raise


def trials_in(place: Path) -> list[Trial]:
    """Return the trials of the logs that are whole."""
    try:
        return list(Logs(place / "logs").trials())
    except LogError:  # none is
        return []


def tell(learner: Learner, trial: Trial, journal: Journal) -> None:
    """Tell what is true of a trial's object."""
    learner.tell(trial, truth_of(trial.task.object_name))
    journal.note("told", trial.task.object_name)


def save(learner: Learner, place: Path, journal: Journal) -> Learner:
    """Save a learner; where another program has saved since, save what both know."""
    while True:
        try:
            learner.save(place / "mind")
        except OutputError:
            journal.note("saved by another", "mind")
            learner = load(place)
            remember(learner, place)
        else:
            return learner


def check(place: Path) -> Counter[str]:
    """Compare what was done with what logs and learners hold; return what was found."""
    found = Counter[str]()
    events = [
        json.loads(line)
        for journal in (place / "journal").iterdir()
        for line in journal.read_text().splitlines()
    ]
    of_kind: dict[str, list] = defaultdict(list)
    for event in events:
        of_kind[event["event"]].append(event)
    for kind in ("resumed", "saved by another"):
        found[kind] = len(of_kind[kind])
    for error in of_kind["error"]:
        print(error["what"], file=sys.stderr)
    found["errors"] = len(of_kind["error"])
    found["errors"] += sum(map(holds_trial, (place / "logs").rglob("*.active")))
    executed = Counter(each["what"] for each in of_kind["executed"])
    lives = {(each["what"], each["life"]) for each in of_kind["executed"]}
    for name in executed:
        of_object = [each for each in of_kind["executed"] if each["what"] == name]
        order = [each["life"] for each in sorted(of_object, key=itemgetter("at"))]
        # Who takes over from a dead program is the next one; a living one would go on between.
        found["two drivers"] += len(list(groupby(order))) > len(set(order))
    trials = trials_in(place)
    logged = Counter[str]()
    for trial in trials:
        logged[trial.task.object_name] += len(behaviors_of(trial))
    found["trials"] = len(trials)
    found["behaviors"] = executed.total()
    found["labels"] = len({each["what"] for each in of_kind["told"]})
    found["doubled"] += len(trials) - len({trial.task.object_name for trial in trials})
    drivers = Counter(name for name, _ in lives)
    for name in executed | logged:
        found["doubled"] += max(0, logged[name] - executed[name])
        found["lost"] += max(0, executed[name] - logged[name] - drivers[name])
    recalled = Learner(TOY, logs=None)
    recall(recalled, place / "logs")
    loaded = Learner.load(place / "mind", logs=None).refit()
    found["unequal"] += not same(recalled, loaded)
    for learner in (recalled, loaded):
        found["doubled"] += len(learner.experience.executions) - logged.total()
        told = {each["what"] for each in of_kind["told"]}
        found["labels lost"] += sum(labels_wrong(learner, name) for name in told)
    return found


def holds_trial(draft: Path) -> bool:
    """Return whether a draft that was left holds a trial; a program may die before one begins."""
    try:
        return any(True for _ in salvage(draft))
    except LogError:
        return False


def behaviors_of(trial: Trial) -> list[Any]:
    """Return the steps of a trial that are behaviors."""
    return [step for step in trial.steps if step.decision.action < trial.momdp.n_behaviors]


def labels_wrong(learner: Learner, name: str) -> bool:
    """Return whether what a learner knows of an object is not what is true."""
    record = learner.experience
    known = (
        record.object_labels.values[record.objects[name]].tolist() if name in record.objects else []
    )
    return known != [int(truth_of(name)["full"])]


def same(one: Learner, other: Learner) -> bool:
    """Return whether two learners know and count the same."""
    counts = [learner.knowledge().posterior.counts for learner in (one, other)]
    records = [
        sorted(zip(*columns, strict=True))
        for columns in (
            ([*learner.experience.objects], learner.experience.object_labels.values.tolist())
            for learner in (one, other)
        )
    ]
    return np.array_equal(*counts) and records[0] == records[1]


if __name__ == "__main__":
    main()
