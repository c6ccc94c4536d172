"""The three bands of a trial's picture: behaviors, beliefs, and the advantage of going on."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from meal_bayes.arrays import Floats
from meal_bayes.display import percent
from meal_bayes.momdp import Belief
from meal_bayes.planners import RULE
from meal_bayes.trials.placing import (
    HEIGHT,
    LETTER,
    Look,
    Words,
    heights_apart,
    points_a_second,
    points_high,
)
from meal_bayes.trials.record import TrialRecord
from meal_bayes.trials.text import YES, end_word

_ATTRIBUTES = 6  # that are drawn
_BENDS = 0.02  # change of a belief, below which its line bends for no eye
_CLEAR = 0.45  # of the font: least width of a block that a name on its side is written in


class Moment(NamedTuple):
    """One behavior: when it begins and ends (s), and what came of it."""

    name: str
    begin: float
    end: float
    failed: bool
    words: Sequence[str]  # of each attribute's percept; "" of none
    belief: Belief  # after it

    @property
    def width(self) -> float:
        """Its cost, s."""
        return self.end - self.begin


class FittedText(NamedTuple):
    """A text as it fits into a block: on its side or not, in points."""

    text: str
    rotation: int
    size: float


class _Line(NamedTuple):
    """What is believed of an attribute, or of the answer yes."""

    name: str
    values: Floats  # (T+1,) before and after each behavior
    truth: int  # -1 where it is not known
    color: str
    text_color: str


def draw_blocks(ax: Axes, moments: Sequence[Moment], trial: TrialRecord, look: Look) -> None:
    """Draw behaviors as blocks of their cost, names in them; failed ones are hatched."""
    ax.set(ylim=(0, 1), yticks=[])
    scale = points_a_second(ax)
    height = points_high(ax)
    for moment in moments:
        # The block, and a line where the next one begins.
        ax.bar(
            moment.begin,
            1,
            moment.width,
            align="edge",
            color=look.block,
            lw=1.2,
            edgecolor=look.soft if moment.failed else "none",
            hatch="////" if moment.failed else None,
        )
        ax.axvline(moment.end, color=look.soft, lw=0.8)
        # Its name, on a ground of its own where the block is hatched.
        name = _fit_name(moment.name, moment.width * scale, height, look.font)
        if name is not None:
            ground: Any = {"facecolor": look.block, "edgecolor": "none", "pad": 0.5}
            ax.text(
                moment.begin + moment.width / 2,
                0.5,
                name.text,
                ha="center",
                va="center",
                color=look.ink,
                size=name.size,
                rotation=name.rotation,
                linespacing=1.0,
                bbox=ground if moment.failed else None,
            )
    # How the trial ended, behind the last block.
    ax.annotate(
        end_word(trial).replace(" ", "\n"),
        (moments[-1].end if moments else 0.0, 0.5),
        (6, 0),
        color=look.ink,
        textcoords="offset points",
        va="center",
        ha="left",
        size=look.font,
        weight="bold",
        annotation_clip=False,
    )


def _fit_name(name: str, room: float, height: float, font: float) -> FittedText | None:
    """Return the name of a behavior as it fits into its block, points; None where it does not.

    It is written a word a line; on its side where that is too wide, and then in one line, as large
    as the band allows, where that is too wide as well.
    """
    lines = name.split("_")
    width = LETTER * font * max(map(len, lines))
    depth = HEIGHT * font * len(lines)
    if width <= room and depth <= height:
        return FittedText("\n".join(lines), 0, font)
    on_its_side = FittedText("\n".join(lines), 90, font)
    if depth > room or width > height:
        on_its_side = FittedText(name, 90, min(font, 0.98 * height / (LETTER * len(name))))
    return on_its_side if room > _CLEAR * on_its_side.size else None


def draw_beliefs(ax: Axes, moments: Sequence[Moment], trial: TrialRecord, look: Look) -> None:
    """Draw beliefs, named and numbered at both ends, and percepts where they bend.

    A circle at the right end is the truth.
    """
    times = np.array([0.0, *(moment.end for moment in moments)])
    lines = _belief_lines(trial, [trial.first_belief, *(m.belief for m in moments)], look)
    ax.set(ylim=(-0.08, 1.12), yticks=[0, 0.5, 1], yticklabels=[])
    ax.grid(axis="y", color=look.soft, alpha=0.25, lw=0.8)
    words = Words(ax, look.font)
    gap = look.label_rows * 1.15 * look.font * 1.2 / points_high(ax)
    label_heights = [
        heights_apart(np.array([line.values[end] for line in lines]), gap) for end in (0, -1)
    ]
    for index, line in enumerate(lines):
        color = line.color
        stroke: Any = {"drawstyle": "steps-post", "lw": 2.2, "solid_capstyle": "butt"}
        ax.plot(times, line.values, color=color, **stroke)
        ax.plot(times[1:], line.values[1:], "o", color=color, ms=4.5, clip_on=False)
        if line.truth >= 0 and moments:
            ring: Any = {"mfc": "none", "mec": color, "ms": 10, "mew": 1.4, "clip_on": False}
            ax.plot(times[-1], line.truth, "o", **ring)
        # Labels of both ends stand outside the band: left of its begin, right of its end.
        for end, side, shift in ((0, "right", -8), (-1, "left", 10)):
            text = f"{line.name} {percent(line.values[end])}"
            if look.label_rows > 1:
                text = text.replace(" ", "\n", 1)
            ax.annotate(
                text,
                (times[end], label_heights[end][index]),
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
        for index, word in enumerate(moment.words[:_ATTRIBUTES]):
            prior, posterior = lines[index].values[number : number + 2].tolist()
            # A percept that changes nothing to be seen is not worth its place.
            if word and abs(posterior - prior) > _BENDS:
                point = (moment.end, posterior)
                color = look.text_color(index)
                words.write(word, point, moment.width, color, up=posterior > prior)


def _belief_lines(trial: TrialRecord, beliefs: Sequence[Belief], look: Look) -> list[_Line]:
    """Return the lines of beliefs: attributes, and Pr(yes) of a question of yes or no."""
    query = trial.task.query
    positive = np.array([belief.positive for belief in beliefs])  # (T+1,N)
    truths = [*trial.truth.tolist(), *[-1] * len(query)]
    lines = [
        _Line(name, positive[:, index], truths[index], look.color(index), look.text_color(index))
        for index, name in enumerate(query.value_names[:_ATTRIBUTES])
    ]
    if query.event is not None:
        values = np.array([trial.momdp.reports.probability(belief) for belief in beliefs])
        truth = int(query.report_truth(trial.truth)[0])
        lines.append(_Line(YES, values, truth, look.ink, look.ink))
    return lines


def draw_advantage(ax: Axes, trial: TrialRecord, look: Look) -> None:
    """Draw what going on is worth at each decision; the first one below 0 says "stop"."""
    parts = np.array([step.decision.going_on()[:2] for step in trial.steps]).reshape(-1, 2)
    begins = np.cumsum([0.0, *(step.cost for step in trial.steps)])
    advantages = parts.sum(axis=1)[~np.isnan(parts[:, 0])].tolist()
    ax.set(yticks=[])
    if not advantages:
        ax.text(0, 0.45, RULE, color=look.ink, transform=ax.transAxes, size=look.font, va="center")
        return
    top = max([*advantages, 1.0])
    ax.set_ylim(-0.12 * top, 1.5 * top)
    ax.axhline(0, color=look.soft, lw=1)
    number_end = -np.inf  # s up to which numbers stand already
    for step, begin, (this, later) in zip(trial.steps, begins, parts.tolist(), strict=False):
        if np.isnan(this):
            continue
        advantage = this + later
        number = f"{this:+.0f} {later:+.0f}" if step.decision.explores else f"{advantage:+.0f}"
        number = number.replace("-", "\u2212")
        if step.decision.action >= trial.momdp.n_behaviors:
            _draw_stop(ax, number, begin, look)
            continue
        ax.bar(
            begin,
            advantage,
            step.cost,
            align="edge",
            color=look.soft,
            alpha=0.45,
            edgecolor=look.ink,
            lw=0.6,
        )
        point = (begin + step.cost / 2, max(advantage, 0.0) + 0.05 * top)
        number_end = _draw_number(ax, number, point, number_end, look)


def _draw_number(
    ax: Axes, number: str, point: tuple[float, float], occupied: float, look: Look
) -> float:
    """Write a number over its bar, or behind the numbers before it; return where it ends, s.

    `point` is the middle of its lower edge; up to `occupied`, s, numbers stand already.
    """
    middle, bottom = point
    width = LETTER * look.font * len(number) / points_a_second(ax)
    # Two numbers are 0.18 of a width apart; the first begins within the band.
    middle = max(middle, occupied + 0.68 * width, 0.5 * width)
    ax.text(
        middle,
        bottom,
        number,
        color=look.ink,
        size=look.font,
        ha="center",
        va="bottom",
    )
    return float(middle + width / 2)


def _draw_stop(ax: Axes, number: str, begin: float, look: Look) -> None:
    """Write the number of the decision to stop, behind the last bar."""
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
