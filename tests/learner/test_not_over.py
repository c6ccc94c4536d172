"""Folders of logs of which some are not over: every door reads them as far as they went."""

import contextlib
import warnings

import pytest
from click.testing import CliRunner
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meal_bayes.cli import main
from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.learner import recall
from meal_bayes.learner.experience import WITHDRAWN
from meal_bayes.trial_log import ACTIVE, Logs


def killed(session):
    """Let go of what the process of a session held when it died."""
    session._recorder._file.close()
    if session._recorder._resumed is not None:
        session._recorder._resumed.release()


def torn(learner, make, steps, **options):
    """Begin a trial whose process dies after so many steps, at most."""
    arm = make.arm(seed=steps)
    session = learner.begin("red", "glass", state=arm.start(), **options)
    for _ in range(steps):
        if session.behavior is not None:
            session.observe(arm.execute(session.behavior))
    killed(session)


def resumed(learner, make, steps):
    """Begin a trial whose process dies, and so does the one that goes on with it."""
    arm = make.arm(seed=steps)
    session = learner.begin("red", "glass", state=arm.start())
    for _ in range(2):
        if session.over:
            return
        killed(session)
        draft = session._recorder.active_path
        session = learner.resume(draft, state=arm.state)
        for _ in range(steps):
            if session.behavior is not None:
                session.observe(arm.execute(session.behavior))
    killed(session)


def held(experience):
    """Return by trial the behaviors that an experience holds, and whether they succeeded."""
    rows = experience.executions.values
    keys = list(experience.trials)
    by_trial = {}
    for row in rows[rows["success"] != WITHDRAWN].tolist():
        trial, behavior, _, success = row
        by_trial.setdefault(keys[trial], []).append((behavior, success))
    return by_trial


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["whole", "torn", "torn test", "resumed", "forgotten"]),
        st.integers(0, 3),
    ),
    min_size=1,
    max_size=4,
)


@given(events=EVENTS)
@example(events=[("torn", 2)])
@example(events=[("whole", 0), ("torn", 1), ("resumed", 2)])
@example(events=[("forgotten", 0), ("torn", 2)])
@settings(max_examples=max(settings().max_examples // 10, 4), deadline=None)
def test_a_learner_is_rebuilt_with_all_that_is_not_over(dataset, make, tmp_path_factory, events):
    folder = tmp_path_factory.mktemp("logs")
    first = make.learner(dataset, "greedy", logs=folder)
    for event, steps in events:
        if event in ("whole", "forgotten"):
            trial = first.ask("red", make.arm(seed=steps), object_name="mug")
            if event == "forgotten":
                first.forget(trial, recordings=True)
        elif event == "resumed":
            resumed(first, make, steps)
        else:
            torn(first, make, steps, learn=event == "torn")
    again = make.learner(dataset, "greedy")
    with contextlib.suppress(LogError), warnings.catch_warnings():  # nothing may have been explored
        warnings.simplefilter("error")  # there is nothing to warn of
        recall(again, folder)
    assert held(again.experience) == held(first.experience)
    with contextlib.suppress(LogError):
        assert recall(again, folder) == []
    assert held(again.experience) == held(first.experience)


def test_what_was_recalled_in_part_is_recalled_to_its_end(dataset, make, tmp_path):
    first = make.learner(dataset, make.agent("look", "look", "lift"), logs=tmp_path)
    again = make.learner(dataset, make.agent("look"))
    torn(first, make, 2)
    assert [len(trial.steps) for trial in recall(again, tmp_path)] == [2]
    arm = make.arm()
    state = arm.start()
    session = first.resume(state=state)
    while session.behavior is not None:
        session.observe(arm.execute(session.behavior))
    assert [len(trial.steps) for trial in recall(again, tmp_path)] == [4]
    assert held(again.experience) == held(first.experience)


@pytest.mark.parametrize("place", [0.3, 0.7, 0.8, 0.95])  # of the bytes of its header and steps
def test_what_is_damaged_in_a_log_that_is_not_over_is_told(dataset, make, tmp_path, place):
    first = make.learner(dataset, make.agent("look", "look", "look"), logs=tmp_path)
    first.ask("red", make.arm(), object_name="mug")
    torn(first, make, 2)
    (draft,) = tmp_path.rglob(f"*{ACTIVE}")
    data = bytearray(draft.read_bytes())
    data[int(place * len(data))] ^= 255
    draft.write_bytes(data)
    with pytest.warns(UserWarning, match="Not all logs were recalled"):
        recall(make.learner(dataset, make.agent("look")), tmp_path)


DOORS = {
    "report": lambda folder: ("report", folder, "-o", folder.parent / "a.html"),
    "log show": lambda folder: ("log", "show", folder),
    "view": lambda folder: ("view", folder, "--save", folder.parent / "a.rrd"),
}


@pytest.mark.quick(1)
@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("steps", [0, 2])
def test_a_trial_that_is_not_over_is_shown_as_far_as_it_went(dataset, make, tmp_path, door, steps):
    folder = tmp_path / "logs"
    torn(make.learner(dataset, make.agent("look", "look", "look"), logs=folder), make, steps)
    result = CliRunner().invoke(main, list(map(str, DOORS[door](folder))))
    assert result.exit_code == 0, result.output
    (draft,) = folder.rglob(f"*{ACTIVE}")
    assert f"Learner.resume({str(draft)!r}) continues it" in result.output.replace("\n", "")
    (group,) = Logs(folder).begun()
    assert [len(trial.steps) for trial in group.trials] == [steps]
    with pytest.raises(LogCorruptError, match="continues it"):
        list(Logs(folder).trials())  # of which none has its outcome
