"""Bags of three formats become the same recordings; damage is one line for each bag."""

import itertools
import runpy
import shutil
import sys
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from meal_bayes import ask, build_percept_table, load_dataset
from meal_bayes.cli import main
from meal_bayes.datasets.bags import find_bags, read_bags, save_recordings
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError, OutputError, SettingsError
from meal_bayes.features import Recorder, color_histogram, spectrogram_bins, temporal_bins
from meal_bayes.untrusted import name_fault

LAB_FILE = Path(__file__).parent / "lab" / "lab.toml"
LAB = load_domain(LAB_FILE)
LAB_SIGNALS = runpy.run_path(str(LAB_FILE.with_name("signals.py")))
EXAMPLE, MAKER, START = (LAB_SIGNALS[name] for name in ("EXAMPLE", "MAKER", "START"))
messages = LAB_SIGNALS["messages"]
WAYS = ("cup.bag", "cup", "cup.mcap")  # ROS 1, ROS 2 sqlite, ROS 2 MCAP


def write(path, seed=1, rounds=2, name="cup", made=None):
    def drawn(store):
        return messages(store, name, (1, 0, 1), np.random.default_rng(seed), rounds)

    LAB_SIGNALS["write_bag"](path, made or drawn)
    return path


def read(*paths, **more):
    return read_bags(LAB, paths, **{"markers": "/markers", **more})


def same(first, second):
    assert len(first) == len(second) > 0
    for one, two in zip(first, second, strict=True):
        assert (one.behavior, one.object_name) == (two.behavior, two.object_name)
        assert one.features.keys() == two.features.keys()
        for name, vector in one.features.items():
            assert vector.tobytes() == two.features[name].tobytes()


def test_three_formats_and_the_live_driver_give_the_same_bits(tmp_path):
    folders = []
    for number, way in enumerate(WAYS):
        report = read(write(tmp_path / way))
        assert report.faults == []
        folders.append(tmp_path / f"recordings{number}")
        save_recordings(LAB, report, folders[-1])
    texts = [{path.name: path.read_bytes() for path in folder.iterdir()} for folder in folders]
    assert texts[0] == texts[1] == texts[2]

    held = load_dataset(LAB_FILE, root=folders[0])
    store = MAKER["type_store"]()
    recorder = None
    counts = dict.fromkeys(LAB.behavior_names, 0)
    rng = np.random.default_rng(1)
    for time, topic, message in messages(store, "cup", (1, 0, 1), rng, 2):
        if topic != "/markers":
            recorder.add(topic, time, message)
        elif message.data:
            recorder = Recorder(LAB, message.data.partition(":")[0])
        else:
            name = recorder.behavior
            for modality, vector in recorder.features().items():
                recorded = held.features[name, modality][0, counts[name]]
                assert vector.tobytes() == recorded.tobytes()
            counts[name] += 1
    assert counts == {"look": 2, "lift": 2, "shake": 2}


def test_a_csv_of_executions_gives_what_markers_give(tmp_path):
    bag = write(tmp_path / "cup.mcap", rounds=1)
    marked = read(bag)
    rows = ["bag,object,behavior,start,end"]
    starts = (0, 0.5, 1.7), (0.3, 1.5, 2.2)
    for behavior, start, end in zip(("look", "lift", "shake"), *starts, strict=True):
        rows.append(f"cup,cup,{behavior},{start},{end}")
    (tmp_path / "runs.csv").write_text("\n".join(rows))
    runs = tmp_path / "runs.csv"
    same(read(bag, markers=None, executions=runs).executions, marked.executions)
    for wrong in ("mug,cup,look,0,1", "cup,cup,loook,0,1", "cup,cup,look,1,1", "cup,cup,look,a,1"):
        (tmp_path / "runs.csv").write_text(f"{rows[0]}\n{wrong}")
        with pytest.raises(DataError, match="line 2"):
            read(bag, markers=None, executions=runs)


