"""Diagram and search tree: everything is there, and nothing lies on anything else."""

import itertools

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.momdp import build_momdp
from meal_bayes.planners import Decision, TreeEdge
from meal_bayes.viewer.graphs import Diagram, search_tree
from meal_bayes.viewer.moments import Clock
from meal_bayes.viewer.palette import GREEN, ORANGE


def momdp_of(name):
    domain = load_domain(name)
    query = Query(domain.attributes[:1])
    rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    return build_momdp(domain, query, rows)


def apart(nodes):
    for one, other in itertools.combinations(nodes, 2):
        assert abs(one.x - other.x) > 20 or abs(one.y - other.y) > 20, (one, other)


@pytest.mark.parametrize("name", ["roc36", "roc36_published", "ispy32", "cy101", "toy"])
def test_the_diagram_shows_every_x_and_every_legal_behavior(name, trials):
    momdp = momdp_of(name)
    moment = next(Clock().moments(0, trials[0]))
    graph = Diagram(momdp).at(moment)
    apart(graph.nodes)
    labels = "\n".join(node.label for node in graph.nodes).split("\n")
    assert set(momdp.x_names[:-1]) <= set(labels)
    legal = {momdp.behavior_names[a] for a in range(momdp.n_behaviors) if momdp.legal[:-1, a].any()}
    assert legal <= set(labels)
    names = {node.name for node in graph.nodes}
    assert {end for edge in graph.edges for end in edge} <= names


def test_the_diagram_shows_where_the_robot_is_and_what_it_did(trials):
    trial = trials[0]
    diagram = Diagram(trial.momdp)
    for moment in Clock().moments(0, trial):
        colors = {node.name: node.color for node in diagram.at(moment).nodes}
        assert [name for name, color in colors.items() if color == ORANGE] == [f"x{moment.x}"]
        done = [node.label for node in diagram.at(moment).nodes if node.color == GREEN]
        behavior = moment.step is not None and moment.step.decision.action < trial.momdp.n_behaviors
        if behavior and trial.momdp.legal[moment.step.x, moment.step.decision.action]:
            (label,) = done
            assert trial.momdp.behavior_names[moment.step.decision.action] in label


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
    step = list(Clock().moments(0, trial))[1]
    decision = Decision(3, values, np.zeros(e + 1), np.zeros(e + 1, int), tree, 100)
    moment = step._replace(step=type(step.step)(0, decision, 1, None, 1.0, -1.0, trial.last_belief))
    graph = search_tree(moment)
    labels = {node.name: node.label for node in graph.nodes}
    assert labels["root"].endswith("100 simulations")
    assert {name for name in labels if "-" not in name} == {"root", "a0", "a3", f"a{e}"}
    assert labels["a3-0"].endswith("3.0 · 30")  # the most visited first
    assert [node.name for node in graph.nodes if node.color == ORANGE] == ["a3"]
    apart(graph.nodes)
