"""The picture of a trial: what the robot did, what it believed, and why it stopped.

Bands lie below each other on one axis of seconds. The first shows the behaviors, as blocks as wide
as their cost. Then each question has a band with the belief as a line, and the percepts that moved
it. The last band shows what going on is worth over answering now: the value of the best behavior,
with all that may follow it, less that of the best answer. Where that falls below 0 the robot stops.

All sizes are computed from the texts that are shown, which are measured before anything is placed:
margins hold the labels beside a band, a band is as high as its labels, and a word stands only where
no line and no other word is.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from meal_bayes.arrays import Floats
from meal_bayes.canvas import Axes, Figure, FontProperties, TextToPath
from meal_bayes.look import AMOUNT, attribute_color, drawn_in_style, lightened, percent, readable
from meal_bayes.momdp import Belief
from meal_bayes.planners import RULE
from meal_bayes.trials.record import TrialRecord
from meal_bayes.trials.text import (
    SILENT,
    YES,
    came_to_nothing,
    end_word,
    percept_labels,
    verdict_text,
)

_ATTRIBUTES = 12  # drawn at most; the caption says that there are more
_LINE = 1.3  # height of a line of text, of the size of the font
_ROUNDED_UP = 1.06  # pixels of letters, of their width as outlines
_PAD = 4.0  # points between a text and whatever is near it
_LEVELS = (0.0, 0.5, 1.0)  # at which a band of beliefs has a thin line
_BENDS = 0.02  # a percept that changes the belief by less is not named
_SMALLEST = 0.95  # size of a behavior's name at least, of the size of the font
_HUGE = 1e12  # reward (s) that is too large for the labels of an axis
_BEHAVIORS = "what it does: a block is as wide as the seconds it costs"
_BELIEFS = "what it believes, from 0 to 100 %, and the percepts that moved it"
_ADVANTAGE = "what going on is worth over answering now (reward): below 0 it stops"
_EXPLORING = (
    "what going on is worth over answering now (reward), to this answer and to later ones: "
    "below 0 it stops"
)


class _Look(NamedTuple):
    """Sizes in points, and colors."""

    width: float
    font: float
    label: float  # widest label beside a band
    ink: str
    soft: str
    block: str
    dark: bool

    @property
    def line(self) -> float:
        """Height of a line of text."""
        return self.font * _LINE

    def color(self, index: int) -> str:
        """Return the color of an attribute's line."""
        color = attribute_color(index)
        return lightened(color) if self.dark else color

    def text_color(self, index: int) -> str:
        """Return the color in which an attribute is named."""
        return readable(self.color(index), dark=self.dark)


class _Moment(NamedTuple):
    """One behavior of the trial, from begin to end in seconds, and what came of it."""

    name: str
    begin: float
    end: float
    failed: bool
    words: Sequence[str]  # the percept of each question; "" for none
    belief: Belief  # afterwards


class _Line(NamedTuple):
    """One belief over time."""

    name: str  # "" where the question's own name says it
    values: Floats  # (T+1,) before and after each behavior
    truth: int  # 1, 0, or -1 where it is not known
    color: str
    text_color: str


class _Question(NamedTuple):
    """What one band of beliefs shows: an attribute, a group, or the answer yes."""

    name: str
    lines: Sequence[_Line]
    place: int  # among the questions of the query; -1 for the answer yes

    def labels(self, look: _Look, end: int) -> list[tuple[str, str, bool]]:
        """Return the lines of text beside the band: text, color, and whether it is bold.

        `end` is 0 for the label on the left, which names the question, and -1 for the right one.
        """
        rows = list[tuple[str, str, bool]]()
        if end == 0:
            color = self.lines[0].text_color if len(self.lines) == 1 else look.ink
            rows = [(text, color, True) for text in _wrapped(self.name, look.label, look.font)]
        for line in self.lines:
            text = f"{line.name} {percent(line.values[end])}".strip()
            bold = end == -1
            wrapped = _wrapped(text, look.label, look.font, bold=bold)
            rows += [(part, line.text_color, bold) for part in wrapped]
        return rows


class _Box(NamedTuple):
    """A rectangle in seconds and units of an axis."""

    left: float
    bottom: float
    right: float
    top: float

    def meets(self, other: "_Box") -> bool:
        """Return whether two rectangles have a point in common."""
        return (
            self.left <= other.right
            and other.left <= self.right
            and self.bottom <= other.top
            and other.bottom <= self.top
        )