def test_an_execution_is_listed_once_and_within_its_bag(tmp_path):
    bag, runs = write(tmp_path / "cup.mcap", rounds=1), tmp_path / "runs.csv"
    rows = ["bag,object,behavior,start,end", "cup,cup,look,0,0.3"]
    runs.write_text("\n".join([*rows, "cup.mcap,cup,look,0.0,.30"]))
    with pytest.raises(DataError, match=r"line 3: the execution of .*line 2 again"):
        read(bag, markers=None, executions=runs)
    begin = START / 1e9
    absolute = f"cup,cup,look,{begin:.0f},{begin + 0.3:.1f}"
    before = f"cup,cup,look,{begin - 50:.0f},{begin + 0.3:.1f}"
    for row, fault in ((absolute, "is listed twice"), (before, "starts before the bag's start")):
        runs.write_text("\n".join([*rows, row]))
        report = read(bag, markers=None, executions=runs)
        assert len(report.executions) == 1
        assert any(fault in text for text in report.faults), report.faults


@pytest.mark.parametrize("ways", [*itertools.permutations(WAYS)])
def test_a_name_that_means_two_bags_is_refused(ways, tmp_path):
    """The same name, with other endings, must not lead to another bag without a word."""
    bags = {way: write(tmp_path / way, seed, rounds=1) for seed, way in enumerate(ways)}
    runs = tmp_path / "runs.csv"
    for way in ways:
        runs.write_text(f"bag,object,behavior,start,end\n{way},cup,look,0,0.3\n")
        (one,) = read(*bags.values(), markers=None, executions=runs).executions
        assert one.bag == way  # "cup" is the whole name of one
    both = [bags["cup.bag"], bags["cup.mcap"]]
    runs.write_text("bag,object,behavior,start,end\ncup,cup,look,0,0.3\n")
    with pytest.raises(DataError, match=r"line 2: two bags are called 'cup': give the ending"):
        read(*both, markers=None, executions=runs)


TIMES = ("1e999999", "1e99999999", "-1e99999999", "nan", "inf", "-inf", "sNaN", "1_0", "\u0663", "")


@pytest.mark.parametrize("time", TIMES)
def test_a_time_that_is_none_is_one_line(time, tmp_path):
    bag = write(tmp_path / "cup.mcap", rounds=1)
    for times in (f"{time},2", f"0,{time}"):
        (tmp_path / "runs.csv").write_text(f"bag,object,behavior,start,end\ncup,cup,look,{times}\n")
        with pytest.raises(DataError, match="line 2"):
            read(bag, markers=None, executions=tmp_path / "runs.csv")


def test_a_name_that_labels_and_bags_write_in_two_ways_is_told(tmp_path):
    report = read(write(tmp_path / "cup.mcap", rounds=1))
    labels = tmp_path / "labels.csv"
    labels.write_text("object,heavy,full,red\nCup,1,0,1\n")
    with pytest.warns(UserWarning, match="labels Cup, .*has no labels of cup; is a name written"):
        save_recordings(LAB, report, tmp_path / "a", labels)
    labels.write_text("object,heavy,full,red\ncup,1,0,1\nmug,1,0,1\n")  # of other bags
    save_recordings(LAB, report, tmp_path / "b", labels)


def damage(bag, rng):
    """Cut a bag off, or write noise over a part of it."""
    path = bag if bag.is_file() else next(bag.glob("*.[dm][bc][3a]*"))
    path = max(path.glob("*"), key=lambda one: one.stat().st_size) if path.is_dir() else path
    data = bytearray(path.read_bytes())
    if rng.random() < 0.5:
        del data[rng.integers(len(data)) :]
    else:
        start = rng.integers(len(data))
        data[start : start + 200] = rng.bytes(len(data[start : start + 200]))
    path.write_bytes(data)


