"""Ask the arm in physics about new objects, let it learn from nothing, or record objects with it.

python examples/simulated_arm ask "Is it heavy, and does it rattle?" --seed 7 --save arm.rrd
python examples/simulated_arm live --trials 200
python examples/simulated_arm record --objects 30 --recordings 5 --out recordings
"""

import argparse
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from meal_bayes import Learner, RobotError, Trial, write_recording
from simulated_arm.arm import DOMAIN
from simulated_arm.questions import ask_new, learn_live
from simulated_arm.recordings import record_objects, save_recordings, training_recordings
from simulated_arm.sensors import frame_of

_BLOCK = 20  # trials of one line of the curve


def main(arguments: list[str] | None = None) -> int:
    """Read the command line and do what it says; return 1 where the robot failed."""
    parser = argparse.ArgumentParser(
        prog="python examples/simulated_arm",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(required=True)
    ask = commands.add_parser("ask", help="ask about a new object, which the arm then touches")
    ask.set_defaults(run=_ask)
    ask.add_argument("question")
    ask.add_argument("--objects", type=int, default=30, help="training objects, recorded once")
    ask.add_argument("--recordings", type=int, default=3, help="of each behavior on each of them")
    ask.add_argument("--save", type=Path, help="write a recording for `rerun FILE.rrd`")
    live = commands.add_parser("live", help="begin with nothing, and learn while answering")
    live.set_defaults(run=_live)
    live.add_argument("--trials", type=int, default=200, help="one an object")
    record = commands.add_parser("record", help="record objects as CSV files with their domain")
    record.set_defaults(run=_record)
    record.add_argument("--objects", type=int, default=30)
    record.add_argument("--recordings", type=int, default=5)
    record.add_argument("--out", type=Path, required=True, help="a new folder")
    for command in (ask, live):
        command.add_argument("--agent", default="bayes", help="who answers")
        command.add_argument("--logs", type=Path, default=Path("logs"), help="folder of the logs")
    for command in (ask, record):
        command.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    for command in (ask, live, record):
        command.add_argument("--seed", type=int, default=0, help="draws the objects")
    options = parser.parse_args(arguments)
    try:
        return int(options.run(options))
    except RobotError as fault:
        print(f"robot error: {fault}", file=sys.stderr)
        return 1


def _progress(done: int, of: int) -> None:
    end = "\n" if done == of else ""
    print(f"\rrecording object {done} of {of}", end=end, file=sys.stderr, flush=True)


def _ask(options: argparse.Namespace) -> int:
    data = training_recordings(
        options.objects, options.recordings, jobs=options.jobs, progress=_progress
    )
    learner = Learner(data.domain, agent=options.agent, seed=options.seed, logs=options.logs)
    learner.fit(data)
    frames = []
    keep = (lambda physics: frames.append(frame_of(physics))) if options.save else None
    trial = ask_new(learner, options.question, options.seed, on_frame=keep)
    print(trial)
    if options.save:
        write_recording([trial], options.save, {"config": {"seed": options.seed}}, frames=frames)
        print(f"{options.save}: {len(frames)} frames; look at it with: rerun {options.save}")
    return int(bool(trial.ended))


def _live(options: argparse.Namespace) -> int:
    learner = Learner(DOMAIN, agent=options.agent, seed=options.seed, logs=options.logs)
    block = list[Trial]()
    for number, trial in enumerate(learn_live(learner, options.trials, options.seed), start=1):
        block.append(trial)
        if len(block) == _BLOCK or number == options.trials:
            whole = [each for each in block if not each.ended]
            right = sum(bool(each.success) for each in whole) / max(len(whole), 1)
            seconds = sum(each.cost for each in whole) / max(len(whole), 1)
            first = number - len(block) + 1
            print(f"trials {first}-{number}: accuracy {right:.2f}, {seconds:.1f} s a trial")
            block.clear()
    return 0


def _record(options: argparse.Namespace) -> int:
    if options.out.is_dir() and any(options.out.iterdir()):
        print(f"{options.out} holds files already; name a new folder", file=sys.stderr)
        return 2
    recorded = record_objects(
        options.objects, options.recordings, options.seed, jobs=options.jobs, progress=_progress
    )
    options.out.mkdir(parents=True, exist_ok=True)
    path = save_recordings(recorded, options.out)
    print(f"{path}: {options.objects} objects, up to {options.recordings} recordings each")
    return 0


if __name__ == "__main__":
    sys.exit(main())