class _Scale(NamedTuple):
    """Seconds and units of an axis that one point of the figure is."""

    across: float
    up: float

    def box(self, text: str, size: float, left: float, bottom: float) -> _Box:
        """Return the rectangle of a line of text whose lower left corner is given."""
        right = left + text_width(text, size) * self.across
        return _Box(left, bottom, right, bottom + size * _LINE * self.up)


def trial_picture(trial: TrialRecord, *, dark: bool = False, narrow: bool = False) -> Axes:
    """Draw a trial on one axis of seconds, on a transparent ground.

    Parameters
    ----------
    trial : TrialRecord
        A trial with its steps, as full logs hold them.
    dark : bool
        Whether the page has a dark ground.
    narrow : bool
        Whether the picture is for a column of some 370 pixels, as on a phone, instead of 840.

    Returns
    -------
    Axes
        The axes of the first question's belief; its figure holds the whole picture.

    Notes
    -----
    Going on is worth max over behaviors b of Q(b), less Q(best answer): `Decision.going_on`.
    """
    look = _look_of(dark=dark, narrow=narrow)
    moments = list(_moments(trial))
    questions = _questions(trial, [trial.first_belief, *(m.belief for m in moments)], look)
    end = trial.cost or 1.0
    with drawn_in_style():
        margins = _margins(trial, questions, look)
        room = look.width - sum(margins)
        title = _title(trial, look)
        bands = _bands(trial, questions, moments, room / end, look)
        height = _PAD + sum(size * _LINE for _, size, _ in title)
        height += sum(band.height + len(band.caption) * look.line + 2 * _PAD for band in bands)
        height += 2.4 * look.line  # the numbers and the name of the axis of seconds
        figure = Figure(figsize=(look.width / 72, height / 72), dpi=100)
        figure.patch.set_alpha(0)
        top = height - _PAD
        for text, size, weight in title:
            _write(figure, text, (_PAD, top), look.ink, size=size, weight=weight)
            top -= size * _LINE
        axes = list[Axes]()
        for band in bands:
            top -= _PAD
            for text in band.caption:
                _write(figure, text, (_PAD, top), look.soft, size=look.font)
                top -= look.line
            top -= band.height + _PAD
            place = (margins[0], top, room, band.height)
            parts = np.array(place) / [look.width, height, look.width, height]
            axes.append(_plain_axes(figure, parts, end, look))
        blocks, *beliefs, advantage = axes
        _draw_blocks(blocks, moments, room / end, bands[0].height, look)
        _draw_end(blocks, end_word(trial), look)
        for ax, band, question in zip(beliefs, bands[1:-1], questions, strict=True):
            _draw_question(ax, question, moments, band.height, room / end, look)
        _draw_advantage(advantage, trial, _Scale(end / room, 0.0), bands[-1].height, look)
        advantage.xaxis.set_visible(True)
        advantage.set_xlabel("seconds", color=look.soft, fontsize=look.font, labelpad=1)
    return beliefs[0]


def _look_of(*, dark: bool, narrow: bool) -> _Look:
    """Return the look of a picture on a dark or light ground, wide or for a phone."""
    ink, soft, block = (
        ("#E8EBEF", "#A9B2BD", "#3A4450") if dark else ("#1C2430", "#5D6876", "#E4E8ED")
    )
    width, font, label = (288.0, 9.0, 70.0) if narrow else (864.0, 12.0, 190.0)
    return _Look(width, font, label, ink, soft, block, dark)


# --- Texts and their sizes


