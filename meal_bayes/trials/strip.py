"""One picture of a trial: what the robot tried, what it came to believe, and why it stopped.

Three bands on one axis of seconds. Behaviors are blocks as wide as their cost. Beliefs are lines
that change where a percept comes, whose words stand there; one is Pr(yes) where that is asked. The
bars below say what going on is worth over answering now: the value of the best behavior, with all
that may follow it, less that of the best answer. Where that falls below 0 the robot stops.
"""

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from meal_bayes.arrays import Floats
from meal_bayes.canvas import drawn_in_style
from meal_bayes.display import percent
from meal_bayes.momdp import Belief
from meal_bayes.planners import RULE
from meal_bayes.trials.percept_text import SILENT, attribute_labels
from meal_bayes.trials.placing import (
    HEIGHT,
    LETTER,
    Look,
    Words,
    bottom_of,
    heights_apart,
    look_of,
    points_a_second,
    points_high,
    top_of,
)
from meal_bayes.trials.record import TrialRecord
from meal_bayes.trials.text import YES, came_to_nothing, end_word, verdict_text

_ATTRIBUTES = 6  # that are drawn
_DPI = 100
_BENDS = 0.02  # change of a belief, below which its line bends for no eye
_CAPTIONS = (
    "what it does: a block is as wide as the seconds it costs",
    "what it believes, from 0 to 100 %, and the percepts that moved it",
    "what going on is worth over answering now (reward): below 0 it stops",
)
_EXPLORING = "what going on is worth over answering now (reward): to this answer, to later ones"


class _Moment(NamedTuple):
    """One behavior: when it begins and ends (s), and what came of it."""

    name: str
    begin: float
    end: float
    failed: bool
    words: Sequence[str]  # of each attribute's percept; "" of none
    belief: Belief  # after it


