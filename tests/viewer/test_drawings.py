"""Diagrams and trees as the viewer draws them: all that there is, and no two boxes overlap."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.look import GREEN, ORANGE
from meal_bayes.momdp import build_momdp
from meal_bayes.planners import Decision, TreeEdge
from meal_bayes.trials.picture import text_width
from meal_bayes.viewer.drawings import MATRICES, UNIT, Diagram, box_size, matrices, search_tree
from meal_bayes.viewer.recorder import Clock


def momdp_of(name):
    domain = load_domain(name)
    query = Query(domain.attributes[:1])
    rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    return build_momdp(domain, query, rows)


def apart(nodes):
    for first, second in itertools.combinations(nodes, 2):
        (w, h) = box_size(first.label)
        (v, g) = box_size(second.label)
        assert abs(first.x - second.x) >= (w + v) / 2 or abs(first.y - second.y) >= (h + g) / 2


@pytest.mark.parametrize("name", ["roc36", "roc36_published", "ispy32", "cy101", "toy"])
def test_the_diagram_shows_every_x_and_every_legal_behavior(name, trials):
    momdp = momdp_of(name)
    frame = next(Clock().frames(0, trials[0]))
    graph = Diagram(momdp).at(frame)
    apart(graph.nodes)
    labels = "\n".join(node.label for node in graph.nodes).split("\n")
    assert set(momdp.x_labels or momdp.x_names[:-1]) <= set(labels)
    legal = {momdp.behavior_names[a] for a in range(momdp.n_behaviors) if momdp.legal[:-1, a].any()}
    assert legal <= set(labels)
    names = {node.name for node in graph.nodes}
    assert {end for edge in graph.edges for end in edge} <= names


def test_the_diagram_shows_where_the_robot_is_and_what_it_did(trials):
    trial = trials[0]
    diagram = Diagram(trial.momdp)
    for frame in Clock().frames(0, trial):
        colors = {node.name: node.color for node in diagram.at(frame).nodes}
        assert [name for name, color in colors.items() if color == ORANGE] == [f"x{frame.belief.x}"]
        done = [node.label for node in diagram.at(frame).nodes if node.color == GREEN]
        behavior = frame.step is not None and frame.step.decision.action < trial.momdp.n_behaviors
        if behavior and trial.momdp.legal[frame.step.x, frame.step.decision.action]:
            (label,) = done
            assert trial.momdp.behavior_names[frame.step.decision.action] in label


@pytest.mark.parametrize("answers", [True, False])
@pytest.mark.parametrize(
    ("ended", "word"),
    [("", None), ("on_step error: ValueError", "broken off")],  # at its last step
)
def test_the_diagram_says_how_a_trial_ended(trials, ended, word, answers):
    trial = replace(trials[0], ended=ended, report=trials[0].report if answers else None)
    *_, last = Clock().frames(0, trial)
    assert last.belief.x == trial.momdp.terminal
    label = Diagram(trial.momdp).at(last).nodes[-1].label
    assert label.endswith(f": {word or ('answered' if answers else 'abstained')}")


def decided(trial, values, tree):
    """Return a frame whose decision has these values and this tree."""
    frame = list(Clock().frames(0, trial))[1]
    n = len(values)
    decision = Decision(3, values, np.zeros(n), np.zeros(n, int), tree, 100)
    step = type(frame.step)(0, decision, 1, None, 1.0, -1.0, trial.last_belief)
    return frame._replace(step=step)


def test_the_tree_shows_the_most_visited_below_the_best_actions(trials):
    trial = trials[0]
    e = trial.momdp.n_behaviors
    values = np.full(e + 1, np.nan)
    values[[0, 3, e]] = 5.0, 9.0, 7.0
    tree = (
        TreeEdge(1, -1, 0, (), 10, 5.0),
        TreeEdge(1, -1, 3, (), 90, 9.0),
        *(TreeEdge(2, 1, 4, (z, 0), 10 * z, float(z)) for z in range(4)),
        TreeEdge(2, 0, e, (), 7, 1.0),
    )
    graph = search_tree(decided(trial, values, tree))
    labels = {node.name: node.label for node in graph.nodes}
    assert labels["root"].endswith("100 simulations")
    assert {name for name in labels if "-" not in name} == {"root", "a0", "a3", f"a{e}"}
    assert labels["a3-0"].endswith("3.0 · 30")  # the most visited first
    assert [node.name for node in graph.nodes if node.color == ORANGE] == ["a3"]
    apart(graph.nodes)


@pytest.mark.quick(9)
@pytest.mark.parametrize("letters", [3, 12, 40])
@pytest.mark.parametrize("levels", [2, 4, 8])
@pytest.mark.parametrize("attributes", [1, 3, 12])
def test_texts_of_the_matrices_are_apart_and_in_view(attributes, levels, letters):
    """In a window of 1280 x 720; a text is 13 pixels high, and hangs 7 below its point."""
    names = tuple(f"{'m' * (letters - 2)}{i:02}" for i in range(attributes))
    domain = replace(load_domain("toy"), attributes=names, groups={}, synonyms={})
    rng = np.random.default_rng(attributes + levels + letters)
    shape = (attributes, len(domain.behaviors), 2, levels)
    momdp = build_momdp(domain, Query(names), rng.dirichlet(np.ones(levels), shape[:-1]))
    counts = rng.integers(0, 9, shape).astype(float)
    sampled = rng.dirichlet(np.ones(levels), (8, attributes))
    for rows in (None, sampled):
        pixels, labels = matrices(momdp, counts, 0, rows)
        height, width, _ = pixels.shape
        assert width <= MATRICES.right
        assert height <= MATRICES.bottom
        boxes = []
        for label in labels:
            half = text_width(label.label, 12.0) / UNIT / 2
            top = label.y + 7 / UNIT
            boxes.append((label.x - half, label.x + half, top, top + 13 / UNIT))
        boxes = np.array(boxes)
        assert (boxes[:, 0] >= MATRICES.left).all()
        assert (boxes[:, 1] <= MATRICES.right).all()
        assert (boxes[:, 2] >= MATRICES.top).all()
        assert (boxes[:, 3] <= MATRICES.bottom).all()
        first, second = (boxes[side] for side in np.triu_indices(len(boxes), 1))
        beside = (first[:, [1, 3]] <= second[:, [0, 2]]) | (second[:, [1, 3]] <= first[:, [0, 2]])
        assert beside.any(axis=1).all()
