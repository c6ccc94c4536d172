"""A learner comes back as it was; a file that is none is one clear error."""

import contextlib
import io
import json
import zipfile
import zlib

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression

from meal_bayes.datasets import load_percepts
from meal_bayes.errors import DataError, MealBayesError, OutputError, SettingsError
from meal_bayes.learner import Learner
from meal_bayes.learner.saved import _TABLES, checksum
from meal_bayes.learner.views import attempts

STATE = ("counts", "concentration", "dispersion")


def same(first, second):
    a = first.posterior
    b = second.posterior
    for name in STATE:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(first.base_rates, second.base_rates)
    assert first.trait.sd == second.trait.sd


@pytest.fixture(scope="module")
def agent(make):
    return make.agent("look", "lift", **make.ours)


@pytest.fixture(scope="module")
def taught(dataset, make, agent):
    """A learner that was refitted after one word and told two more."""
    learner = make.learner(dataset, agent, seed=5, reward=70.0)
    trials = []
    for n, name in enumerate(("mug", "mug", None)):
        trials.append(learner.ask("red, full", make.arm(seed=n), object_name=name))
    learner.tell(trials[0], {"red": True})
    learner.refit()
    learner.tell(trials[1], {"full": True})
    learner.tell(trials[2], {"red": False, "full": False})
    return learner, trials


@pytest.fixture
def saved(taught, tmp_path):
    path = tmp_path / "kitchen.mind"
    taught[0].save(path)
    return path


def test_everything_comes_back(taught, saved, dataset, agent, make):
    learner, trials = taught
    again = Learner.load(saved, agent=agent, logs=None)
    same(again.knowledge(), learner.knowledge())
    assert (again.settings.seed, again.settings.reward, again._questions.lessons) == (5, 70.0, 3)
    for name in ("instances", "levels", "labels", "executions", "feedback", "object_labels"):
        labels = (getattr(each.experience, name).values for each in (again, learner))
        np.testing.assert_array_equal(*labels)
    assert again.experience.trials == learner.experience.trials
    assert again.experience.objects == learner.experience.objects
    counts = (attempts(each.experience) for each in (again, learner))
    np.testing.assert_array_equal(*counts)
    asked = [each.ask("red", make.arm(seed=9), learn=False, key=9) for each in (learner, again)]
    np.testing.assert_array_equal(asked[0].last_belief.log_prob, asked[1].last_belief.log_prob)
    again.forget(trials[2])
    again.refit()
    again.forget(trials[0])
    assert [(again.experience.labels_of_trial(t.task.key) >= 0).any() for t in trials] == [
        False,
        True,
        False,
    ]
    same_again = make.learner(dataset, agent, seed=5, reward=70.0)
    assert again.knowledge().posterior.counts.shape == same_again.knowledge().posterior.counts.shape


def test_nothing_is_fitted_again(saved, agent, monkeypatch):
    def fit(*arguments, **options):
        raise AssertionError("fitted again")

    monkeypatch.setattr("meal_bayes.learner.online.fit_and_validate", fit)
    again = Learner.load(saved, agent=agent, logs=None)
    assert again.knowledge().posterior.counts.sum() > 0


def test_a_posterior_of_ones_own_comes_back(dataset, make, tmp_path):
    fitted = make.learner(dataset).knowledge().posterior
    agent = make.agent("look", **make.ours)
    make.learner(dataset, agent, posterior=fitted).save(tmp_path / "own.mind")
    again = Learner.load(tmp_path / "own.mind", agent=agent, logs=None)
    np.testing.assert_array_equal(again.settings.posterior.concentration, fitted.concentration)
    np.testing.assert_array_equal(again.knowledge().posterior.dispersion, fitted.dispersion)


