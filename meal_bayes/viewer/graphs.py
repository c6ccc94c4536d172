"""Two graphs with positions of their own: the transition diagram, the top of the search tree."""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from meal_bayes.display import level_names
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision, TreeEdge
from meal_bayes.viewer.moments import Moment
from meal_bayes.viewer.palette import DIM, GRAY, GREEN, ORANGE, SKY, Color
from meal_bayes.viewer.words import action_word, best_options

_WIDE, _HIGH = 170.0, 95.0  # between the columns and rows of the diagram
_ACTIONS, _OUTCOMES = 4, 6  # of the tree that are drawn
_COLUMNS, _ROW, _BOX = (0.0, 150.0, 380.0), 30.0, 52.0  # of the tree


class Node(NamedTuple):
    """One box of a graph."""

    name: str
    label: str
    x: float
    y: float
    color: Color


@dataclass(frozen=True)
class Graph:
    """Boxes and arrows."""

    nodes: tuple[Node, ...]
    edges: tuple[tuple[str, str], ...]


class Diagram:
    """The transition diagram of a MOMDP: boxes for x and, between them, for behaviors."""

    def __init__(self, momdp: MOMDP) -> None:
        self._momdp = momdp
        moves = _moves(momdp)
        self._places = _places(momdp, {pair for pair in moves if pair[0] != pair[1]})
        edges, self._ways = list[tuple[str, str]](), list[tuple[frozenset[int], Node]]()
        for (source, target), actions in moves.items():
            name = f"{source}-{target}"
            edges.append((f"x{source}", name))
            edges.append((name, f"x{target}"))
            (x, y), (u, v) = self._places[source], self._places[target]
            middle = ((x + u) / 2, (y + v) / 2) if source != target else (x, y - 0.62 * _HIGH)
            middle = self._free(*middle)
            label = "\n".join(action_word(momdp, action) for action in actions)
            self._ways.append((frozenset(actions), Node(name, label, *middle, DIM)))
        self._edges = tuple(edges)

    def _free(self, x: float, y: float) -> tuple[float, float]:
        """Move a box down until it lies on no other, as of two moves that undo each other."""
        taken = [*self._places.values(), *((node.x, node.y) for _, node in self._ways)]
        while any(abs(x - u) < _BOX and abs(y - v) < _BOX for u, v in taken):
            y += 0.6 * _HIGH
        return x, y

    def at(self, moment: Moment) -> Graph:
        """Draw it for a moment: where the robot is, where it was, what it just did."""
        visited = {s.next_x for s in moment.trial.steps[: moment.number]}
        visited |= {moment.trial.first_belief.x}
        nodes = []
        for x, (u, v) in self._places.items():
            color = ORANGE if x == moment.x else SKY if x in visited else GRAY
            nodes.append(Node(f"x{x}", self._label(x, moment), u, v, color))
        done = -1 if moment.step is None else moment.step.decision.action
        source = -1 if moment.step is None else moment.step.x
        for actions, node in self._ways:
            just = done in actions and node.name.startswith(f"{source}-")
            nodes.append(node._replace(color=GREEN if just else DIM))
        return Graph(tuple(nodes), self._edges)

    def _label(self, x: int, moment: Moment) -> str:
        if x != self._momdp.terminal:
            return self._momdp.x_names[x]
        if moment.x != x:
            return "end"
        return "end: answered" if moment.trial.report is not None else "end: no answer"


def search_tree(moment: Moment) -> Graph:
    """Draw the top of the tree behind a decision: actions, and what follows each percept."""
    step, momdp = moment.step, moment.trial.momdp
    if step is None:
        return Graph((Node("root", "nothing is decided yet", 0, 0, GRAY),), ())
    decision, end = step.decision, momdp.n_behaviors
    actions = best_options(decision.values, min(decision.action, end), _ACTIONS)
    if not actions:
        return Graph((Node("root", "a rule: no search", 0, 0, GRAY),), ())
    nodes, edges, y = list[Node](), list[tuple[str, str]](), 0.0
    leaves = _leaves(decision, actions)
    for action in actions:
        name, top = f"a{action}", y
        for number, edge in enumerate(leaves.get(action, [])):
            leaf = f"{name}-{number}"
            nodes.append(Node(leaf, _leaf_label(momdp, edge), _COLUMNS[2], y, GRAY))
            edges.append((name, leaf))
            y += _ROW
        color = ORANGE if action == min(decision.action, end) else SKY
        middle = (top + max(y - _ROW, top)) / 2
        y = max(y, top + _BOX)
        nodes.append(Node(name, _action_label(momdp, decision, action), _COLUMNS[1], middle, color))
        edges.append(("root", name))
    count = f"{decision.simulations} simulations" if decision.simulations else "one step ahead"
    nodes.append(Node("root", f"{momdp.x_names[step.x]}\n{count}", 0, (y - _BOX) / 2, GRAY))
    return Graph(tuple(nodes), tuple(edges))


def _moves(momdp: MOMDP) -> dict[tuple[int, int], list[int]]:
    """Group legal behaviors by where they lead from where, when they succeed."""
    moves = dict[tuple[int, int], list[int]]()
    for x, action in zip(*np.nonzero(momdp.legal), strict=True):
        if x != momdp.terminal:
            target = int(momdp.transition[action, x].argmax())
            moves.setdefault((int(x), target), []).append(int(action))
    return moves


def _places(momdp: MOMDP, arrows: set[tuple[int, int]]) -> dict[int, tuple[float, float]]:
    """Put every x in the column of its distance from the start."""
    depth, queue = {momdp.start: 0}, deque([momdp.start])
    while queue:
        x = queue.popleft()
        for source, target in sorted(arrows):
            if source == x and target not in depth:
                depth[target] = depth[x] + 1
                queue.append(target)
    places, used = dict[int, tuple[float, float]](), dict[int, int]()
    for x in range(momdp.terminal):
        column = depth.get(x, 0)
        lane = used.get(column, 0)
        used[column] = lane + 1
        places[x] = (column * _WIDE, lane * 1.5 * _HIGH)
    right = max((u for u, _ in places.values()), default=0.0)
    places[momdp.terminal] = (right, 1.5 * _HIGH)
    return places


def _leaves(decision: Decision, actions: list[int]) -> dict[int, list[TreeEdge]]:
    """Find the most visited second-level edges below the drawn actions."""
    first = {at: edge.action for at, edge in enumerate(decision.tree) if edge.level == 1}
    second = [e for e in decision.tree if e.level > 1 and first.get(e.parent) in actions]
    leaves = dict[int, list[TreeEdge]]()
    for edge in sorted(second, key=lambda e: -e.visits)[:_OUTCOMES]:
        leaves.setdefault(first[edge.parent], []).append(edge)
    return leaves


def _action_label(momdp: MOMDP, decision: Decision, action: int) -> str:
    value = f"{decision.values[action]:.1f}"
    visits = f" · {decision.visits[action]}" if decision.visits[action] else ""
    return f"{action_word(momdp, action)}\n{value}{visits}"


def _leaf_label(momdp: MOMDP, edge: TreeEdge) -> str:
    words = level_names(momdp.levels)
    seen = ", ".join(words[z] for z in edge.observation if 0 <= z < len(words)) or "nothing"
    return f"{seen} → {action_word(momdp, edge.action)}  {edge.value:.1f} · {edge.visits}"
