"""Messages that no damage makes: they must be refused by name."""

import itertools
import json
import random

import numpy as np
import pytest

from meal_bayes.domain import load_domain
from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log import TrialWriter, check_log, messages, read_trials, salvage
from meal_bayes.trial_log.file import FAULTS, TrialBuilder
from meal_bayes.trial_log.messages import LINES, OUTCOME, Momdps, TrialEncoder
from meal_bayes.trials import Trial


def sealed(trial, change=lambda place, message: None, garble=lambda place, data: data):
    """Messages of a trial, changed; places count the MOMDP, the trial, its steps, its outcome."""
    packed = TrialEncoder(0, Momdps()).whole(trial)
    sealed = [(m.topic, m.data) for m in packed if m.topic != LINES]
    for place, (topic, data) in enumerate(sealed):
        message = json.loads(data)
        change(place, message)
        changed = json.dumps(message).encode()
        sealed[place] = topic, changed if topic == OUTCOME else garble(place, changed)
    return sealed


def built(messages):
    builder = TrialBuilder()
    trials = []
    for topic, data in messages:
        trials.append(builder.add(topic, data))
    return trials[-1]


@pytest.fixture(scope="module")
def trial(make):
    rng = np.random.default_rng(17)
    momdp = make.momdp(load_domain("toy"), 2, rng)
    return next(
        trial
        for trial in (make.trial(momdp, rng, steps=3, edges=3) for _ in itertools.count())
        if trial.report is not None and trial.steps[0].observation is not None
    )


def test_unchanged_messages_give_the_trial(trial, make):
    assert make.equal(built(sealed(trial)), trial)


# place: 0 the MOMDP, 1 the start, 2 the first step, 5 the report, 6 the outcome
def put(place, *path, value):
    """Return a change of one message: of the entry that the path leads to."""
    *inner, last = path

    def change(message):
        for name in inner:
            message = message[name]
        message[last] = value

    return place, change


# place: 0 the MOMDP, 1 the start, 2 the first step, 5 the report, 6 the outcome
CHANGES = {
    "no attribute": put(0, "attributes", value=[]),
    "attribute twice": put(0, "attributes", value=["red", "red"]),
    "rows do not sum": put(0, "confusion", "values", 0, value=5.0),
    "another shape": put(0, "confusion", "shape", value=[-1]),
    "a number is no list": put(0, "prior", value=0.5),
    "a text is no number": put(0, "prior", 0, value="red"),
    "a list in a list": put(0, "prior", 0, value=[0.5]),
    "no field": (0, lambda m: m.pop("prior")),
    "other momdp": put(1, "momdp", value=3),
    "other query": put(1, "attributes", 0, value="blue"),
    "truth short": (1, lambda m: m["truth"].pop()),
    "truth of a larger type": put(1, "truth", 0, value=256),
    "key is no JSON": put(1, "key", value="[1"),
    "first belief short": (1, lambda m: m["belief"]["log_prob"]["values"].pop()),
    "first x": put(1, "belief", "x", value=-1),
    "counts short": put(2, "belief", "percept_counts", value={"shape": [2], "values": [1, 2]}),
    "visits short": (2, lambda m: m["visits"].pop()),
    "visits are no whole numbers": put(2, "visits", 0, value=0.5),
    "next x": put(2, "next_x", value=9),
    "percept long": (2, lambda m: m["observation"].append(0)),
    "percept level": put(2, "observation", 0, value=4),
    "negative action": put(2, "action", value=-1),
    "tree percepts": put(2, "tree", 0, "observation", value=["a"]),
    "step number": put(2, "step", value=1),
    "cost": put(0, "cost", 0, value=None),
    "truth too long": (1, lambda m: m["truth"].extend([0] * 3_000_000)),
    "reward": put(2, "reward", value="-Infinity"),
    "belief": put(2, "belief", "log_prob", "values", 0, value=None),
    "edges": (2, lambda m: m["tree"].extend(m["tree"][:1] * 260_000)),
    "report in a step": (5, lambda m: m["report"].pop()),
    "no report in a step": (5, lambda m: m.pop("report")),
    "report": (6, lambda m: m["report"].pop()),
    "steps": put(6, "steps", value=2),
}