@lru_cache(maxsize=4096)
def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Return the width of one line of text, points, as far as a screen may round it up."""
    font = FontProperties(family="sans-serif", size=size, weight="bold" if bold else "normal")
    width, _, _ = TextToPath().get_text_width_height_descent(text, font, ismath=False)
    return float(width) * _ROUNDED_UP


def _wrapped(text: str, room: float, size: float, *, bold: bool = False) -> list[str]:
    """Return a text in lines no wider than the room, points.

    It breaks at spaces, then behind other signs between words, then anywhere.
    """
    lines = [""]
    for piece in re.findall(r"\s+|[^\s_\-/]+[_\-/]*|[_\-/]+", text):
        if text_width(lines[-1] + piece.rstrip(), size, bold=bold) <= room:
            lines[-1] += piece
        elif piece.isspace():
            lines.append("")
        else:
            if lines[-1]:
                lines.append("")
            for letter in piece:  # a name without a place to break may be wider than the room
                if lines[-1] and text_width(lines[-1] + letter, size, bold=bold) > room:
                    lines.append("")
                lines[-1] += letter
    return [line.strip() for line in lines if line.strip()]


def _write(
    figure: Figure,
    text: str,
    corner: tuple[float, float],
    color: str,
    *,
    size: float,
    weight: str = "normal",
) -> None:
    """Write a line of text; the corner is its upper left one, in points from the lower left."""
    width, height = figure.get_size_inches() * 72
    figure.text(
        corner[0] / width,
        corner[1] / height,
        text,
        color=color,
        size=size,
        weight=weight,
        va="top",
        ha="left",
    )


# --- What is shown


def _moments(trial: TrialRecord) -> Iterator[_Moment]:
    """Yield the behaviors of a trial in order."""
    momdp = trial.momdp
    seconds = 0.0
    for step in trial.steps:
        action = step.decision.action
        if action >= momdp.n_behaviors:
            continue
        words = [""] * len(momdp.query.questions)
        if step.observation is not None:
            labels = percept_labels(momdp, action, step.observation)
            words = ["" if label == SILENT else label for label in labels]
        yield _Moment(
            name=momdp.behavior_names[action],
            begin=seconds,
            end=seconds + step.cost,
            failed=came_to_nothing(momdp, step),
            words=words,
            belief=step.belief,
        )
        seconds += step.cost


def _questions(trial: TrialRecord, beliefs: Sequence[Belief], look: _Look) -> list[_Question]:
    """Return the bands of beliefs; at most so many attributes are drawn."""
    query = trial.task.query
    positive = np.array([belief.positive for belief in beliefs])  # (T+1,N)
    questions = list[_Question]()
    if query.event is not None:
        values = np.array([trial.momdp.reports.probability(belief) for belief in beliefs])
        truth = int(query.report_truth(trial.truth)[0])
        questions.append(_Question(YES, [_Line("", values, truth, look.ink, look.ink)], -1))
    drawn = 0
    for place, (name, indices) in enumerate(query.questions):
        if drawn and drawn + len(indices) > _ATTRIBUTES:
            break
        drawn += len(indices)
        lines = [
            _Line(
                query.attributes[i] if len(indices) > 1 else "",
                positive[:, i],
                int(trial.truth[i]),
                look.color(i),
                look.text_color(i),
            )
            for i in indices
        ]
        own = query.value_names[indices[0]] if len(indices) == 1 else name
        questions.append(_Question(own, lines, place))
    return questions


def _title(trial: TrialRecord, look: _Look) -> list[tuple[str, float, str]]:
    """Return the lines of question and answer with their size and weight."""
    size = look.font * 1.15
    answer = verdict_text(trial)
    if trial.report is not None:
        answer = f"answer after {trial.cost:{AMOUNT}} s: {answer}"
    room = look.width - 2 * _PAD
    return [
        *((line, size, "bold") for line in _wrapped(trial.task.question, room, size, bold=True)),
        *((line, size, "normal") for line in _wrapped(answer, room, size)),
    ]


# --- The layout


class _Band(NamedTuple):
    """Height of a band without its caption, points, and the lines of the caption."""

    height: float
    caption: Sequence[str]


def _margins(
    trial: TrialRecord, questions: Sequence[_Question], look: _Look
) -> tuple[float, float]:
    """Return the widths left and right of the axis of seconds, points."""
    rows = [[row for q in questions for row in q.labels(look, end)] for end in (0, -1)]
    left, right = (
        max(text_width(text, look.font, bold=bold) for text, _, bold in side) for side in rows
    )
    stops = [f"{_number(parts)}: stop" for parts in _stops(trial)]
    behind = [*end_word(trial).split(), *stops]
    right = max(right, *(text_width(text, look.font, bold=True) for text in behind))
    return left + 3 * _PAD, right + 4 * _PAD


def _bands(
    trial: TrialRecord,
    questions: Sequence[_Question],
    moments: Sequence[_Moment],
    scale: float,
    look: _Look,
) -> list[_Band]:
    """Return the bands from the top; `scale` is points a second."""
    room = look.width - 2 * _PAD
    beliefs = _BELIEFS
    shown = sum(len(question.lines) for question in questions if question.place >= 0)
    if shown < len(trial.truth):
        beliefs += f"; the first {shown} of {len(trial.truth)} attributes"
    explores = any(step.decision.explores for step in trial.steps)
    texts = (_BEHAVIORS, beliefs, _EXPLORING if explores else _ADVANTAGE)
    captions = [_wrapped(text, room, look.font) for text in texts]
    names = [_fitted(moment.name, (moment.end - moment.begin) * scale, look) for moment in moments]
    heights = [name.high for name in names if name is not None]
    # A belief's band holds the labels at its sides, and a word above or below its line.
    least = 3.6 if len(questions) > 1 else 6.0
    rows = [max(len(question.labels(look, end)) for end in (0, -1)) for question in questions]
    return [
        _Band(max([2 * look.line, *heights]) + _PAD, captions[0]),
        *(
            _Band(max(least, count + 0.4) * look.line, captions[1] if place == 0 else ())
            for place, count in enumerate(rows)
        ),
        _Band(4.5 * look.line, captions[2]),
    ]


def _plain_axes(figure: Figure, place: Floats, end: float, look: _Look) -> Axes:
    """Add axes without a frame; `place` is left, bottom, width and height of the figure."""
    ax = figure.add_axes((place[0], place[1], place[2], place[3]))
    ax.patch.set_alpha(0)
    ax.set_xlim(0, end)
    ax.set_yticks([])
    ax.xaxis.set_visible(False)
    ax.locator_params(axis="x", nbins=5 if look.width < 400 else 10)
    ax.tick_params(colors=look.soft, labelsize=look.font, length=0)
    for side in ax.spines.values():
        side.set_visible(False)
    return ax


# --- Behaviors


class _Fitted(NamedTuple):
    """The name of a behavior in its block: lines of text, on its side or not; points."""

    text: str
    rotation: int
    size: float
    high: float


def _fitted(name: str, room: float, look: _Look) -> _Fitted | None:
    """Return the name of a behavior as it fits into its block; None where the block is too thin.

    A word stands in each line; where these are too wide, the name stands on its side, in smaller
    letters if it has to.
    """
    words = [word for word in re.split(r"[_\s]+", name) if word] or [name]
    wide = max(text_width(word, look.font) for word in words)
    if wide + _PAD <= room:
        return _Fitted("\n".join(words), 0, look.font, look.line * len(words))
    for lines in (words, [name]):
        size = min(look.font, (room - 1) / (_LINE * len(lines)))
        if size >= _SMALLEST * look.font:
            wide = max(text_width(line, size) for line in lines)
            return _Fitted("\n".join(lines), 90, size, wide + _PAD)
    return None


def _draw_blocks(
    ax: Axes, moments: Sequence[_Moment], scale: float, height: float, look: _Look
) -> None:
    """Draw behaviors as blocks of their cost, with their names; failed ones are hatched."""
    ax.set_ylim(0, 1)
    for moment in moments:
        width = moment.end - moment.begin
        edge = look.soft if moment.failed else "none"
        hatch = "////" if moment.failed else None
        ax.bar(
            moment.begin,
            1,
            width,
            align="edge",
            color=look.block,
            lw=1.2,
            edgecolor=edge,
            hatch=hatch,
        )
        ax.axvline(moment.end, color=look.soft, lw=0.8)
        name = _fitted(moment.name, width * scale, look)
        if name is None or name.high > height:
            continue
        ground: Any = {"facecolor": look.block, "edgecolor": "none", "pad": 0.5}
        ax.text(
            moment.begin + width / 2,
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


def _draw_end(ax: Axes, word: str, look: _Look) -> None:
    """Write behind the last block how the trial ended."""
    _beside(ax, [(part, look.ink, True) for part in word.split()], 0.5, look)


def _beside(
    ax: Axes,
    rows: Sequence[tuple[str, str, bool]],
    middle: float,
    look: _Look,
    *,
    left: bool = False,
) -> None:
    """Write lines of text right, or left, of a band, their middle at a height of the axes."""
    for number, (text, color, bold) in enumerate(rows):
        ax.annotate(
            text,
            (0.0 if left else 1.0, middle),
            (
                -2 * _PAD if left else 2.5 * _PAD,
                ((len(rows) - 1) / 2 - number) * look.line,
            ),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right" if left else "left",
            va="center_baseline",
            color=color,
            size=look.font,
            weight="bold" if bold else "normal",
            annotation_clip=False,
        )


# --- Beliefs


def _draw_question(
    ax: Axes,
    question: _Question,
    moments: Sequence[_Moment],
    height: float,
    scale: float,
    look: _Look,
) -> None:
    """Draw the beliefs of one question, named at the left, with the answer's at the right.

    A ring at the right end is the truth.
    """
    low, high = -0.1, 1.1
    ax.set_ylim(low, high)
    for level in _LEVELS:
        ax.axhline(level, color=look.soft, alpha=0.25, lw=0.8, zorder=0.5)
    times = np.array([0.0, *(moment.end for moment in moments)])
    for line in question.lines:
        stroke: Any = {"drawstyle": "steps-post", "lw": 2.2, "solid_capstyle": "butt"}
        ax.plot(times, line.values, color=line.color, clip_on=False, **stroke)
        ax.plot(times[1:], line.values[1:], "o", color=line.color, ms=4.5, clip_on=False)
        if line.truth >= 0 and moments:
            ring: Any = {"mfc": "none", "mec": line.color, "ms": 9, "mew": 1.4, "clip_on": False}
            ax.plot(times[-1], line.truth, "o", **ring)
    for end in (0, -1):
        _beside(ax, question.labels(look, end), 0.5, look, left=end == 0)
    if question.place >= 0 and moments:
        points = _Scale(1 / scale, (high - low) / height)
        _write_percepts(ax, question, moments, times, points, look)


def _write_percepts(
    ax: Axes,
    question: _Question,
    moments: Sequence[_Moment],
    times: Floats,
    scale: _Scale,
    look: _Look,
) -> None:
    """Write the percepts that moved a belief, near the place, where nothing else stands."""
    taken = [_Box(0.0, level, float(times[-1]), level) for level in _LEVELS]
    taken += [box for line in question.lines for box in _boxes_of(times, line.values, scale)]
    across, up = _PAD * scale.across, 1.0 * scale.up
    for number, moment in enumerate(moments):
        word = moment.words[question.place]
        moves = [abs(line.values[number + 1] - line.values[number]) for line in question.lines]
        largest = int(np.argmax(moves))
        if not word or moves[largest] <= _BENDS:
            continue
        line = question.lines[largest]
        wide = text_width(word, look.font) * scale.across
        high = look.line * scale.up
        target = line.values[number + 1]
        # Over its own block, then behind it; near the new belief, then wherever there is room.
        lefts = [moment.end - wide - across, moment.begin + across, moment.end + across]
        bottoms = np.linspace(-0.1, 1.1 - high, 25)
        places = sorted(
            ((left, bottom) for left in lefts for bottom in bottoms.tolist()),
            key=lambda place: (lefts.index(place[0]), abs(place[1] + high / 2 - target)),
        )
        for left, bottom in places:
            box = scale.box(word, look.font, left, bottom)
            around = _Box(box.left - across, box.bottom - up, box.right + across, box.top + up)
            inside = box.left >= 0 and box.right <= ax.get_xlim()[1]
            if inside and not any(around.meets(other) for other in taken):
                taken.append(box)
                ax.text(
                    left,
                    bottom + high / 2,
                    word,
                    color=look.ink if len(question.lines) > 1 else line.text_color,
                    size=look.font,
                    va="center_baseline",
                    ha="left",
                    style="italic",
                )
                break


def _boxes_of(times: Floats, values: Floats, scale: _Scale) -> Iterator[_Box]:
    """Yield the rectangles that a belief's line and its dots take."""
    across, up = 3 * scale.across, 3 * scale.up
    for number, (begin, end) in enumerate(pairwise(times.tolist())):
        before, after = float(values[number]), float(values[number + 1])
        yield _Box(begin, before - up, end, before + up)
        yield _Box(end - across, min(before, after) - up, end + across, max(before, after) + up)