def test_a_percept_table_comes_back(tmp_path):
    learner = Learner("roc36", agent="predefined", logs=None).fit(load_percepts("roc36"))
    trial = learner.ask("heavy", "heavy_blue_beans")
    learner.tell(trial, {"heavy": True})
    learner.save(tmp_path / "a.mind")
    again = Learner.load(tmp_path / "a.mind", logs=None)
    for name in ("heavy_blue_beans", "light_blue_rice"):
        first, second = (x.knowledge(name).posterior for x in (learner, again))
        np.testing.assert_array_equal(first.concentration, second.concentration)


def test_an_agent_of_one_s_own_is_given_again(saved):
    with pytest.raises(SettingsError, match=r"'script' is not one of the package"):
        Learner.load(saved, logs=None)


def test_a_classifier_of_one_s_own_is_given_again(dataset, make, tmp_path):
    ours = LogisticRegression()
    learner = make.learner(dataset, make.agent("look", **make.ours), classifier=ours)
    plain = make.learner(dataset, make.agent("look", **make.ours))
    assert not np.array_equal(
        learner.knowledge().posterior.counts, plain.knowledge().posterior.counts
    )
    learner.tell(learner.ask("red", make.arm()), {"red": False})
    learner.refit()  # as loading does
    path = tmp_path / "a.mind"
    learner.save(path)
    again = Learner.load(path, agent=make.agent("look", **make.ours), classifier=ours, logs=None)
    same(again.knowledge(), learner.knowledge())
    with pytest.raises(SettingsError, match="LogisticRegression"):
        Learner.load(path, agent=make.agent("look", **make.ours), logs=None)


def test_saving_twice_replaces_and_leaves_nothing_else(taught, saved):
    taught[0].save(saved)
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


@pytest.mark.parametrize("table", _TABLES)
@pytest.mark.parametrize("way", ["short", "long", "out of range"])
def test_a_record_that_cannot_be_read_again_is_not_written(table, way, agent, saved):
    """Ctrl-C may come between two tables; the file that was saved before must stay."""
    before = saved.read_bytes()
    torn = Learner.load(saved, agent=agent, logs=None)
    rows = getattr(torn.experience, table)
    if way == "out of range":
        held = (
            rows.values
            if rows.values.dtype.names is None
            else rows.values["behavior" if table == "executions" else "object"]
        )
        held[-1:] = 100 if held.dtype.kind == "i" else np.inf
    elif way == "short":
        rows._count -= 1
    else:
        rows.extend(rows.values[-1:])
    told = ""
    try:
        torn.save(saved)
    except OutputError as fault:
        told = str(fault)
    assert (saved.read_bytes() == before) == ("record of this learner is incomplete" in told)
    Learner.load(saved, agent=agent, logs=None)  # whatever was written can be read


def test_a_folder_that_is_not_there_or_a_place_that_cannot_be_written(taught, tmp_path):
    taught[0].save(tmp_path / "new" / "a.mind")
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="cannot be written"):
        taught[0].save(tmp_path / "file" / "a.mind")


