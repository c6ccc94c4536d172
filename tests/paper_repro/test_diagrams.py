import pytest

from meal_bayes.domain import load_domain
from meal_bayes.evaluation.canvas import save
from paper_repro.diagrams import transition_diagram


@pytest.mark.parametrize("name", ["roc36", "ispy32", "cy101", "roc36_published", "toy"])
def test_every_state_and_behavior_is_drawn(name, tmp_path):
    diagram = load_domain(name).diagram
    ax = transition_diagram(diagram, title=name)
    words = " ".join(text.get_text() for text in ax.texts)
    for state in diagram.states[:-1]:
        assert state in words
    for effect in diagram.effects:
        assert effect.behavior in words
    assert "term" not in words
    assert save(ax, tmp_path / "diagram.png").stat().st_size > 1000


def test_states_do_not_lie_on_each_other():
    diagram = load_domain("roc36").diagram
    ax = transition_diagram(diagram)
    places = {text.get_text(): text.get_position() for text in ax.texts}
    assert len({places[state] for state in diagram.states[:-1]}) == len(diagram.states) - 1