@pytest.mark.quick(6)
@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_bag_is_one_line_and_the_others_go_on(tmp_path, seed):
    rng = np.random.default_rng(seed)
    whole = write(tmp_path / "whole.mcap", rounds=1)
    expected = read(whole).executions
    bag = write(tmp_path / f"torn{('.bag', '', '.mcap')[seed % 3]}", seed, rounds=1)
    undamaged = read(bag).executions
    damage(bag, rng)
    report = read(bag, whole)
    same([one for one in report.executions if one.bag == whole.name], expected)
    torn = [one for one in report.executions if one.bag == bag.name]
    if not report.faults:  # the damage did no harm, or changed values, which no checksum covers
        assert [one.behavior for one in torn] == [one.behavior for one in undamaged]
    assert all(bag.name in fault and "\n" not in fault for fault in report.faults)


NAMES = ["cup", "Tasse größer", "cup, 2", "杯", "a: b", "cup 'red'"]
NO_NAMES = ["", "x" * 300, "two\nlines"]


def drawn_messages(rng, store):
    """Return (time, topic, message) of a drawn bag: rates, gaps, order, names."""
    name = str(rng.choice(NO_NAMES if rng.random() < 0.15 else NAMES))
    every = {topic: int(rng.integers(1, 4)) for topic in LAB_SIGNALS["TOPICS"]} | {"/markers": 1}
    silent = str(rng.choice([topic for topic in every if topic != "/markers"]))
    gap = rng.uniform(0, 2.2), rng.uniform(0, 2.5)
    made = []
    counts = dict.fromkeys(every, 0)
    for time, topic, message in messages(store, name, (1, 0, 1), rng, 2):
        counts[topic] += 1
        late = (time - START) / 1e9
        if counts[topic] % every[topic] or (topic == silent and gap[0] < late < sum(gap)):
            continue
        if topic == "/joint_states" and rng.random() < 0.5:
            order = rng.permutation(len(message.name))
            message.name = [message.name[place] for place in order]
            message.effort = message.effort[order]
        made.append((time, topic, message))
    return name, made


def expected_features(messages):
    """Return what executions show, without the code of bags: (behavior, {modality: vector})."""
    executions = []
    here = None
    for time, topic, message in messages:
        if topic == "/markers":
            here = None
            if message.data:
                here = {}
                executions.append((message.data.partition(":")[0], here))
        elif here is not None:
            here.setdefault(topic, []).append((time, message))
    found = []
    for behavior, by_topic in executions:
        vectors = {}
        for topic, pairs in by_topic.items():
            times = np.array([time - pairs[0][0] for time, _ in pairs]) / 1e9
            if topic == "/camera/image" and behavior == "look":
                images = [message.data.reshape(16, 16, 3) for _, message in pairs]
                vectors["color"] = color_histogram(images, bins=2)
            if topic == "/joint_states" and behavior == "lift":
                torques = [m.effort[np.argsort(m.name)] for _, m in pairs]
                vectors["haptics"] = temporal_bins(torques, bins=5, times=times)
            if topic == "/audio" and behavior == "shake":
                sound = np.concatenate([m.data.view("<i2") for _, m in pairs]) / 2.0**15
                vectors["audio"] = spectrogram_bins(sound, 8000, 4, 4)
        found.append((behavior, {k: v.astype(np.float32) for k, v in vectors.items()}))
    return found


