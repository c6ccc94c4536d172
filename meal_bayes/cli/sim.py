"""`meal-bayes sim`: an arm in physics records objects and answers questions about new ones."""

import os
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypedDict, Unpack

import click

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.cli.program import ROBOT_FAULT, Section
from meal_bayes.files import command_line

if TYPE_CHECKING:
    from meal_bayes.learner import Learner
    from meal_bayes.robots.robot import Frame
    from meal_bayes.trials import Trial

_BLOCK = 20  # trials of one point of the curve

SEVERAL = click.IntRange(min=2)
SOME = click.IntRange(min=1)
agent_option = opt.option("--agent", None, "bayes", "NAME", "Who answers.")


@click.group(cls=Section, short_help="Ask an arm in physics (MuJoCo) about objects it touches.")
def sim() -> None:
    """Record objects with an arm in physics (MuJoCo, extra `sim`), and ask about new ones."""


@sim.command(short_help="Record objects as a data set of your own.")
@opt.option("--objects", SEVERAL, 30, None, "That are drawn from the seed.")
@opt.option("--recordings", SOME, 5, None, "Of each behavior on each of them.")
@opt.option(
    "--out",
    opt.FOLDER,
    None,
    "DIR",
    "For the CSV files and the table of the domain.",
    required=True,
)
@opt.shared("seed", "jobs")
def record(objects: int, recordings: int, out: Path, seed: int, jobs: int) -> None:
    """Record every behavior on objects drawn from the seed, as CSV files and a TOML.

    What fails is tried again; an object that slips again and again has fewer recordings.
    """
    from meal_bayes.simulated_arm.recordings import record_objects, save_recordings

    if out.is_dir() and any(out.iterdir()):
        raise click.UsageError(f"--out {out} holds files already; name a new folder.")
    with terminal.progress("recording", "objects") as advance:
        dataset = record_objects(objects, recordings, seed, jobs=jobs, progress=advance)
    path = save_recordings(dataset, out)
    click.echo(f"{out}: {objects} objects, up to {recordings} recordings of each behavior")
    terminal.note(
        "make percepts of them with: meal-bayes data percepts "
        f"--dataset {path} --root {out} --out {out}/percepts.npz"
    )


class _Asking(TypedDict):
    """Options of `ask`: who answers, what it was trained on, and where the trial is logged."""

    agent: str
    objects: int
    recordings: int
    jobs: int
    seed: int
    logs: Path


def _training(command: opt.Command) -> opt.Command:
    """Add the options of a learner that knows recordings of training objects."""
    for option in (
        opt.option(
            "--jobs",
            SOME,
            os.cpu_count() or 1,
            None,
            "Processes that record them.",
            show_default="one a core",
        ),
        opt.option("--recordings", SOME, 3, None, "Recordings of each."),
        opt.option("--objects", SEVERAL, 30, None, "Training objects; recorded once, then kept."),
        agent_option,
    ):
        command = option(command)
    return command


def _trained(options: "_Asking") -> "Learner":
    """Return a learner that knows recordings of training objects, made on the way."""
    from meal_bayes.learner import Learner
    from meal_bayes.simulated_arm import training_recordings

    size = (options["objects"], options["recordings"])
    with terminal.progress("recording training objects", "objects") as advance:
        data = training_recordings(*size, jobs=options["jobs"], progress=advance)
    agent = opt.agent_value(options["agent"])
    learner = Learner(data.domain, agent=agent, seed=options["seed"], logs=None)
    terminal.note(f"learning from {len(data.objects)} objects ...")
    with terminal.showing_compilation():
        learner.fit(data)
    return learner


def _exit_by_fault(ended: str) -> None:
    """Exit, where a fault of the robot ended a trial, and say which."""
    if ended:
        terminal.note(ended)
        click.get_current_context().exit(ROBOT_FAULT)


def _log_name(question: str, learner: "Learner", options: "_Asking", **more: object) -> str:
    """Return the name of a log: other settings, other logs; equal ones make equal trials."""
    names = ("objects", "recordings", "agent", "seed")
    config = dict(options)
    settings = opt.digest({**{n: config[n] for n in names}, "question": question, **more})
    words = "-".join(re.findall(r"\w+", question.lower()))[:50]
    return f"sim-seed{options['seed']}-{words}-{learner.agent.name}-{settings}"


