"""Names that people give, of objects, agents and keys: refused where they come in, or kept."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.agents import load_agent
from meal_bayes.errors import MealBayesError
from meal_bayes.learner import Learner
from meal_bayes.trial_log import read_trials
from meal_bayes.untrusted import name_fault

NAMES = (
    st.text(st.characters(exclude_categories=[]), max_size=6)
    | st.sampled_from(["tasse_\udce9", "..", "a/b", "\N{GRINNING FACE}" * 60, "x" * 201, "con"])
    | st.just("[bold]cup")
)
FULL = {"red": True, "full": False}


@given(name=NAMES)
def test_a_name_is_refused_at_every_door_or_kept(name):
    domain = Path(__file__).parents[2] / "examples" / "kitchen.toml"
    with TemporaryDirectory() as folder:
        learner = Learner(domain, agent="prior", logs=Path(folder))
        doors = {
            "tell": lambda: learner.tell(name, FULL),
            "begin": lambda: learner.begin("red", object_name=name, key=name).cancel(),
            "key": lambda: learner.begin("red", object_name="cup", key=name).cancel(),
            "agent": lambda: replace(load_agent("greedy"), name=name),
        }
        if name_fault(name):
            for door in doors.values():
                with pytest.raises(MealBayesError, match=r"name|key") as caught:
                    door()
                assert "\n" not in str(caught.value)
            return
        for door in doors.values():
            door()
        logged = {
            t.task.object_name for path in Path(folder).rglob("*.mcap") for t in read_trials(path)
        }
        assert logged == {name, "cup"}
        learner.save(Path(folder, "mind"))
        back = Learner.load(Path(folder, "mind"), logs=None)
        assert back.experience.objects == learner.experience.objects
        back.forget(name)
