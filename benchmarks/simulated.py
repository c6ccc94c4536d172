"""The arm in physics: accuracy and calibration on new objects, learning live, a population.

python benchmarks/simulated.py [--part answers|labels|content|live|population ...]
                               [--objects N] [--asked N] [--trials N] [--crowd N]
                               [--jobs N] [--seed S] [--json]
"""

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from measuring import options_of, show
from simulated_arm import ask_new, learn_live, training_recordings
from simulated_arm.objects import ObjectParameters
from simulated_arm.recordings import (
    DOMAIN,
    record_objects,
    save_recordings,
    to_dataset,
)

from meal_bayes.domain import Query, load_domain
from meal_bayes.evaluation.calibration import calibration_error, expected_calibration_error
from meal_bayes.evaluation.learning import LearningRow, learning_rows
from meal_bayes.evaluation.statistics import clustered
from meal_bayes.experiments import OnlineConfig, run_online
from meal_bayes.experiments.online import restricted
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.learner import Learner
from meal_bayes.learner.question import QuestionCounts
from meal_bayes.perception import build_percept_table
from meal_bayes.seeds import stream

AGENTS = ("bayes", "morc")
CURVES = ("iterative_random_legal", "morc_itrs", "bayes")
RECORDINGS = 2  # of each object of the population
# Of its learning curves.
BATCHES = 5
TRIALS = 40
REPEATS = 2
TWINS = 30  # full boxes, and as many empty ones
LAST = 50  # trials that are compared with a fit
ORDER = ("look", "press", "push", "grasp", "lift", "hold", "shake", "lower", "drop")


class Answer(NamedTuple):
    """One answered question about a new object."""

    number: int
    attribute: str
    success: bool
    cost: float  # simulated s
    reward: float
    positive: float  # final belief
    truth: bool
    cpu: float  # s


def answers_about(
    numbers: Sequence[int], *, agent: str, seed: int, asked: int, random_labels: bool = False
) -> list[Answer]:
    """Ask about some attributes of each new object, each in a trial of its own.

    With `random_labels` each label of the training objects, and each truth, is a fair coin's, and
    no attributes exclude each other.
    """
    data = training_recordings()
    if random_labels:
        labels = stream(seed, "random labels").integers(0, 2, data.labels.shape)
        free = replace(data.domain, groups={})
        data = replace(data, domain=free, labels=labels.astype(np.int8))
    learner = Learner(data.domain, agent=agent, seed=seed, logs=None).fit(data)
    answers = []
    for number in numbers:
        rng = stream(seed, "asked attributes", number)
        for attribute in rng.permutation(learner.domain.attributes)[:asked].tolist():
            learner._questions = QuestionCounts()  # every agent meets the same streams
            start = time.process_time()
            trial = ask_new(learner, Query((attribute,)), seed, number)
            cpu = time.process_time() - start
            truth = rng.random() < 0.5 if random_labels else bool(trial.truth[0])
            right = trial.report is not None and bool(trial.report[0]) == truth
            positive = float(trial.last_belief.positive[0])
            answer = (number, attribute, right, trial.cost, trial.reward, positive, truth, cpu)
            answers.append(Answer(*answer))
    return answers


def ask_all(objects: int, jobs: int, **how: Any) -> list[Answer]:
    """Ask about all new objects, in processes, each with a learner of its own."""
    pieces = [range(start, objects, jobs) for start in range(jobs)]
    parts = list(in_parallel(partial(answers_about, **how), pieces, jobs=jobs))
    return sorted((answer for part in parts for answer in part), key=lambda answer: answer[:2])


def summary(answers: Sequence[Answer]) -> dict[str, float]:
    """Sum up the answers of one agent."""
    right = np.array([answer.success for answer in answers], float)
    objects = np.array([answer.number for answer in answers])
    belief = np.array([answer.positive for answer in answers])
    truth = np.array([answer.truth for answer in answers])
    return {
        "trials": len(answers),
        "accuracy": float(right.mean()),
        "accuracy_se": clustered(right, objects).se,
        "cost_s": float(np.mean([answer.cost for answer in answers])),
        "reward": float(np.mean([answer.reward for answer in answers])),
        "ece": calibration_error(belief, truth),
        "ece_if_calibrated": expected_calibration_error(belief, stream(0, "ece")),
        "cpu_s": float(np.mean([answer.cpu for answer in answers])),
    }


def answers(options: argparse.Namespace) -> dict[str, Any]:
    """Compare agents on new objects, pair by pair."""
    how = {"seed": options.seed, "asked": options.asked}
    tests = {agent: ask_all(options.objects, options.jobs, agent=agent, **how) for agent in AGENTS}
    ours, theirs = (tests[agent] for agent in AGENTS)
    gains = [answer.reward - other.reward for answer, other in zip(ours, theirs, strict=True)]
    pairs = clustered(gains, [answer.number for answer in ours]).interval()
    kinds = load_domain(DOMAIN).behaviors
    return {
        "every_behavior_once_s": sum(kind.cost for kind in kinds if kind.modalities),
        **{agent: summary(rows) for agent, rows in tests.items()},
        "reward_bayes_minus_morc": pairs._asdict(),
    }


def labels(options: argparse.Namespace) -> dict[str, Any]:
    """Ask a learner whose training labels were random about objects whose truth is random."""
    rows = ask_all(
        options.objects,
        options.jobs,
        agent="bayes",
        seed=options.seed,
        asked=options.asked,
        random_labels=True,
    )
    facts = summary(rows)
    distance = abs(facts["accuracy"] - 0.5) / facts["accuracy_se"]
    return {**facts, "base_rate": 0.5, "standard_errors_from_base_rate": distance}