class _Line(NamedTuple):
    """What is believed of an attribute, or of the answer yes."""

    name: str
    values: Floats  # (T+1,) before and after each behavior
    truth: int  # -1 where it is not known
    color: str
    text_color: str


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
        blocks, beliefs, worth = figure.subplots(
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
        for ax, caption in zip((blocks, beliefs, worth), captions, strict=True):
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
        _draw_blocks(blocks, moments, trial, look)
        _draw_beliefs(beliefs, moments, trial, look)
        _draw_worth(worth, trial, look)
        worth.xaxis.set_visible(True)
        worth.set_xlabel("seconds", color=look.soft, fontsize=look.font, labelpad=1)
    return cast("Axes", beliefs)


def _moments(trial: TrialRecord) -> Iterator[_Moment]:
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
        yield _Moment(name, begin, seconds, failed, words, step.belief)


def _draw_title(figure: Figure, trial: TrialRecord, look: Look) -> None:
    """Write the question and the answer above the bands."""
    top = 1 - 0.35 * look.font / 72 / look.height
    size = look.font * (1.05 if look.width < 6 else 1.25)
    letters = int(0.96 * look.width * 72 / (LETTER * 1.1 * size))  # of a bold line
    question = textwrap.shorten(trial.task.question, letters, placeholder=" ...")
    answer = f"answer after {trial.cost:.1f} s: {verdict_text(trial)}"
    if trial.report is None:
        answer = verdict_text(trial)
    below = top - size * HEIGHT / 72 / look.height
    figure.text(0.01, top, question, va="top", color=look.ink, size=size, weight="bold")
    lines = textwrap.wrap(answer, letters, max_lines=2 if look.width < 6 else 1, placeholder=" ...")
    figure.text(0.01, below, "\n".join(lines), va="top", color=look.ink, size=size)


def _draw_blocks(ax: Axes, moments: Sequence[_Moment], trial: TrialRecord, look: Look) -> None:
    """Draw behaviors as blocks of their cost, names in them; failed ones are hatched."""
    ax.set(ylim=(0, 1), yticks=[])
    scale = points_a_second(ax)
    height = points_high(ax)
    ground: Any = {"facecolor": look.block, "edgecolor": "none", "pad": 0.5}
    for moment in moments:
        width = moment.end - moment.begin
        ax.bar(
            moment.begin,
            1,
            width,
            align="edge",
            color=look.block,
            lw=1.2,
            edgecolor=look.soft if moment.failed else "none",
            hatch="////" if moment.failed else None,
        )
        ax.axvline(moment.end, color=look.soft, lw=0.8)
        lines = moment.name.split("_")
        across = LETTER * look.font * max(map(len, lines))  # points, of the lines
        down = HEIGHT * look.font * len(lines)
        room = width * scale
        text = "\n".join(lines)
        rotation = 0
        size = look.font
        if across > room or down > height:
            rotation = 90
            if down > room or across > height:  # in one line, as large as the band lets it be
                text = moment.name
                size = min(look.font, 0.98 * height / (LETTER * len(text)))
        if rotation == 0 or room > 0.45 * size:
            ax.text(
                moment.begin + width / 2,
                0.5,
                text,
                ha="center",
                va="center",
                color=look.ink,
                size=size,
                rotation=rotation,
                linespacing=1.0,
                bbox=ground if moment.failed else None,
            )
    end = moments[-1].end if moments else 0.0
    ax.annotate(
        end_word(trial).replace(" ", "\n"),
        (end, 0.5),
        (6, 0),
        color=look.ink,
        textcoords="offset points",
        va="center",
        ha="left",
        size=look.font,
        weight="bold",
        annotation_clip=False,
    )


def _belief_lines(trial: TrialRecord, believed: Sequence[Belief], look: Look) -> list[_Line]:
    """Return the lines of beliefs: attributes, and Pr(yes) of a question of yes or no."""
    query = trial.task.query
    beliefs = np.array([belief.positive for belief in believed])  # (T+1,N)
    truths = [*trial.truth.tolist(), *[-1] * len(query)]
    lines = [
        _Line(name, beliefs[:, place], truths[place], look.color(place), look.text_color(place))
        for place, name in enumerate(query.value_names[:_ATTRIBUTES])
    ]
    if query.event is not None:
        values = np.array([trial.momdp.reports.probability(belief) for belief in believed])
        truth = int(query.report_truth(trial.truth)[0])
        lines.append(_Line(YES, values, truth, look.ink, look.ink))
    return lines


def _draw_beliefs(ax: Axes, moments: Sequence[_Moment], trial: TrialRecord, look: Look) -> None:
    """Draw beliefs, named and numbered at both ends, and percepts where they bend.

    A circle at the right end is the truth.
    """
    times = np.array([0.0, *(moment.end for moment in moments)])
    lines = _belief_lines(trial, [trial.first_belief, *(m.belief for m in moments)], look)
    ax.set(ylim=(-0.08, 1.12), yticks=[0, 0.5, 1], yticklabels=[])
    ax.grid(axis="y", color=look.soft, alpha=0.25, lw=0.8)
    taken = Words(ax, look.font)
    rows = 2 if look.width < 6 else 1  # of a label at an end
    gap = rows * 1.15 * look.font * 1.2 / points_high(ax)
    heights = [
        heights_apart(np.array([line.values[end] for line in lines]), gap) for end in (0, -1)
    ]
    for place, line in enumerate(lines):
        color = line.color
        stroke: Any = {"drawstyle": "steps-post", "lw": 2.2, "solid_capstyle": "butt"}
        ax.plot(times, line.values, color=color, **stroke)
        ax.plot(times[1:], line.values[1:], "o", color=color, ms=4.5, clip_on=False)
        if line.truth >= 0 and moments:
            ring: Any = {"mfc": "none", "mec": color, "ms": 10, "mew": 1.4, "clip_on": False}
            ax.plot(times[-1], line.truth, "o", **ring)
        for end, side, shift in ((0, "right", -8), (-1, "left", 10)):
            text = f"{line.name} {percent(line.values[end])}"
            if look.width < 6:
                text = text.replace(" ", "\n", 1)
            ax.annotate(
                text,
                (times[end], heights[end][place]),
                (shift, 0),
                textcoords="offset points",
                ha=side,
                va="center",
                color=line.text_color,
                size=look.font,
                annotation_clip=False,
                linespacing=1.0,
                weight="bold" if end else "normal",
            )
    for number, moment in enumerate(moments):
        for place, word in enumerate(moment.words[:_ATTRIBUTES]):
            before, after = lines[place].values[number : number + 2].tolist()
            if word and abs(after - before) > _BENDS:
                at = (moment.end, after)
                width = moment.end - moment.begin
                taken.write(word, at, width, look.text_color(place), up=after > before)


def _draw_worth(ax: Axes, trial: TrialRecord, look: Look) -> None:
    """Draw what going on is worth at each decision; the first one below 0 says "stop"."""
    parts = np.array([step.decision.going_on()[:2] for step in trial.steps]).reshape(-1, 2)
    begins = np.cumsum([0.0, *(step.cost for step in trial.steps)])
    worths = parts.sum(axis=1)[~np.isnan(parts[:, 0])].tolist()
    ax.set(yticks=[])
    if not worths:
        ax.text(0, 0.45, RULE, color=look.ink, transform=ax.transAxes, size=look.font, va="center")
        return
    top = max([*worths, 1.0])
    ax.set_ylim(-0.12 * top, 1.5 * top)
    ax.axhline(0, color=look.soft, lw=1)
    last = -np.inf  # s up to which numbers stand already
    for step, begin, (this, later) in zip(trial.steps, begins, parts.tolist(), strict=False):
        if np.isnan(this):
            continue
        worth = this + later
        goes_on = step.decision.action < trial.momdp.n_behaviors
        number = f"{this:+.0f} {later:+.0f}" if step.decision.explores else f"{worth:+.0f}"
        number = number.replace("-", "\u2212")
        if goes_on:
            ax.bar(
                begin,
                worth,
                step.cost,
                align="edge",
                color=look.soft,
                alpha=0.45,
                edgecolor=look.ink,
                lw=0.6,
            )
            wide = LETTER * look.font * len(number) / points_a_second(ax)
            middle = max(begin + step.cost / 2, last + wide * 0.68, wide * 0.5)
            last = middle + wide / 2
            ax.text(
                middle,
                max(worth, 0.0) + 0.05 * top,
                number,
                color=look.ink,
                size=look.font,
                ha="center",
                va="bottom",
            )
        else:
            ax.annotate(
                f"{number}: stop",
                (begin, 0),
                (6, 0),
                textcoords="offset points",
                ha="left",
                va="bottom",
                color=look.ink,
                size=look.font,
                weight="bold",
                annotation_clip=False,
            )