# --- What going on is worth


def _number(parts: tuple[float, float | None]) -> str:
    """Return what going on is worth: to this answer, and to later ones where that is paid.

    >>> _number((12.3, None)), _number((-3.0, 1.2))
    ('+12', '\N{MINUS SIGN}3 (+1)')
    """
    this, later = parts
    text = f"{this:+.0f}" if later is None else f"{this:+.0f} ({later:+.0f})"
    return text.replace("-", "\N{MINUS SIGN}")


def _worths(trial: TrialRecord) -> list[tuple[float, float | None]]:
    """Return what going on is worth at each step; nan where the agent compares nothing.

    Infinite or huge values, which a user's own planner may give, have no place on the axis either.
    """
    worths = []
    for step in trial.steps:
        this, later = step.decision.going_on()[:2]
        fits = abs(this + later) < _HUGE
        worths.append((this if fits else np.nan, later if step.decision.explores else None))
    return worths


def _stops(trial: TrialRecord) -> Iterator[tuple[float, float | None]]:
    """Yield what going on is worth where the agent answers."""
    for step, parts in zip(trial.steps, _worths(trial), strict=True):
        if step.decision.action >= trial.momdp.n_behaviors and not np.isnan(parts[0]):
            yield parts


def _draw_advantage(
    ax: Axes, trial: TrialRecord, scale: _Scale, height: float, look: _Look
) -> None:
    """Draw what going on is worth at each decision; the one that answers says "stop"."""
    worths = _worths(trial)
    totals = np.array([this + (later or 0.0) for this, later in worths])
    room = ax.get_xlim()[1] / scale.across
    if np.isnan(totals).all():
        for number, text in enumerate(_wrapped(RULE, room, look.font)):
            place = (0, height / 2 - number * look.line)
            ax.annotate(
                text, (0, 0), place, color=look.ink, size=look.font,
                xycoords="axes fraction", textcoords="offset points", va="center",
            )  # fmt: skip
        return
    # Bars take the lower part of the band: above them there is room for two lines of numbers.
    top = max(float(np.nanmax(totals)), 1.0)
    floor = -0.15 * top
    bars = height - 2.4 * look.line
    up = (top - floor) / bars
    ax.set_ylim(floor, floor + up * height)
    ax.axhline(0, color=look.soft, lw=1)
    scale = _Scale(scale.across, up)
    begins = np.cumsum([0.0, *(step.cost for step in trial.steps)])
    acts = [
        (begin, step.cost, total, parts)
        for step, begin, total, parts in zip(trial.steps, begins, totals, worths, strict=False)
        if step.decision.action < trial.momdp.n_behaviors and not np.isnan(total)
    ]
    taken = list[_Box]()
    for begin, cost, total, _ in acts:
        ax.bar(
            begin,
            total,
            cost,
            align="edge",
            color=look.soft,
            alpha=0.45,
            edgecolor=look.ink,
            lw=0.6,
        )
        taken.append(_Box(begin, min(total, 0.0), begin + cost, max(total, 0.0)))
    for begin, cost, total, parts in acts:
        _write_number(ax, _number(parts), (begin + cost / 2, max(total, 0.0)), taken, scale, look)
    for parts in _stops(trial):
        ax.annotate(
            f"{_number(parts)}: stop",
            (ax.get_xlim()[1], 0),
            (2.5 * _PAD, 0),
            textcoords="offset points",
            ha="left",
            va="center_baseline",
            color=look.ink,
            size=look.font,
            weight="bold",
            annotation_clip=False,
        )


