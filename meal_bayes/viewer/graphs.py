"""Two graphs with positions of their own: the transition diagram, the top of the search tree."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import shortest_path

from meal_bayes.display import best_options, level_names
from meal_bayes.momdp import MOMDP
from meal_bayes.viewer.labels import action_label, option_label
from meal_bayes.viewer.palette import DIM, GRAY, GREEN, ORANGE, SKY, Color
from meal_bayes.viewer.recorder import TrialFrame

_ACTIONS, _OUTCOMES = 4, 6  # of the tree that are drawn
_LETTER, _LINE, _FRAME = 6.0, 13.5, 14.0  # size of a letter, and of the frame around a label
_COLUMN_GAP, _ROW_GAP = 30.0, 8.0  # between boxes


class Node(NamedTuple):
    """One box of a graph, centered at (x, y)."""

    name: str
    label: str
    x: float
    y: float
    color: Color


class Graph(NamedTuple):
    """Boxes and arrows."""

    nodes: tuple[Node, ...]
    edges: tuple[tuple[str, str], ...]


def box_size(label: str) -> tuple[float, float]:
    """Return about how wide and high the viewer draws the box of a label."""
    lines = label.split("\n")
    return _FRAME + _LETTER * max(map(len, lines)), _FRAME + _LINE * len(lines)


def overlap(one: Node, other: Node) -> bool:
    """Return whether the boxes of two nodes overlap."""
    (w, h), (v, g) = box_size(one.label), box_size(other.label)
    return abs(one.x - other.x) < (w + v) / 2 and abs(one.y - other.y) < (h + g) / 2


class Diagram:
    """The transition diagram of a MOMDP: boxes for x and, between them, for behaviors."""

    def __init__(self, momdp: MOMDP) -> None:
        self._momdp = momdp
        moves = dict[tuple[int, int], list[int]]()  # by (state, most probable next state)
        for state, action in np.argwhere(momdp.legal[: momdp.terminal]).tolist():
            target = int(momdp.transition[action, state].argmax())
            moves.setdefault((state, target), []).append(action)
        labels = {
            pair: "\n".join(action_label(momdp, action) for action in actions)
            for pair, actions in moves.items()
        }
        self._states = _place_states(momdp, labels)
        self._behaviors = list[tuple[frozenset[int], Node]]()
        edges = list[tuple[str, str]]()
        for (source, target), label in labels.items():
            start, end, name = self._states[source], self._states[target], f"{source}-{target}"
            x, y = (start.x + end.x) / 2, (start.y + end.y) / 2
            if source == target:  # above the state, and not beyond the first or last column
                (w, h), (v, g) = box_size(start.label), box_size(label)
                x += (v - w) / 2 * (-1 if start.x > 0 else 1)
                y -= (h + g) / 2 + _COLUMN_GAP / 2
            node = Node(name, label, x, y, DIM)
            taken = [*self._states, *(other for _, other in self._behaviors)]
            while any(overlap(node, other) for other in taken):  # moved down to a free place
                node = node._replace(y=node.y + _LINE)
            self._behaviors.append((frozenset(moves[source, target]), node))
            edges += [(start.name, name), (name, end.name)]
        self._edges = tuple(edges)

    def at(self, frame: TrialFrame) -> Graph:
        """Return it for a frame: where the robot is, where it was, which behavior it executed."""
        visited = {step.next_x for step in frame.trial.steps[: frame.number]}
        visited |= {frame.trial.first_belief.x}
        end = "end"
        if frame.x == self._momdp.terminal:
            end += ": abstained" if frame.trial.report is None else ": answered"
        nodes = [
            node._replace(
                label=end if x == self._momdp.terminal else node.label,
                color=ORANGE if x == frame.x else SKY if x in visited else GRAY,
            )
            for x, node in enumerate(self._states)
        ]
        done = -1 if frame.step is None else frame.step.decision.action
        source = -1 if frame.step is None else frame.step.x
        for actions, node in self._behaviors:
            executed = done in actions and node.name.startswith(f"{source}-")
            nodes.append(node._replace(color=GREEN if executed else DIM))
        return Graph(tuple(nodes), self._edges)


def search_tree(frame: TrialFrame) -> Graph:
    """Return the top of the tree behind a decision: actions, and what follows each percept."""
    step, momdp = frame.step, frame.trial.momdp
    if step is None:
        return Graph((Node("root", "nothing is decided yet", 0, 0, GRAY),), ())
    decision, chosen = step.decision, min(step.decision.action, momdp.n_behaviors)
    if not (actions := best_options(decision.values, chosen, _ACTIONS)):
        return Graph((Node("root", "no search: a fixed rule", 0, 0, GRAY),), ())
    count = f"{decision.simulations} simulations" if decision.simulations else "one step ahead"
    root = f"{momdp.x_names[step.x]}\n{count}"
    labels = {}
    for action in actions:
        visits = f" · {decision.visits[action]}" if decision.visits[action] else ""
        label = option_label(momdp, decision, action)
        labels[action] = f"{label}\n{decision.values[action]:.1f}{visits}"
    left = box_size(root)[0] + _COLUMN_GAP
    right = left + max(box_size(label)[0] for label in labels.values()) + _COLUMN_GAP
    # The most visited second-level edges below the drawn actions.
    first = {at: edge.action for at, edge in enumerate(decision.tree) if edge.level == 1}
    second = [e for e in decision.tree if e.level > 1 and first.get(e.parent) in actions]
    leaves = dict[int, list[str]]()
    for edge in sorted(second, key=lambda e: -e.visits)[:_OUTCOMES]:
        names = level_names(momdp.levels)
        percept = ", ".join(names[z] for z in edge.observation if 0 <= z < len(names)) or "nothing"
        text = f"{percept} → {action_label(momdp, edge.action)}  {edge.value:.1f} · {edge.visits}"
        leaves.setdefault(first[edge.parent], []).append(text)
    row, y = box_size("")[1] + _ROW_GAP, 0.0
    nodes, edges = list[Node](), list[tuple[str, str]]()
    for action, label in labels.items():
        below = leaves.get(action, [])
        height = max(len(below) * row, box_size(label)[1] + _ROW_GAP)
        top = y + (height - len(below) * row) / 2
        for number, text in enumerate(below):
            x = right + box_size(text)[0] / 2
            nodes.append(Node(f"a{action}-{number}", text, x, top + (number + 0.5) * row, GRAY))
            edges.append((f"a{action}", f"a{action}-{number}"))
        x, color = left + box_size(label)[0] / 2, ORANGE if action == chosen else SKY
        nodes.append(Node(f"a{action}", label, x, y + height / 2, color))
        edges.append(("root", f"a{action}"))
        y += height
    nodes.append(Node("root", root, box_size(root)[0] / 2, y / 2, GRAY))
    return Graph(tuple(nodes), tuple(edges))


def _place_states(momdp: MOMDP, moves: dict[tuple[int, int], str]) -> list[Node]:
    """Return a node for every x, in the column of its distance from the start."""
    labels = [*momdp.x_names[: momdp.terminal], "end: abstained"]
    links = np.zeros((len(labels), len(labels)))
    links[tuple(np.transpose(list(moves)))] = 1
    depth = shortest_path(links, unweighted=True, indices=momdp.start)
    depth[np.isinf(depth)] = 0  # what is never reached
    depth[momdp.terminal] = depth.max()
    between = [text for (source, target), text in moves.items() if source != target] or [""]
    wide = max(box_size(label)[0] for label in labels[:-1]) + 2 * _COLUMN_GAP
    wide += max(box_size(text)[0] for text in between)
    high = max(box_size(text)[1] for text in between) + 2 * box_size("")[1]
    nodes, used = list[Node](), Counter[int]()
    for x, (label, column) in enumerate(zip(labels, depth.tolist(), strict=True)):
        nodes.append(Node(f"x{x}", label, column * wide, used[column] * high, GRAY))
        used[column] += 1
    return nodes