@pytest.mark.quick(12)
@pytest.mark.parametrize("name", CHANGES)
def test_inconsistent_messages_are_refused(name, trial):
    where, change = CHANGES[name]

    def at_place(place, message):
        if place == where:
            change(message)

    with pytest.raises(FAULTS):
        built(sealed(trial, at_place))


@pytest.mark.quick(15)
@pytest.mark.parametrize("seed", range(50))
def test_garbled_messages_raise_nothing_else(seed, trial, outcome_of):
    rng = random.Random(seed)
    target = rng.randrange(6)

    def garble(place, data):
        if place != target or not data:
            return data
        changed = bytearray(data)
        for _ in range(rng.randint(1, 4)):
            changed[rng.randrange(len(changed))] = rng.randrange(256)
        return bytes(changed[: rng.randint(1, len(changed))] if rng.random() < 0.3 else changed)

    result = outcome_of(lambda: built(sealed(trial, garble=garble)))
    assert isinstance(result, (Trial, *FAULTS)), repr(result)


@pytest.mark.parametrize(
    "places", [(1, 2, 3, 4, 5, 6), (0, 2, 6), (0, 6), (0, 1, 1), (0, 1, 3, 4, 5, 6),
               (0, 1, 4, 3, 2, 6), (0, 1, 2, 3, 4, 5, 6, 6)]
)  # fmt: skip
def test_messages_out_of_order_are_refused(trial, places):
    messages = sealed(trial)
    with pytest.raises(LogCorruptError):
        built([messages[place] for place in places])


def test_limits_hold_on_the_writing_side(trial, monkeypatch, tmp_path):
    with TrialWriter(tmp_path / "a.mcap", {}) as log:
        for limit in ("MESSAGE_LIMIT", "TRIAL_LIMIT"):
            monkeypatch.setattr(messages, limit, 300)
            with pytest.raises(LogError, match="at most 300"):
                log.write(trial)
            monkeypatch.undo()
        log.write(trial)
    assert len(list(read_trials(tmp_path / "a.mcap"))) == 1


@pytest.mark.long
def test_a_trial_longer_than_a_chunk_comes_back(make, tmp_path):
    rng = np.random.default_rng(1)
    momdp = make.momdp(load_domain("toy"), 2, rng)
    trial = make.trial(momdp, rng, steps=4, edges=17_000)
    path = tmp_path / "a.mcap"
    with TrialWriter(path, {}) as log:
        for _ in range(3):
            log.write(trial)
    assert all(make.equal(trial, back) for back in read_trials(path))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert len(list(salvage(path))) == 2
    assert check_log(path).trials == 2


def test_a_broken_write_never_takes_the_whole_name(trial, monkeypatch, tmp_path):
    path = tmp_path / "a.mcap"
    with TrialWriter(path, {}) as log:
        log.write(trial)
        with monkeypatch.context() as patch:
            patch.setattr(log._mcap, "flush", lambda: (_ for _ in ()).throw(OSError("disk full")))
            with pytest.raises(
                LogError, match=r"a\.mcap cannot be written: disk full .1 trials are kept"
            ):
                log.write(trial)
        with pytest.raises(LogError, match="not open"):
            log.write(trial)
    assert not path.exists()
    assert len(list(salvage(log.active_path))) == 1


@pytest.mark.parametrize(
    ("place", "field"), [(2, "reward"), (5, "cost"), (6, "reward"), (6, "cost"), (6, "success")]
)
def test_an_outcome_that_its_steps_contradict_is_refused(place, field, trial):
    def change(at, message):
        if at == place:
            message[field] = message[field] + 1

    with pytest.raises(LogCorruptError, match="not that of its steps"):
        built(sealed(trial, change))