def _write_number(
    ax: Axes,
    number: str,
    point: tuple[float, float],
    taken: list[_Box],
    scale: _Scale,
    look: _Look,
) -> None:
    """Write a number over its bar, or higher where another stands; omit it without room."""
    middle, bottom = point
    wide = text_width(number, look.font) * scale.across
    end = ax.get_xlim()[1]
    left = min(max(middle - wide / 2, 0.0), max(end - wide, 0.0))
    high = look.line * scale.up
    ceiling = ax.get_ylim()[1] - high
    gap = 2 * scale.up
    for rise in _candidates(bottom + gap, ceiling, high / 2):
        box = scale.box(number, look.font, left, rise)
        around = _Box(box.left - _PAD * scale.across, box.bottom, box.right, box.top)
        if box.right <= end + 1e-9 and not any(around.meets(other) for other in taken):
            taken.append(box)
            ax.text(
                left,
                rise + high / 2,
                number,
                color=look.ink,
                size=look.font,
                ha="left",
                va="center_baseline",
            )
            return


def _candidates(lowest: float, highest: float, step: float) -> Iterable[float]:
    """Return heights from the lowest to the highest that differ by a step."""
    count = int((highest - lowest) / step) + 1
    return (lowest + step * number for number in range(max(count, 1)))