@sim.command(short_help="Ask about a new object, which the arm then touches.")
@click.argument("question")
@_training
@click.option("--view", is_flag=True, help="See the arm beside beliefs and values, in rerun.")
@opt.option("--save", opt.FILE, None, "FILE.rrd", "Write what --view would show.")
@opt.shared("seed", "logs", "json")
def ask(
    question: str, view: bool, save: Path | None, as_json: bool, **options: Unpack[_Asking]
) -> None:
    """Answer a question such as "Is it heavy, and does it rattle?" about an object of the seed.

    The learner knows recordings of training objects, made on the way the first time, and meets an
    object that nobody recorded: it decides, the arm executes, until it can report. The trial is
    logged step by step.
    """
    from meal_bayes.cli.narration import note_reasons, print_answer, trial_json
    from meal_bayes.simulated_arm import ask_new
    from meal_bayes.simulated_arm.sensors import frame_of
    from meal_bayes.viewer import Viewer, write_recording
    from meal_bayes.viewer.window import check_recording_name

    recording = None if save is None else check_recording_name(save)
    seed = options["seed"]
    learner = _trained(options)
    log = options["logs"] / f"{_log_name(question, learner, options)}.mcap"
    # Frames are made only where somebody looks: a picture casts a ray a pixel.
    frames: list[Frame] = []
    watched = view or recording is not None
    trial = ask_new(
        learner,
        question,
        seed,
        log=log,
        on_frame=(lambda physics: frames.append(frame_of(physics))) if watched else None,
    )
    if as_json:
        terminal.print_json({**trial_json(trial), "seed": seed, "log": str(log)})
    else:
        print_answer(terminal.output(), trial)
        note_reasons(log)
    with TemporaryDirectory(prefix="meal_bayes-") as folder:
        if watched:
            path = recording or Path(folder, "sim.rrd")
            write_recording([trial], path, {"config": {"command": "sim ask"}}, frames=frames)
            terminal.note(f"{path}: {len(frames)} frames, {path.stat().st_size:,} bytes")
        if view:
            with Viewer([path]) as viewer:
                viewer.wait()
    _exit_by_fault(trial.ended)


@sim.command(short_help="Begin with nothing, and learn while answering.")
@opt.option("--trials", SOME, 200, None, "One an object.")
@agent_option
@opt.shared("seed", "logs", "json")
def live(trials: int, agent: str, seed: int, logs: Path, as_json: bool) -> None:
    """Learn from nothing: a random attribute of each new object is asked, then all labels given.

    The agent explores for the questions to come; how often behaviors succeed is learned too.
    """
    from meal_bayes.agents import as_agent
    from meal_bayes.cli.narration import trial_json
    from meal_bayes.domain import Query
    from meal_bayes.learner import Learner
    from meal_bayes.simulated_arm import learn_live

    chosen_agent = as_agent(opt.agent_value(agent))
    settings = opt.digest({"agent": agent, "trials": trials, "seed": seed})
    folder = logs / f"sim-live-{chosen_agent.name}-seed{seed}-{settings}"
    learner = Learner("simulated_arm", agent=chosen_agent, seed=seed, logs=None)
    with terminal.showing_compilation():
        chosen_agent.warm_up(learner.domain, Query(("heavy",)))
    finished: list[Trial] = []
    with terminal.progress("learning", "trials") as advance:
        for trial in learn_live(learner, trials, seed, logs=folder):
            finished.append(trial)
            advance(len(finished), trials)
    if as_json:
        rows = [
            {"number": number, "asked": trial.task.query.attributes[0], "fault": trial.ended}
            | trial_json(trial)
            for number, trial in enumerate(finished, start=1)
        ]
        terminal.print_json({"trials": rows, "log": str(folder)})
        return
    names = "trials", "agent", "accuracy", "s a trial", "robot errors"
    points = (_point(finished, start) for start in range(0, len(finished), _BLOCK))
    terminal.print_table(names, points, left_aligned=("agent",))
    terminal.note(f"every trial: {command_line('meal-bayes log show', folder)}")


def _point(done: "list[Trial]", start: int) -> list[str]:
    """Return accuracy and cost of a block of trials, a row of the curve."""
    from meal_bayes.look import AMOUNT

    block = done[start : start + _BLOCK]
    whole = [trial for trial in block if not trial.ended]
    accuracy = sum(bool(trial.success) for trial in whole) / max(len(whole), 1)
    cost = sum(trial.cost for trial in whole) / max(len(whole), 1)
    numbers = f"{start + 1}-{start + len(block)}"
    faults = len(block) - len(whole)
    return [numbers, block[0].agent, f"{accuracy:.2f}", f"{cost:{AMOUNT}}", str(faults)]
