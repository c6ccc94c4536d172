"""What is drawn of a frame: diagram and search tree as graphs, beliefs and matrices as pictures.

Boxes of graphs have positions of our own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import shortest_path

from meal_bayes.canvas import colormaps
from meal_bayes.domain.words import denied
from meal_bayes.look import AMOUNT, best_options, level_names, percent
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision
from meal_bayes.trials import percept_labels
from meal_bayes.trials.text import end_word
from meal_bayes.viewer.labels import action_label, option_label, plain_text
from meal_bayes.viewer.palette import DIM, GRAY, GREEN, ORANGE, SKY, TEXT, WHITE, Color
from meal_bayes.viewer.recorder import TrialFrame

_ACTIONS = 4  # of the tree that are drawn
_OUTCOMES = 6
_LETTER = 6.0  # size of a letter, and of the frame around a label
_LINE = 13.5
_FRAME = 14.0
_COLUMN_GAP = 30.0  # between boxes
_ROW_GAP = 8.0
_SHOWN = 8  # attributes
_BAR = 50  # pixels: length of a bar, from bar to bar, of one bar
_LANE = 10
_THICK = 6
_BLOCK_WIDE = 16  # pixels of the matrices; labels are as large as ever
_CELL_HIGH = 4
_GAP = 2
_MIDDLE = 0.2  # where in a row its label is put: labels hang below their point
_BRIGHTEST = 0.6  # of the color scale: white numbers must be legible, in a light theme too
_BACK = (128, 128, 128, 60)  # behind a bar
_SD_FULL = 0.5  # the sd that has the brightest color; no row's can be larger
_ENDED = {"answers": "answered", "abstains": "abstained"}  # what a trial that is over did


class Label(NamedTuple):
    """A text at a point, pixels of a picture or units of a graph; there in a box with a name."""

    label: str
    color: Color
    x: float = 0.0
    y: float = 0.0
    name: str = ""


class Graph(NamedTuple):
    """Boxes and arrows."""

    nodes: Sequence[Label]
    edges: Sequence[tuple[str, str]]


class Picture(NamedTuple):
    """Pixels, (h,w,4) RGBA, and labels."""

    pixels: NDArray[np.uint8]
    labels: Sequence[Label]


def box_size(label: str) -> tuple[float, float]:
    """Return about how wide and high the viewer draws the box of a label."""
    lines = label.split("\n")
    return _FRAME + _LETTER * max(map(len, lines)), _FRAME + _LINE * len(lines)


class Diagram:
    """The transition diagram of a MOMDP: boxes for x and, between them, for behaviors."""

    def __init__(self, momdp: MOMDP) -> None:
        self.momdp = momdp
        labels = dict[tuple[int, int], list[str]]()  # by state and most probable next state
        for state, action in np.argwhere(momdp.legal[: momdp.terminal]).tolist():
            target = int(momdp.transition[action, state].argmax())
            labels.setdefault((state, target), []).append(action_label(momdp, action))
        # The column of every x is its distance from the start, 0 where it is never reached.
        links = np.zeros((momdp.terminal + 1, momdp.terminal + 1))
        links[tuple(np.transpose(list(labels)))] = 1
        depth = shortest_path(links, unweighted=True, indices=momdp.start)
        column = np.where(np.isinf(depth), 0, depth).astype(int).tolist()
        boxes = list[Label]()  # at the places of columns
        self._edges = list[tuple[str, str]]()
        for x in range(momdp.terminal):
            boxes.append(Label(momdp.state_label(x), GRAY, 2 * column[x], name=f"x{x}"))
        for (source, target), names in labels.items():
            box = f"{source}-{target}"
            position = column[source] + column[target]
            boxes.append(Label("\n".join(names), DIM, position, name=box))
            self._edges += [(f"x{source}", box), (box, f"x{target}")]
        boxes.append(Label("end: abstained", GRAY, 2 * max(column), name=f"x{momdp.terminal}"))
        self._nodes = _stacked(boxes)

    def at(self, frame: TrialFrame) -> Graph:
        """Return it for a frame: where the robot is, where it was, which behavior it executed."""
        visited = {step.next_x for step in frame.trial.steps[: frame.number]}
        colors = {f"x{x}": SKY for x in visited | {frame.trial.first_belief.x}}
        colors[f"x{frame.belief.x}"] = ORANGE
        momdp = self.momdp
        step = frame.step
        end = "end"
        if step is not None and (action := step.decision.action) < momdp.n_behaviors:
            colors[f"{step.x}-{momdp.transition[action, step.x].argmax()}"] = GREEN
        nodes = [node._replace(color=colors.get(node.name, node.color)) for node in self._nodes]
        if frame.belief.x == momdp.terminal:
            word = end_word(frame.trial)
            end += f": {_ENDED.get(word, word)}"
        nodes[-1] = nodes[-1]._replace(label=end)  # the last state, in the last column
        return Graph(nodes, self._edges)


def search_tree(frame: TrialFrame) -> Graph:
    """Return the top of the tree behind a decision: actions, and what follows each percept."""
    step = frame.step
    momdp = frame.trial.momdp
    if step is None:
        return Graph([Label("nothing is decided yet", GRAY, name="root")], [])
    decision = step.decision
    chosen = min(decision.action, momdp.n_behaviors)
    actions = best_options(decision.total, chosen, _ACTIONS)
    if not actions:
        return Graph([Label("no search: a fixed rule", GRAY, name="root")], [])
    count = f"{decision.simulations} simulations" if decision.simulations else "one step ahead"
    return _laid_out(
        f"{momdp.state_label(step.x)}\n{count}",
        _action_labels(momdp, decision, actions),
        _percept_lines(momdp, decision, actions),
        chosen,
    )


def _action_labels(momdp: MOMDP, decision: Decision, actions: Sequence[int]) -> dict[int, str]:
    """Return the label of each action: its name, its value and bonus, how often it was tried."""
    labels = {}
    for action in actions:
        visits = f" · {decision.visits[action]}" if decision.visits[action] else ""
        paid = decision.total[action] - decision.values[action]
        bonus = f" + {paid:{AMOUNT}}" if paid else ""
        value = f"{decision.values[action]:{AMOUNT}}{bonus}{visits}"
        labels[action] = f"{option_label(momdp, decision, action)}\n{value}"
    return labels


def _percept_lines(
    momdp: MOMDP, decision: Decision, actions: Sequence[int]
) -> dict[int, list[str]]:
    """Return by action what follows its percepts, a line each, the most visited first."""
    first_actions = {
        node: edge.action for node, edge in enumerate(decision.tree) if edge.level == 1
    }
    following = [
        edge
        for edge in decision.tree
        if edge.level > 1 and first_actions.get(edge.parent) in actions
    ]
    lines = dict[int, list[str]]()
    for edge in sorted(following, key=lambda edge: -edge.visits)[:_OUTCOMES]:
        action = first_actions[edge.parent]
        percept = "nothing"
        # Trees of other solvers may hold levels that the problem does not have.
        if edge.observation and all(0 <= level < momdp.levels for level in edge.observation):
            percept = ", ".join(percept_labels(momdp, action, edge.observation))
        bonus = f" + {edge.bonus:{AMOUNT}}" if edge.bonus else ""
        worth = f"{edge.value:{AMOUNT}}{bonus}"
        text = f"{percept} → {action_label(momdp, edge.action)}  {worth} · {edge.visits}"
        lines.setdefault(action, []).append(text)
    return lines


def _laid_out(root: str, labels: dict[int, str], lines: dict[int, list[str]], chosen: int) -> Graph:
    """Return the tree as boxes in three columns: root, actions, and the lines of each."""
    left = box_size(root)[0] + _COLUMN_GAP
    right = left + max(box_size(label)[0] for label in labels.values()) + _COLUMN_GAP
    row = box_size("")[1] + _ROW_GAP
    y = 0.0
    nodes = list[Label]()
    edges = list[tuple[str, str]]()
    for action, label in labels.items():
        name = f"a{action}"
        lines_of_action = lines.get(action, [])
        # An action stands at the middle of its lines, which take at least its own height.
        height = max(len(lines_of_action) * row, box_size(label)[1] + _ROW_GAP)
        top = y + (height - len(lines_of_action) * row) / 2
        for number, text in enumerate(lines_of_action):
            x = right + box_size(text)[0] / 2
            nodes.append(Label(text, GRAY, x, top + (number + 0.5) * row, f"{name}-{number}"))
            edges.append((name, f"{name}-{number}"))
        x = left + box_size(label)[0] / 2
        color = ORANGE if action == chosen else SKY
        nodes.append(Label(label, color, x, y + height / 2, name))
        edges.append(("root", name))
        y += height
    nodes.append(Label(root, GRAY, box_size(root)[0] / 2, y / 2, "root"))
    return Graph(nodes, edges)


def _stacked(boxes: Sequence[Label]) -> list[Label]:
    """Place boxes in their columns, `x`, one below the other."""
    nodes = list[Label]()
    left = 0.0
    for column in sorted({node.x for node in boxes}):
        members = [node for node in boxes if node.x == column]
        sizes = [box_size(node.label) for node in members]
        wide = max(width for width, _ in sizes)
        top = 0.0
        for node, (_, height) in zip(members, sizes, strict=True):
            nodes.append(node._replace(x=left + wide / 2, y=top + height / 2))
            top += height + _COLUMN_GAP
        left += wide + _COLUMN_GAP
    return nodes


def belief_bars(frame: TrialFrame) -> Picture:
    """Draw Pr(attribute is true) as bars from 0 to 100 %; a line marks it before the step."""
    names = frame.trial.task.query.value_names[:_SHOWN]
    pixels = np.zeros((len(names) * _LANE, _BAR, 4), np.uint8)
    labels = []
    for i, name in enumerate(names):
        now = float(frame.belief.positive[i])
        before = float(frame.before[i])
        top = i * _LANE + (_LANE - _THICK) // 2
        color = GREEN if now > 0.5 else SKY
        share = np.clip(now * _BAR - np.arange(_BAR), 0, 1)[:, None]  # of a pixel that is full
        lane = share * np.array(color) + (1 - share) * np.array(_BACK)
        lane[_BAR // 2] = GRAY
        lane[min(int(before * _BAR), _BAR - 1)] = ORANGE
        pixels[top : top + _THICK] = lane
        middle = (i + _MIDDLE + 0.1) * _LANE
        labels.append(Label(plain_text(name), TEXT, -12, middle))
        labels.append(Label(percent(now), color, _BAR + 9, middle))
    return Picture(pixels, labels)


def matrices(momdp: MOMDP, counts: NDArray[np.float64] | None, action: int) -> Picture:
    """Draw mean, sd and the paper's point estimate of a behavior's rows, and of its counts."""
    n = min(len(momdp.query), _SHOWN)
    k = momdp.levels
    # A new object's latent class is drawn by Pr(class given truth), its row Dirichlet about the
    # class's: mean and sd of its rows by its truth, (N,2,K).
    prob = momdp.latent_classes[..., None]  # (N,2,C,K)
    rows = momdp.confusion[:, None, action]
    mean = (prob * rows).sum(axis=2)
    precision = momdp.precision[:, None, action, :, None]
    square = (prob * (rows**2 + rows * (1 - rows) / (1 + precision))).sum(axis=2)
    sd = np.sqrt(np.maximum(square - mean**2, 0.0))
    blocks = [(f"{plain_text(momdp.behavior_names[action])}: mean", mean, 1.0)]
    blocks.append(("sd (exact)" if not sd.any() else "sd", sd, _SD_FULL))
    if counts is not None:  # fractions of counted percepts; nan of none
        total = counts[:, action].sum(axis=-1, keepdims=True)
        point = np.where(total > 0, counts[:, action] / np.maximum(total, 1), np.nan)
        blocks.append(("paper: counts only", point, 1.0))
    labels = [
        Label(plain_text(said), TEXT, -5.0, (2 * i + t + _MIDDLE) * _CELL_HIGH)
        for i, name in enumerate(momdp.query.attributes[:n])
        for t, said in enumerate((denied(name), name))
    ]
    parts = list[NDArray[np.uint8]]()
    gap = ((0, 0), (0, _GAP), (0, 0))
    for title, values, full in blocks:
        left = sum(part.shape[1] for part in parts)
        numbers = values[:n].reshape(2 * n, k)
        block = _block(title, numbers, (numbers / full).repeat(_CELL_HIGH, 0), left)
        parts.append(np.pad(block.pixels, gap))
        labels += block.labels
    return Picture(np.concatenate(parts, axis=1), labels)


def with_samples(picture: Picture, sampled: NDArray[np.float64] | None, levels: int) -> Picture:
    """Return matrices, and beside them, as lanes, the object's rows (M,N,K) in sampled MOMDPs.

    The numbers are the smallest and the largest probability of a level.
    """
    pixels, labels = picture
    if sampled is None:  # as wide as the others, so that the view does not move
        return Picture(np.pad(pixels, ((0, 0), (0, levels * _cell_width(levels)), (0, 0))), labels)
    rows = sampled[:, :_SHOWN]
    m, n, k = rows.shape
    tall = 2 * _CELL_HIGH  # of an attribute, as its two rows beside it
    lanes = np.sort(rows, axis=0)[np.arange(tall) * m // tall].swapaxes(0, 1)  # (N,tall,K)
    ends = np.stack([rows.min(axis=0), rows.max(axis=0)], axis=1)  # (N,2,K)
    title = f"{m} sampled MOMDPs"
    left = pixels.shape[1]
    band = _block(title, ends.reshape(2 * n, k), lanes.reshape(n * tall, k), left)
    return Picture(np.concatenate([pixels, band.pixels], axis=1), (*labels, *band.labels))


def _block(
    title: str, numbers: NDArray[np.float64], colors: NDArray[np.float64], left: int
) -> Picture:
    """Draw a block of numbers (R,K) on colors (R * 4,K) from 0 to 1, which begins at `left`."""
    k = numbers.shape[1]
    width = _cell_width(k)
    pixels = colormaps["viridis"](_BRIGHTEST * np.nan_to_num(colors), bytes=True).repeat(width, 1)
    labels = [Label(title, TEXT, left + k * width / 2, -1.3 * _CELL_HIGH)]
    for (row, z), value in np.ndenumerate(numbers):
        text = "-" if np.isnan(value) else f"{value:.2f}"
        x = left + (z + 0.5) * width
        y = (row + _MIDDLE) * _CELL_HIGH
        labels.append(Label(text, WHITE, x, y))
    rows = 1 if k == 2 else 2  # of the levels' names below the columns, as some are long
    for z, name in enumerate(level_names(k)):
        y = (len(numbers) + _MIDDLE + z % rows) * _CELL_HIGH
        labels.append(Label(name, TEXT, left + (z + 0.5) * width, y))
    return Picture(pixels, labels)


def _cell_width(k: int) -> int:
    """Return the width of a cell of K levels, pixels; a block of 2 is as wide as one of 4."""
    return max(4, _BLOCK_WIDE // k)