@pytest.mark.quick(6)
@pytest.mark.parametrize("seed", range(20))
def test_a_drawn_bag_is_right_or_one_line(tmp_path, seed):
    """Rates, gaps, order, names and damage together; and nothing is half written."""
    rng = np.random.default_rng(seed)
    bag = tmp_path / f"drawn{('.bag', '', '.mcap')[seed % 3]}"
    name, made = drawn_messages(rng, MAKER["type_store"](ros1=seed % 3 == 0))
    jitter = rng.choice([0, 5e8]) * rng.random(len(made))  # ns by which messages come too late
    late = [time + delay for (time, _, _), delay in zip(made, jitter, strict=True)]
    written = [made[place] for place in np.argsort(late, kind="stable")]
    write(bag, made=lambda store: written)
    report = read(bag)
    assert all(bag.name in fault and "\n" not in fault for fault in report.faults)
    expected = expected_features(made)
    if name_fault(name):
        assert report.executions == []
        assert len(report.faults) >= len(expected)
    else:
        shown = [(b, vectors) for b, vectors in expected if vectors]
        assert [one.behavior for one in report.executions] == [b for b, _ in shown]
        assert len(report.faults) == sum(not vectors for _, vectors in expected)
        for one, (_, vectors) in zip(report.executions, shown, strict=True):
            assert one.object_name == name
            assert one.features.keys() == vectors.keys()
            assert all(one.features[m].tobytes() == v.tobytes() for m, v in vectors.items())
    if rng.random() < 0.5:
        damage(bag, rng)
        report = read(bag)
        assert all(bag.name in fault and "\n" not in fault for fault in report.faults)
    try:
        save_recordings(LAB, report, tmp_path / "out")
    except DataError:
        assert [path.name for path in tmp_path.iterdir()] == [bag.name]
    else:
        held = load_dataset(LAB_FILE, root=tmp_path / "out")
        assert held.objects == tuple(dict.fromkeys(one.object_name for one in report.executions))
        counts = dict.fromkeys(LAB.behavior_names, 0)
        for one in report.executions if len(held.objects) == 1 else ():
            for modality, vector in one.features.items():
                kept = held.features[one.behavior, modality][0, counts[one.behavior]]
                np.testing.assert_array_equal(kept, vector)
            counts[one.behavior] += 1