def rewritten(path, change, *, signed=True):
    """Write the archive anew with other members, and with checksums of these."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
        comment = archive.comment
    change(members)
    text = members.get("learner.json", b"")
    if signed:
        with contextlib.suppress(ValueError, RecursionError):
            sums = {name: zlib.crc32(content) for name, content in members.items()}
            sums.pop("learner.json", None)
            text = members["learner.json"] = json.dumps({**json.loads(text), "checksums": sums})
            text = text.encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
        archive.comment = checksum(text) if signed else comment


def text(**changes):
    def change(members):
        meta = {**json.loads(members["learner.json"]), **changes}
        members["learner.json"] = json.dumps(meta).encode()

    return change


def setting(**changes):
    def change(members):
        meta = json.loads(members["learner.json"])
        meta["settings"]["table"].update(changes)
        members["learner.json"] = json.dumps(meta).encode()

    return change


def array(name, edit):
    """Change an array."""

    def change(members):
        values = np.load(io.BytesIO(members[f"{name}.npy"]))
        buffer = io.BytesIO()
        edit(values)
        np.save(buffer, values)
        members[f"{name}.npy"] = buffer.getvalue()

    return change


def features(edit):
    """Change the first array of features."""

    def change(members):
        name = json.loads(members["learner.json"])["features"][0][2]
        array(name, edit)(members)

    return change


def torn(members):
    name = f"{json.loads(members['learner.json'])['features'][0][2]}.npy"
    members[name] = members[name][:-7]


def entry(name, column, value):
    """Change one entry of a table."""
    if isinstance(column, str):
        return array(name, lambda values: values[column].__setitem__(0, value))
    return array(name, lambda values: values.__setitem__((0, column), value))


def state(edit):
    """Change what was fitted."""

    def change(members):
        meta = json.loads(members["learner.json"])
        edit(meta["fitted"][0]["state"]["table"])
        members["learner.json"] = json.dumps(meta).encode()

    return change


HOSTILE = {
    "format": text(format=99),
    "domain": text(domain={"name": "x"}),
    "an object less": lambda members: members.update({"objects": b'"cup 0"'}),
    "an object twice": lambda members: members.update({"objects": b"\n".join([b'"a"'] * 14)}),
    "a number for an object": lambda members: members.update({"objects": b"7"}),
    "a trial twice": lambda members: members.update(
        {"trials": b"\n".join([members["trials"]] * 2)}
    ),
    "keys that are none": lambda members: members.update({"trials": b"{}"}),
    "seed": setting(seed="x"),
    "reward": setting(reward=[1]),
    "a setting that is none": setting(wings=2),
    "payoffs that are none": setting(payoffs=[1.0, 2.0]),
    "payoffs of words": setting(payoffs=["a", "b", "c", "d"]),
    "what was fitted": text(fitted=7),
    "a level too high": entry("levels", 0, 99),
    "a label that is none": entry("labels", 0, 7),
    "an object that is not there": entry("instances", "object", 99),
    "a behavior that is not there": entry("instances", "behavior", 99),
    "features that are not there": text(features=[[0, "fitted/0", "fitted/0"]]),
    "an instance that is not there": entry("executions", "instance", 9999),
    "an attribute that is not there": entry("feedback", "attribute", 9),
    "a trial that is not there": entry("feedback", "trial", 99),
    "features that are no numbers": features(lambda values: values.fill(np.nan)),
    "another class": state(lambda table: table["perception"].update({"class": "system"})),
    "no perception": state(lambda table: table.pop("perception")),
    "no classifiers": state(lambda table: table["perception"]["fields"].pop("classifiers")),
    "text for counts": state(lambda table: table.update(counted_labels="y")),
    "an array of objects": state(lambda table: table["trained_cells"].update(dtype="|O")),
    "an array that is not there": state(lambda table: table["trained_cells"].update(array="../x")),
    "labels for knowledge": state(lambda table: table.update(knowledge=table["trained_cells"])),
    "fewer percepts than instances": state(
        lambda table: table.update(levels=table["trained_cells"])
    ),
    "nested": lambda members: members.update({"learner.json": b"[" * 100_000}),
    "no text": lambda members: members.pop("learner.json"),
    "not JSON": lambda members: members.update({"learner.json": b"\xff\xfe"}),
    "no labels": lambda members: members.pop("labels.npy"),
    "a pickle": lambda members: members.update({"labels.npy": b"cos\nsystem\n(S'true'\ntR."}),
    "torn array": torn,
    "a table": text(table={"class": "PerceptTable", "fields": {}}),
}  # fmt: skip


@pytest.mark.quick(12)
@pytest.mark.parametrize("kind", HOSTILE)
def test_what_is_not_a_learner_is_one_line(saved, agent, kind):
    rewritten(saved, HOSTILE[kind])
    with pytest.raises(MealBayesError) as raised:
        Learner.load(saved, agent=agent, logs=None)
    assert "\n" not in str(raised.value)


def damaged(values, kind, place):
    """Return an array with one fault; None where it can have no such."""
    values = values.copy()
    if values.dtype.names:
        values = values if kind in ("shape", "dtype") else values[values.dtype.names[0]]
    if not values.size or not values.ndim:
        return None
    if kind == "shape":
        return values[:-1]
    if kind == "dtype":
        other = np.uint8 if values.dtype.names or values.dtype != np.uint8 else np.int16
        return np.zeros(values.shape, other)
    most = np.finfo(np.float32).max if values.dtype.kind == "f" else np.iinfo(np.int8).max
    value = {"NaN": np.nan, "inf": np.inf, "-1": -7, "too large": most}[kind]
    if values.dtype.kind == "b" or not (np.isfinite(value) or values.dtype.kind == "f"):
        return None
    values.flat[place % values.size] = value
    return values


@pytest.mark.quick(2)
@pytest.mark.filterwarnings("ignore:'l")  # a behavior yields nothing
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("kind", ["NaN", "inf", "-1", "too large", "shape", "dtype"])
def test_a_damaged_array_is_refused_wherever_it_is(kind, signed, dataset, make, tmp_path):
    """Where checksums are those of the damage: it is refused, or what is believed is finite."""
    learner = make.learner(dataset, "greedy", seed=5)
    for n, name in enumerate(("mug", "mug", None)):
        trial = learner.ask("red, full", make.arm(seed=n), object_name=name)
        learner.tell(trial, {"red": bool(n % 2)})
    learner.save(tmp_path / "whole")
    content = (tmp_path / "whole").read_bytes()
    with zipfile.ZipFile(tmp_path / "whole") as archive:
        arrays = {
            name: np.load(io.BytesIO(archive.read(name)))
            for name in archive.namelist()
            if name.endswith(".npy")
        }
    assert len(arrays) > 40
    path = tmp_path / "mind"
    for place, (name, values) in enumerate(arrays.items()):
        wrong = damaged(values, kind, place)
        if wrong is None or wrong.tobytes() == values.tobytes():
            continue
        buffer = io.BytesIO()
        np.save(buffer, wrong)
        path.write_bytes(content)
        rewritten(path, lambda members: members.update({name: buffer.getvalue()}), signed=signed)  # noqa: B023  called at once
        again = None
        with contextlib.suppress(DataError):
            again = Learner.load(path, logs=None)
        assert signed or again is None
        if again is None:
            continue
        with np.errstate(over="ignore"):
            asked = again.ask("red, full", make.arm(seed=7), learn=False)
        assert not np.isnan(asked.last_belief.log_prob).any()


def test_object_arrays_are_never_unpickled(saved, agent, tmp_path):
    with (tmp_path / "a.npy").open("wb") as file:
        np.save(file, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    content = (tmp_path / "a.npy").read_bytes()
    rewritten(saved, lambda members: members.update({"labels.npy": content}))
    with pytest.raises(DataError, match="expected"):
        Learner.load(saved, agent=agent, logs=None)


def test_a_torn_file_is_one_line(saved, agent):
    content = saved.read_bytes()
    for size in (0, 10, len(content) // 2, len(content) - 1):
        saved.write_bytes(content[:size])
        with pytest.raises(DataError, match="valid learner"):
            Learner.load(saved, agent=agent, logs=None)
    saved.unlink()
    with pytest.raises(DataError, match="No file"):
        Learner.load(saved, agent=agent, logs=None)


def test_two_learners_do_not_write_over_each_other(dataset, make, tmp_path):
    agent = make.agent("look", **make.ours)
    path = tmp_path / "mind"
    make.learner(dataset, agent).save(path)
    first, second = (Learner.load(path, agent=agent, logs=None) for _ in range(2))
    first.save(path)
    first.save(path)
    with pytest.raises(OutputError, match="another learner was saved there"):
        second.save(path)
    with pytest.raises(OutputError, match="another learner was saved there"):
        make.learner(dataset, agent).save(path)
    second.save(path, overwrite=True)
    assert [file.name for file in tmp_path.iterdir()] == ["mind"]
