"""Write docs/from_nothing_to_answers.md with its pictures.

python benchmarks/simulated_page.py [--results FILE ...]

What the page tells is measured on the way (half an hour of one core); with --results it is what
`python benchmarks/simulated.py --json > FILE` found before, each file some of its parts.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import measuring  # noqa: F401  puts the folder of examples on the path
import numpy as np
from simulated_arm import SimulatedArm, draw_object
from simulated_arm.sensors import take_picture

from meal_bayes.evaluation.plots import Series, lines
from meal_bayes.look import save

mpl.use("Agg")

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = "from_nothing_to_answers.md"
SHOWN = ("look", "grasp", "lift", "drop", "push")
TEMPLATE = Path(__file__).with_suffix(".md")


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, nargs="+", metavar="FILE")
    parser.add_argument("--out", type=Path, default=DOCS)
    options = parser.parse_args()
    texts = [file.read_text() for file in options.results] if options.results else [measure()]
    results = {part: result for text in texts for part, result in json.loads(text).items()}
    draw_frames(options.out / "simulated_arm.png")
    draw_curve(results["live"]["curve"], options.out / "simulated_live.png")
    (options.out / PAGE).write_text(page(results), encoding="utf-8")
    print(options.out / PAGE)


def measure() -> str:
    """Run the benchmark."""
    script = Path(__file__).with_name("simulated.py")
    command = [sys.executable, str(script), "--json"]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def page(results: dict[str, Any]) -> str:
    """Fill the page in."""
    told = results["content"]["behaviors"]
    answers = results["answers"]
    difference = results["answers"]["reward_bayes_minus_morc"]
    rows = [row(name, answers[name]) for name in ("bayes", "morc")]
    return TEMPLATE.read_text(encoding="utf-8").format(
        frames=", ".join(SHOWN),
        picture="simulated_arm.png",
        curve="simulated_live.png",
        chance=results["labels"]["accuracy"],
        distance=results["labels"]["standard_errors_from_base_rate"],
        content_head=" | ".join(told),
        content_rule=" | ".join("--:" for _ in told),
        content_row=" | ".join(f"{score['balanced_accuracy']:.2f}" for score in told.values()),
        trials=answers["bayes"]["trials"],
        once=answers["every_behavior_once_s"],
        agents="\n".join(rows),
        difference=difference["estimate"],
        low=difference["low"],
        high=difference["high"],
        live_trials=results["live"]["curve"][-1]["trials"],
        live_seed=results["live"]["seed"],
        population=results["population"]["objects"],
        executions=results["population"]["executions"],
        curves="\n".join(learned(*curve) for curve in results["population"]["curves"].items()),
        last=results["live"]["last_50"],
        offline=results["live"]["offline_on_the_same_objects"],
    )


def row(agent: str, summary: dict[str, float]) -> str:
    """Write an agent's row."""
    return (
        f"| {agent} | {summary['accuracy']:.3f} ± {summary['accuracy_se']:.3f} "
        f"| {summary['cost_s']:.1f} | {summary['reward']:.1f} "
        f"| {summary['ece']:.3f} ({summary['ece_if_calibrated']:.3f}) | {summary['cpu_s']:.2f} |"
    )


def learned(agent: str, curve: list[dict[str, float]]) -> str:
    """Write the row of an agent that learned from its own trials."""
    last = curve[-1]
    rewards = ", ".join(f"{point['reward']:.1f}" for point in curve)
    ends = " | ".join((f"{last['accuracy']:.3f}", f"{last['ece']:.3f}", f"{last['hours']:.2f}"))
    return f"| {agent} | {rewards} | {ends} |"


def draw_frames(path: Path) -> None:
    """Draw what the camera sees after some behaviors, at a finer resolution than the robot's."""
    arm = SimulatedArm(draw_object(2, "new", 0), 2, "picture")
    arm.start()
    pictures = []
    for behavior in SHOWN:
        arm.execute(behavior)
        pictures.append(take_picture(arm.physics, (240, 240)))
    gap = np.ones((240, 6, 3))
    joined = np.hstack([part for picture in pictures for part in (picture, gap)][:-1])
    plt.imsave(path, joined, metadata={"Software": None})


def draw_curve(curve: list[dict[str, Any]], path: Path) -> None:
    """Draw accuracy and cost of one block of trials after another."""
    ends = np.array([point["trials"] for point in curve], float)
    figure, axes = plt.subplots(1, 2, figsize=(8.4, 2.9), layout="constrained")
    for ax, key, label in zip(
        axes,
        ("accuracy", "cost_s"),
        ("fraction of right answers", "cost of a trial, simulated s"),
        strict=True,
    ):
        series = Series("20 trials", ends, np.array([point[key] for point in curve], float))
        lines([series], x_label="trials (one object each)", y_label=label, ax=ax)
        if key == "accuracy":
            ax.set_ylim(-0.02, 1.02)
        explored = sum(point["agent"] == "random_legal" for point in curve)
        if explored:
            ax.axvspan(0, ends[explored - 1], color="0.9", lw=0, label="exploring")
    first, last = curve[0], curve[-1]
    figure.suptitle(
        f"Accuracy goes from {first['accuracy']:.2f} to {last['accuracy']:.2f}, "
        f"cost from {first['cost_s']:.1f} to {last['cost_s']:.1f} s a trial",
        x=0.01,
        ha="left",
        weight="bold",
    )
    save(axes[0], path)
    plt.close(figure)


if __name__ == "__main__":
    main()