def test_faults_name_bag_topic_and_time(tmp_path):
    def changed(store):
        for time, topic, message in messages(store, "cup", (1, 0, 1), np.random.default_rng(1), 2):
            late = time - START
            if topic == "/audio" or (topic == "/camera/image" and late > 2e9):
                continue
            if topic == "/joint_states" and late > 1e9:
                message.header.stamp.sec += 100
            yield time, topic, message

    report = read(write(tmp_path / "cup", made=changed))
    text = "\n".join(report.faults)
    assert "cup: no message on /audio" in report.faults
    assert "look of cup at 1700000002" in text
    assert "/camera/image: no message in the window" in text
    assert "/joint_states: the clock jumps at 1700000001" in text
    with pytest.raises(DataError, match=r"audio of shake"):
        save_recordings(LAB, report, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_stamp_of_ros_1_is_read_and_another_is_a_fault():
    lab = {"extends": "toy", "sources": {"color": {"topic": "/l", "fields": ["data"],
           "feature": "temporal_bins", "settings": {"bins": 1}}}}  # fmt: skip
    stamps = (
        [{"sec": 1 + k, "nanosec": 5} for k in range(2)],
        [{"secs": 1 + k, "nsecs": 5} for k in range(2)],
        [{"seconds": 1}],
    )
    found = []
    for series in stamps:
        recorder = Recorder(load_domain(lab), "look")
        for time, stamp in enumerate(series):
            header = SimpleNamespace(stamp=SimpleNamespace(**stamp))
            recorder.add("/l", time * 10**9, SimpleNamespace(data=[2.0], header=header))
        found.append(recorder.signals()["color"])
    assert found[0].times.tolist() == found[1].times.tolist() == [0.0, 1.0]
    assert "no attribute 'sec'" in found[2].fault


def test_executions_after_the_last_signal_are_told(tmp_path):
    def changed(store):
        for time, topic, message in messages(store, "cup", (1, 0, 1), np.random.default_rng(1), 1):
            if topic == "/markers" or time < START + 0.4e9:
                yield time, topic, message

    bag = write(tmp_path / "cup.mcap", made=changed)
    rows = ("cup,cup,look,0,0.3", "cup,mug,lift,0.5,1.5", "cup,jar,shake,1.6,1.7")
    runs = tmp_path / "runs.csv"
    runs.write_text("\n".join(["bag,object,behavior,start,end", *rows]))
    report = read(bag, markers=None, executions=runs)
    assert [one.object_name for one in report.executions] == ["cup"]
    for name in ("lift of mug", "shake of jar"):
        assert any(name in fault and "no message" in fault for fault in report.faults)
    assert not any("look of cup" in fault for fault in report.faults)


def test_a_folder_that_is_there_and_bags_that_are_not(tmp_path):
    report = read(write(tmp_path / "cup.mcap", rounds=1))
    with pytest.raises(OutputError, match="exists already"):
        save_recordings(LAB, report, tmp_path)
    with pytest.raises(SettingsError, match="no bag"):
        find_bags([tmp_path / "none"])
    shutil.copytree(tmp_path / "cup.mcap", tmp_path / "more" / "cup.mcap")
    with pytest.raises(SettingsError, match=r"cup\.mcap"):
        find_bags([tmp_path, tmp_path / "more"])


def test_without_rosbags_the_extra_is_named(tmp_path, monkeypatch):
    bag = write(tmp_path / "cup.mcap", rounds=1)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(SettingsError, match=r"meal-bayes\[bags\]"):
        read(bag)


def test_the_commands(tmp_path):
    write(tmp_path / "cup.bag")
    (tmp_path / "labels.csv").write_text("object,heavy,full,red\ncup,1,0,1\n")
    domain = ["--domain", str(LAB_FILE), "--markers", "/markers"]
    out = ["--labels", str(tmp_path / "labels.csv"), "--out", str(tmp_path / "recordings")]
    made = CliRunner().invoke(main, ["data", "import", str(tmp_path), *domain, *out])
    assert made.exit_code == 0, made.output
    assert "/joint_states" in made.output
    assert "6 executions with 1 objects" in made.output
    held = load_dataset(LAB_FILE, root=tmp_path / "recordings")
    assert held.labels.tolist() == [[1, 0, 1]]
    figure = ["--number", "2", "--out", str(tmp_path / "a.png")]
    drawn = CliRunner().invoke(main, ["data", "show", str(tmp_path / "cup.bag"), *domain, *figure])
    assert drawn.exit_code == 0, drawn.output
    assert "lift of cup" in drawn.output
    assert (tmp_path / "a.png").stat().st_size > 1000


@pytest.mark.long
def test_memory_does_not_grow_with_the_length_of_a_bag(tmp_path):
    peaks = []
    for rounds in (5, 50):
        bag = write(tmp_path / f"cup{rounds}", rounds=rounds)
        read(bag)
        tracemalloc.start()
        found = len(read(bag).executions)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert found == 3 * rounds
    features = 45 * 3 * 2000  # bytes of what the executions leave, generously
    assert peaks[1] < 1.2 * peaks[0] + features


@pytest.mark.long
def test_questions_about_held_out_boxes_are_answered(tmp_path):
    MAKER["make_bags"](tmp_path / "bags")
    domain = load_domain(EXAMPLE / "lab.toml")
    report = read_bags(domain, [tmp_path / "bags"], markers="/markers")
    assert report.faults == []
    save_recordings(domain, report, tmp_path / "out", tmp_path / "bags" / "labels.csv")
    table = build_percept_table(load_dataset(EXAMPLE / "lab.toml", root=tmp_path / "out"))
    questions = (
        "Is it heavy?", "Does it rattle?", "Is it tall?", "What color is it?",
        "Is it heavy, and does it rattle?",
    )  # fmt: skip
    trials = [
        ask(questions[number % 5], dataset=table, object=f"box_{number}", seed=number)
        for number in range(20)
    ]
    assert sum(bool(trial.success) for trial in trials) >= 18