def empty(drawn: ObjectParameters) -> ObjectParameters:
    """Make it an empty box of .25 kg."""
    return replace(drawn, shell_mass=0.25, content="nothing", content_mass=0.0, n_balls=0)


def full(drawn: ObjectParameters) -> ObjectParameters:
    """Make it a box of .25 kg with balls of .1 kg inside."""
    many = drawn.half_width > drawn.half_depth
    kind, balls = ("many small balls", 10) if many else ("few large balls", 3)
    return replace(drawn, shell_mass=0.15, content=kind, content_mass=0.1, n_balls=balls)


def content(options: argparse.Namespace) -> dict[str, Any]:
    """Measure what tells full boxes from empty ones that are equal in mass and all else."""
    made = []
    for alter in (empty, full):
        twins = record_objects(
            TWINS, 2, options.seed, population="twins", alter=alter, jobs=options.jobs
        )
        made += [replace(twin, name=f"{alter.__name__} {twin.name}") for twin in twins]
    data = restricted(to_dataset(load_domain(DOMAIN), made), ("full",))
    table = build_percept_table(data)
    column = data.domain.attribute_index("full")
    truth = data.labels[:, column] == 1
    told = {}
    for name in ORDER:
        said = table.log_odds[:, :, data.domain.behavior_index(name), column].astype(float)
        # the yes/no threshold
        known = ~np.isnan(said)
        yes = said > 0.004
        counts = [
            [int((known & (truth[:, None] == t) & (yes == spoken)).sum()) for spoken in (0, 1)]
            for t in (0, 1)
        ]
        rates = [row[t] / max(sum(row), 1) for t, row in enumerate(counts)]
        told[name] = {"confusion": counts, "balanced_accuracy": float(np.mean(rates))}
    return {"mass_kg": 0.25, "behaviors": told}


def live(options: argparse.Namespace) -> dict[str, Any]:
    """Learn from nothing, then compare the last trials with a fit on recordings of the objects."""
    begun = time.process_time()
    learner = Learner(DOMAIN, seed=options.seed, logs=None)
    done = list(learn_live(learner, options.trials, options.seed))
    first = len(done) - LAST + 1
    last = [(number, trial) for number, trial in enumerate(done[-LAST:], first) if not trial.ended]
    cpu = time.process_time() - begun
    made = record_objects(
        options.trials - LAST, 1, options.seed, population="live", jobs=options.jobs
    )
    learner = Learner(DOMAIN, seed=options.seed, logs=None)
    learner.fit(to_dataset(load_domain(DOMAIN), made))
    offline = []
    for number, answered in last:
        trial = ask_new(learner, answered.task.query, options.seed, number, population="live")
        if not trial.ended:
            offline.append(bool(trial.success))
    ends = range(20, len(done) + 20, 20)
    blocks = [[trial for trial in done[end - 20 : end] if not trial.ended] for end in ends]
    return {
        "seed": options.seed,
        "curve": [
            {
                "trials": min(end, len(done)),
                "agent": learner.agent.name,
                "accuracy": float(np.mean([bool(trial.success) for trial in block])),
                "cost_s": float(np.mean([trial.cost for trial in block])),
            }
            for end, block in zip(ends, blocks, strict=True)
        ],
        "last_50": float(np.mean([bool(trial.success) for _, trial in last])),
        "offline_on_the_same_objects": float(np.mean(offline)),
        "robot_errors": sum(bool(trial.ended) for trial in done),
        "cpu_s_a_trial": cpu / len(done),
    }


def population(options: argparse.Namespace) -> dict[str, Any]:
    """Execute all behaviors on many objects; compare learning curves on their recordings."""
    begun = time.process_time()
    made = record_objects(
        options.crowd, RECORDINGS, options.seed, population="population", jobs=options.jobs
    )
    cpu = time.process_time() - begun  # of this process
    happened = sum((entry.happened for entry in made), Counter())
    with tempfile.TemporaryDirectory() as folder:
        path = save_recordings(made, Path(folder) / "recordings")
        config = OnlineConfig(
            str(path),
            root=str(path.parent),
            agents=CURVES,
            batches=BATCHES,
            trials=TRIALS,
            repeats=REPEATS,
            seed=options.seed,
        )
        done = run_online(config, logs=Path(folder) / "logs", jobs=options.jobs)
        rows = learning_rows(done.results())
    curves = {
        agent: [
            {
                "trials": TRIALS * batch,
                **{
                    name: mean_of(rows, agent, batch, name)
                    for name in ("hours", "accuracy", "reward", "ece")
                },
            }
            for batch in range(BATCHES + 1)
        ]
        for agent in CURVES
    }
    return {
        "objects": len(made),
        "executions": sum(happened.values()),
        "objects_with_fewer_recordings": sum(len(row.recordings) < RECORDINGS for row in made),
        "cpu_s_an_object": cpu / len(made),
        "curves": curves,
    }


def mean_of(rows: Sequence[LearningRow], agent: str, batch: int, measure: str) -> float:
    """Return the mean of a measure over repeats."""
    chosen = [getattr(row, measure) for row in rows if (row.agent, row.batch) == (agent, batch)]
    return float(np.mean(chosen))


PARTS = {
    "answers": answers,
    "labels": labels,
    "content": content,
    "live": live,
    "population": population,
}


def main() -> None:
    """Measure the parts that are asked for."""
    parser = options_of(__doc__)
    parser.add_argument("--part", action="append", choices=PARTS)
    parser.add_argument("--objects", type=int, default=100)
    parser.add_argument("--asked", type=int, default=9)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--crowd", type=int, default=300, help="objects of the population")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    show([], {part: PARTS[part](options) for part in options.part or PARTS})


if __name__ == "__main__":
    main()
