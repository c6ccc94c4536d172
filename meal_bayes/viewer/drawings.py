"""What is drawn of a frame: diagram and search tree as graphs, confusion matrices as pictures.

Boxes of graphs have positions of our own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import shortest_path

from meal_bayes.canvas import colormaps
from meal_bayes.domain.words import denied
from meal_bayes.look import (
    AMOUNT,
    DIM_GRAY,
    GREEN,
    MID_GRAY,
    ORANGE,
    SKY,
    TEXT_GRAY,
    WHITE,
    best_options,
    level_names,
)
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision
from meal_bayes.trials import percept_labels
from meal_bayes.trials.picture import text_width
from meal_bayes.trials.text import end_word
from meal_bayes.viewer.labels import action_label, option_label, plain_text
from meal_bayes.viewer.recorder import TrialFrame

_ACTIONS = 4  # of the tree that are drawn
_OUTCOMES = 6
_LETTER = 6.0  # size of a letter, and of the frame around a label
_LINE = 13.5
_FRAME = 14.0
_COLUMN_GAP = 30.0  # between boxes
_ROW_GAP = 8.0
_SHOWN = 12  # attributes
UNIT = 5.0  # pixels of the window, when it is 1280 x 720, a unit of the matrices
_FONT = 12.5  # pixels: size of a letter of a label, what its box is wider than the text
_PADDING = 7.0
_GAP = 4  # units: between blocks, from line to line of titles, below the matrices
_TITLE = 4.4
_FOOT = 9
_HANG = 1.4  # labels hang so far below their point
_WIDEST_CELL = 14
_HIGHEST_CELL = 10
_BRIGHTEST = 0.6  # of the color scale: white numbers must be legible, in a light theme too
_SD_FULL = 0.5  # the sd that has the brightest color; no row's can be larger
_ENDED = {"answers": "answered", "abstains": "abstained"}  # what a trial that is over did


class Label(NamedTuple):
    """A text at a point, pixels of a picture or units of a graph; there in a box with a name."""

    label: str
    color: str
    x: float = 0.0
    y: float = 0.0
    name: str = ""


class Graph(NamedTuple):
    """Boxes and arrows."""

    nodes: Sequence[Label]
    edges: Sequence[tuple[str, str]]


class Area(NamedTuple):
    """Borders of what a view shows, units of its picture, whose left top corner is (0, 0)."""

    left: int
    top: int
    right: int
    bottom: int


MATRICES = Area(-42, -10, 208, 110)


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
            boxes.append(Label(momdp.state_label(x), MID_GRAY, 2 * column[x], name=f"x{x}"))
        for (source, target), names in labels.items():
            box = f"{source}-{target}"
            position = column[source] + column[target]
            boxes.append(Label("\n".join(names), DIM_GRAY, position, name=box))
            self._edges += [(f"x{source}", box), (box, f"x{target}")]
        boxes.append(Label("end: abstained", MID_GRAY, 2 * max(column), name=f"x{momdp.terminal}"))
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
        return Graph([Label("nothing is decided yet", MID_GRAY, name="root")], [])
    decision = step.decision
    chosen = min(decision.action, momdp.n_behaviors)
    actions = best_options(decision.total, chosen, _ACTIONS)
    if not actions:
        return Graph([Label("no search: a fixed rule", MID_GRAY, name="root")], [])
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
            nodes.append(Label(text, MID_GRAY, x, top + (number + 0.5) * row, f"{name}-{number}"))
            edges.append((name, f"{name}-{number}"))
        x = left + box_size(label)[0] / 2
        color = ORANGE if action == chosen else SKY
        nodes.append(Label(label, color, x, y + height / 2, name))
        edges.append(("root", name))
        y += height
    nodes.append(Label(root, MID_GRAY, box_size(root)[0] / 2, y / 2, "root"))
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


def matrices(
    momdp: MOMDP,
    counts: NDArray[np.float64] | None,
    action: int,
    sampled: NDArray[np.float64] | None = None,
) -> Picture:
    """Draw the confusion rows of a behavior: mean, sd, those of the counts, and sampled ones.

    The picture fits into `MATRICES` (units of `UNIT` pixels in a window of 1280 x 720): cells are
    as large as the numbers of attributes and levels allow, and labels that are too long are cut.

    Parameters
    ----------
    counts : NDArray[np.float64] | None, shape (N,A,2,K)
        Percepts that were counted, of which the paper makes its point estimate.
    action : int
        The behavior.
    sampled : NDArray[np.float64] | None, shape (M,N,K)
        The object's rows in sampled MOMDPs. Their numbers are the smallest and the largest
        probability of a level.
    """
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
    blocks = [_Block("mean", mean[:n]), _Block("sd (exact)" if not sd.any() else "sd", sd[:n])]
    if counts is not None:  # fractions of counted percepts; nan of none
        total = counts[:, action].sum(axis=-1, keepdims=True)
        point = np.where(total > 0, counts[:, action] / np.maximum(total, 1), np.nan)
        blocks.append(_Block("paper: counts only", point[:n]))
    if sampled is not None:
        ends = np.stack([sampled.min(axis=0), sampled.max(axis=0)], axis=1)  # (N,2,K)
        blocks.append(_Block(f"{len(sampled)} sampled MOMDPs", ends[:n], sampled[:, :n]))
    # There is always room for the sampled ones, so that the picture does not move.
    wide = (MATRICES.right - len(blocks) * _GAP) // (max(len(blocks), 4) * k)
    wide = min(max(wide, 1), _WIDEST_CELL)
    high = min(max((MATRICES.bottom - _FOOT) // (2 * n), 1), _HIGHEST_CELL)
    names = [  # behind the picture's left edge
        Label(_shortened(plain_text(said), -MATRICES.left), TEXT_GRAY, y=(2 * i + t + 0.5) * high)
        for i, name in enumerate(momdp.query.attributes[:n])
        for t, said in enumerate((denied(name), name))
    ]
    labels = [label._replace(x=-_units(label.label) / 2, y=label.y - _HANG) for label in names]
    parts = list[NDArray[np.uint8]]()
    left = 0
    for block in blocks:
        parts.append(_cells(block, wide, high))
        labels += _block_labels(block, left, wide, high)
        left += parts[-1].shape[1]
    title = f"{plain_text(momdp.behavior_names[action])}: Pr(percept given truth)"
    title = _shortened(title, MATRICES.right)
    labels.append(Label(title, TEXT_GRAY, _units(title) / 2, MATRICES.top))
    return Picture(np.concatenate(parts, axis=1), labels)


class _Block(NamedTuple):
    """Numbers (N,2,K) by truth and level; of `sampled` rows (M,N,K) the smallest and largest."""

    title: str
    numbers: NDArray[np.float64]
    sampled: NDArray[np.float64] | None = None


def _cells(block: _Block, wide: int, high: int) -> NDArray[np.uint8]:
    """Return the colors of a block with a gap on its right, (2N * high, K * wide + gap, 4)."""
    n, _, k = block.numbers.shape
    full = _SD_FULL if block.title.startswith("sd") else 1.0
    colors = (block.numbers / full).reshape(2 * n, k).repeat(high, 0)
    if block.sampled is not None:  # of an attribute as many lanes as its two rows are high
        places = np.arange(2 * high) * len(block.sampled) // (2 * high)
        colors = np.sort(block.sampled, axis=0)[places].swapaxes(0, 1).reshape(-1, k)
    pixels = colormaps["viridis"](_BRIGHTEST * np.nan_to_num(colors), bytes=True).repeat(wide, 1)
    return np.pad(pixels, ((0, 0), (0, _GAP), (0, 0)))


def _block_labels(block: _Block, left: int, wide: int, high: int) -> list[Label]:
    """Return title, numbers and names of levels of a block whose left edge is at `left`."""
    n, _, k = block.numbers.shape
    width = k * wide
    title = _shortened(block.title, width)
    labels = [Label(title, TEXT_GRAY, left + width / 2, MATRICES.top + _TITLE)]
    for (row, z), value in np.ndenumerate(block.numbers.reshape(2 * n, k)):
        text = "-" if np.isnan(value) else f"{value:.2f}"
        if _units(text) > wide:
            text = text.removeprefix("0")
        labels.append(Label(text, WHITE, left + (z + 0.5) * wide, (row + 0.5) * high - _HANG))
    names = level_names(k)
    if max(map(_units, names)) > wide * 2:  # "surely yes" in narrow cells
        names = tuple(str(z) for z in range(k))
    rows = 1 if max(map(_units, names)) <= wide else 2
    for z, name in enumerate(names):
        y = 2 * n * high + _TITLE * (z % rows)
        labels.append(Label(name, TEXT_GRAY, left + (z + 0.5) * wide, y))
    return labels


def _units(label: str) -> float:
    """Return how wide the viewer draws the box of a label, in units."""
    return (text_width(label, _FONT) + _PADDING) / UNIT


def _shortened(label: str, room: float) -> str:
    """Cut a label that is wider than the room, in units."""
    if _units(label) <= room:
        return label
    while label and _units(f"{label}…") > room:
        label = label[:-1]
    return f"{label}…"
