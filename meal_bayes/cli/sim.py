"""`meal-bayes sim`: an arm in physics records objects and answers questions about new ones."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from meal_bayes.cli.answer import trial_facts
from meal_bayes.cli.console import (
    new_table,
    note,
    output,
    patience,
    print_json,
    progress,
    showing_compilation,
)
from meal_bayes.cli.options import (
    agent_value,
    digest,
    jobs_option,
    json_option,
    logs_option,
    seed_option,
)
from meal_bayes.cli.program import Section

if TYPE_CHECKING:
    from meal_bayes.datasets import Dataset
    from meal_bayes.experiments.simulated import Happened, LiveTrial
    from meal_bayes.learner import Learner
    from meal_bayes.robots.frame import Frame
    from meal_bayes.robots.simulated_arm import OnFrame
    from meal_bayes.trials import Trial

_BLOCK = 20  # trials of one point of the curve
_STATES = ("from", "to")  # columns
_FAULT = 1  # exit code of a trial that ended with a robot error

agent_option = click.option(
    "--agent", default="bayes", show_default=True, metavar="NAME", help="Who answers."
)


@click.group(cls=Section, short_help="Ask an arm in physics (MuJoCo) about objects it touches.")
def sim() -> None:
    """Record objects with an arm in physics (MuJoCo, extra `sim`), and ask about new ones."""


@sim.command(short_help="Record objects as a data set of your own.")
@click.option("--objects", type=click.IntRange(min=2), default=30, show_default=True)
@click.option("--recordings", type=click.IntRange(min=1), default=5, show_default=True)
@click.option(
    "--out", required=True, type=click.Path(file_okay=False, path_type=Path),
    help="The folder for the CSV files and the table of the domain.",
)  # fmt: skip
@seed_option()
@jobs_option
def record(objects: int, recordings: int, out: Path, seed: int, jobs: int) -> None:
    """Record every behavior on objects drawn from the seed, as CSV files and a TOML.

    What fails is tried again; an object that slips again and again has fewer recordings.
    """
    from meal_bayes.experiments.simulated import outcomes_of, record_objects, save_recordings

    if out.is_dir() and any(out.iterdir()):
        raise click.UsageError(f"--out {out} holds files already; name a new folder.")
    with progress("recording", "objects") as advance:
        made = record_objects(objects, recordings, seed, jobs=jobs, progress=advance)
    path = save_recordings(made, out)
    click.echo(f"{out}: {objects} objects, up to {recordings} recordings of each behavior")
    _print_outcomes(outcomes_of(made))
    note(
        "make percepts of them with: meal-bayes data percepts "
        f"--dataset {path} --root {out} --out {out}/percepts.npz"
    )


@sim.command(short_help="Ask about a new object, which the arm then touches.")
@click.argument("question")
@agent_option
@click.option("--objects", type=click.IntRange(min=2), default=30, show_default=True,
              help="Training objects; recorded once, then kept.")  # fmt: skip
@click.option("--recordings", type=click.IntRange(min=1), default=3, show_default=True,
              help="Recordings of each.")  # fmt: skip
@click.option("--jobs", type=click.IntRange(min=1), default=os.cpu_count() or 1,
              show_default="one a core", help="Processes that record them.")  # fmt: skip
@click.option("--view", is_flag=True, help="See the arm beside beliefs and values, in rerun.")
@click.option(
    "--save", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE.rrd",
    help="Write what --view would show.",
)  # fmt: skip
@seed_option()
@logs_option
@json_option
def ask(question: str, view: bool, save: Path | None, as_json: bool, **options: Any) -> None:
    """Answer a question such as "Is it heavy, and does it rattle?" about an object of the seed.

    The learner knows recordings of training objects, made on the way the first time, and meets an
    object that nobody recorded: it decides, the arm executes, until it can report. The trial is
    logged step by step.
    """
    from meal_bayes.cli.narration import print_trial_table
    from meal_bayes.errors import RobotError
    from meal_bayes.experiments import simulated
    from meal_bayes.trial_log import read_trials
    from meal_bayes.viewer.window import check_recording_name

    recording = None if save is None else check_recording_name(save)
    size = options["objects"], options["recordings"]
    with progress("recording training objects", "objects") as advance:
        data = simulated.training_recordings(*size, jobs=options["jobs"], progress=advance)
    seed = options["seed"]
    learner = _fitted(options["agent"], seed, data)
    # Other settings, other logs; equal ones make equal trials.
    config = {name: options[name] for name in ("objects", "recordings", "agent", "seed")}
    settings = digest({**config, "question": question})
    log = options["logs"] / f"sim-seed{seed}-{_slug(question)}-{learner.agent.name}-{settings}.mcap"
    frames: list[Frame] = []
    watch = _watch(frames) if view or recording is not None else None
    try:
        trial = simulated.ask_new(learner, question, seed, on_frame=watch, log=log)
    except RobotError:
        (trial,) = read_trials(log)  # as far as it went
    if as_json:
        print_json({**trial_facts(trial), "seed": seed, "log": str(log)})
    else:
        print_trial_table(output(), trial)
        note(f"every decision and its reasons: meal-bayes log show {log}")
    if recording is not None:
        _write_view(trial, frames, recording)
    if view:
        _view(trial, frames)
    if trial.ended:
        note(trial.ended)
        click.get_current_context().exit(_FAULT)


@sim.command(short_help="Begin with nothing, and learn while answering.")
@click.option("--trials", type=click.IntRange(min=1), default=200, show_default=True)
@agent_option
@seed_option()
@logs_option
@json_option
def live(trials: int, agent: str, seed: int, logs: Path, as_json: bool) -> None:
    """Learn from nothing: a random attribute of each new object is asked, then all labels given.

    The agent explores for the questions to come; how often behaviors succeed is learned too.
    """
    from meal_bayes.agents import as_agent
    from meal_bayes.domain import Query
    from meal_bayes.experiments.simulated import learn_live
    from meal_bayes.learner import Learner

    chosen = as_agent(agent_value(agent))
    settings = digest({"agent": agent, "trials": trials, "seed": seed})
    folder = logs / f"sim-live-{chosen.name}-seed{seed}-{settings}"
    learner = Learner("simulated_arm", agent=chosen, seed=seed, logs=None)
    with showing_compilation():
        chosen.warm_up(learner.domain, Query(("heavy",)))
    done: list[LiveTrial] = []
    with progress("learning", "trials") as advance:
        for one in learn_live(learner, trials, seed, logs=folder):
            done.append(one)
            advance(len(done), trials)
    if as_json:
        print_json({"trials": [_live_row(one) for one in done], "log": str(folder)})
        return
    _print_curve(done)
    _print_success(learner)
    note(f"every trial: meal-bayes log show {folder}")


def _fitted(agent: str, seed: int, data: "Dataset") -> "Learner":
    from meal_bayes.learner import Learner

    learner = Learner(data.domain, agent=agent_value(agent), seed=seed, logs=None)
    with showing_compilation(), patience(f"learning from {len(data.objects)} objects ..."):
        return learner.fit(data)


def _watch(frames: "list[Frame]") -> "OnFrame":
    from meal_bayes.robots.simulated_arm.frame import frame_of

    return lambda scene: frames.append(frame_of(scene))


def _write_view(trial: "Trial", frames: "list[Frame]", path: Path) -> None:
    from meal_bayes.viewer import write_recording

    path.parent.mkdir(parents=True, exist_ok=True)
    write_recording([trial], path, {"config": {"command": "sim ask"}}, frames=frames)
    note(f"{path}: {len(frames)} frames, {path.stat().st_size:,} bytes")


def _view(trial: "Trial", frames: "list[Frame]") -> None:
    from meal_bayes.cache import temporary_folder
    from meal_bayes.viewer import Viewer

    with temporary_folder() as folder:
        recording = folder / "sim.rrd"
        _write_view(trial, frames, recording)
        with Viewer([recording]) as viewer:
            viewer.wait()


def _live_row(one: "LiveTrial") -> dict[str, object]:
    row = {"number": one.number, "agent": one.agent, "asked": one.attribute, "fault": one.fault}
    return row if one.trial is None else {**row, **trial_facts(one.trial)}


def _print_curve(done: "list[LiveTrial]") -> None:
    """Print accuracy and cost of one block of trials after another."""
    table = new_table("trials", "agent", "accuracy", "s a trial", "robot errors", left=("agent",))
    for start in range(0, len(done), _BLOCK):
        block = done[start : start + _BLOCK]
        trials = [one.trial for one in block if one.trial is not None]
        right = sum(bool(trial.success) for trial in trials)
        cost = sum(trial.cost for trial in trials) / max(len(trials), 1)
        agents = ", ".join(dict.fromkeys(one.agent for one in block))
        table.add_row(
            f"{block[0].number}-{block[-1].number}", agents,
            f"{right / max(len(trials), 1):.2f}", f"{cost:.1f}", str(len(block) - len(trials)),
        )  # fmt: skip
    output().print(table)


def _print_outcomes(happened: "Happened") -> None:
    """Print how often each behavior led from which state to which."""
    table = new_table("behavior", "from", "to", "times", "fraction", left=_STATES)
    for (state, behavior, after), count in sorted(happened.items()):
        tried = sum(n for key, n in happened.items() if key[:2] == (state, behavior))
        table.add_row(behavior, state, after, str(count), f"{count / tried:.3f}")
    output().print(table)


def _print_success(learner: "Learner") -> None:
    """Print how often each behavior succeeded: in these trials, as learned, and of 300 objects."""
    from meal_bayes.domain import learn_success

    table = new_table("behavior", "tried", "succeeded", "learned", "of 300 objects")
    domain, attempts = learner.domain, learner.experience.attempts
    learned, before = (
        {effect.behavior: f"{diagram.success(effect):.3f}" for effect in diagram.effects}
        for diagram in (learn_success(domain, attempts).diagram, domain.diagram)
    )
    for name, (failed, succeeded) in zip(domain.behavior_names, attempts.tolist(), strict=True):
        counts = str(failed + succeeded), str(succeeded)
        table.add_row(name, *counts, learned[name], before[name])
    output().print(table)


def _slug(text: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in text.lower()).split())[:50]
