"""One picture of a trial: what the robot tried, what it came to believe, and why it stopped.

Three bands on one axis of seconds. Behaviors are blocks as wide as their cost. Beliefs are lines
that change where a percept comes, whose words stand there; one is Pr(yes) where that is asked. The
bars below say what going on is worth over answering now: the value of the best behavior, with all
that may follow it, less that of the best answer. Where that falls below 0 the robot stops.
"""

import textwrap
from collections.abc import Iterator
from typing import cast

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from meal_bayes.canvas import drawn_in_style
from meal_bayes.display import AMOUNT
from meal_bayes.trials.bands import Moment, draw_advantage, draw_beliefs, draw_blocks
from meal_bayes.trials.percept_text import SILENT, attribute_labels
from meal_bayes.trials.placing import HEIGHT, LETTER, Look, bottom_of, look_of, top_of
from meal_bayes.trials.record import TrialRecord
from meal_bayes.trials.text import came_to_nothing, verdict_text

_DPI = 100
_CAPTIONS = (
    "what it does: a block is as wide as the seconds it costs",
    "what it believes, from 0 to 100 %, and the percepts that moved it",
    "what going on is worth over answering now (reward): below 0 it stops",
)
_EXPLORING = "what going on is worth over answering now (reward): to this answer, to later ones"


def trial_strip(trial: TrialRecord, *, dark: bool = False, narrow: bool = False) -> Axes:
    """Draw a trial on one axis of seconds, on a transparent ground; return the axes of beliefs.

    Parameters
    ----------
    trial : TrialRecord
        With its steps, as full logs hold them.
    dark : bool
        Whether the page has a dark ground.
    narrow : bool
        Whether it is drawn for a column of some 370 pixels, a phone's, in place of 840.

    Notes
    -----
    Going on is worth max over behaviors b of Q(b), less Q(best answer): `Decision.going_on`.
    """
    look = look_of(dark=dark, narrow=narrow)
    with drawn_in_style():
        figure = Figure(figsize=(look.width, look.height), dpi=_DPI)
        left, right = look.margins
        blocks, beliefs, advantage = figure.subplots(
            3,
            sharex=True,
            height_ratios=look.bands,
            gridspec_kw={
                "left": left,
                "right": 1 - right,
                "top": top_of(look),
                "bottom": bottom_of(look),
                "hspace": 0.4 if narrow else 0.24,
            },
        )
        moments = list(_moments(trial))
        end = max(trial.cost, 1e-9)
        captions = [*_CAPTIONS]
        if any(step.decision.explores for step in trial.steps):
            captions[-1] = _EXPLORING
        for ax, caption in zip((blocks, beliefs, advantage), captions, strict=True):
            text = textwrap.fill(caption, 42) if narrow else caption
            ax.text(
                0,
                1.02,
                text,
                transform=ax.transAxes,
                color=look.soft,
                size=look.font,
                va="bottom",
                linespacing=1.0,
            )
            ax.patch.set_alpha(0)
            ax.set_xlim(0, end)
            ax.tick_params(colors=look.soft, labelsize=look.font, length=0)
            for side in ax.spines.values():
                side.set_visible(False)
        figure.patch.set_alpha(0)
        _draw_title(figure, trial, look)
        draw_blocks(blocks, moments, trial, look)
        draw_beliefs(beliefs, moments, trial, look)
        draw_advantage(advantage, trial, look)
        advantage.xaxis.set_visible(True)
        advantage.set_xlabel("seconds", color=look.soft, fontsize=look.font, labelpad=1)
    return cast("Axes", beliefs)


def _moments(trial: TrialRecord) -> Iterator[Moment]:
    """Yield the behaviors of a trial in order."""
    momdp = trial.momdp
    seconds = 0.0
    for step in trial.steps:
        action = step.decision.action
        if action >= momdp.n_behaviors:
            continue
        begin = seconds
        seconds = seconds + step.cost
        words = [""] * len(trial.truth)
        if step.observation is not None:
            labels = attribute_labels(momdp, action, step.observation)
            words = ["" if label == SILENT else label for label in labels]
        failed = came_to_nothing(momdp, step)
        name = momdp.behavior_names[action]
        yield Moment(
            name=name,
            begin=begin,
            end=seconds,
            failed=failed,
            words=words,
            belief=step.belief,
        )


def _draw_title(figure: Figure, trial: TrialRecord, look: Look) -> None:
    """Write the question and the answer above the bands."""
    top = 1 - 0.35 * look.font / 72 / look.height
    size = look.title_font
    # Letters of a line: bold ones are a tenth wider, and the line ends before the figure does.
    letters = int(0.96 * look.width * 72 / (LETTER * 1.1 * size))
    question = textwrap.shorten(trial.task.question, letters, placeholder=" ...")
    answer = f"answer after {trial.cost:{AMOUNT}} s: {verdict_text(trial)}"
    if trial.report is None:
        answer = verdict_text(trial)
    below = top - size * HEIGHT / 72 / look.height
    figure.text(0.01, top, question, va="top", color=look.ink, size=size, weight="bold")
    lines = textwrap.wrap(answer, letters, max_lines=look.title_lines, placeholder=" ...")
    figure.text(0.01, below, "\n".join(lines), va="top", color=look.ink, size=size)
