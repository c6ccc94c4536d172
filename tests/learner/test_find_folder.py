"""A search has a folder of its own, and a learner that knows what it knew."""

import copy

import numpy as np
import pytest

from meal_bayes.datasets import Dataset
from meal_bayes.errors import LogError


def test_a_learner_that_knows_other_things_goes_on_with_no_search(
    searching, mind, make, dataset, tmp_path
):
    session = copy.deepcopy(mind).begin_find("red", 2, log=tmp_path)
    searching.one_step(session, searching.Table(0))
    searching.bury(session)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    labels = np.array([[i // 4 % 2, i // 2 % 2] for i in range(len(dataset.objects))], np.int8)
    blind = Dataset(dataset.domain, dataset.objects, dataset.features, labels)  # to what is red
    other = make.learner(blind, "greedy")
    with pytest.raises(LogError, match="learned other things since"):
        other.resume_find(tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    searching.drive(copy.deepcopy(mind).resume_find(tmp_path), searching.Table(0))


def test_a_second_search_never_mixes_with_a_first(searching, mind, tmp_path):
    session = copy.deepcopy(mind).begin_find("red", searching.CUPS, log=tmp_path / "it")
    trials = tmp_path / "trials"
    copy.deepcopy(mind).begin("red", "mug", log=trials / "a.mcap").cancel()
    for folder in (tmp_path / "it", trials):  # under way; of other trials
        learner = copy.deepcopy(mind)
        with pytest.raises(LogError, match=r"name another.*resume_find"):
            learner.begin_find("full", searching.CUPS, log=folder)
        assert list(learner.experience.trials) == list(mind.experience.trials)
    searching.drive(session, searching.Table(0))
    with pytest.raises(LogError, match="name another"):
        copy.deepcopy(mind).begin_find("red", searching.CUPS, log=tmp_path / "it")
    searching.assert_read_back(tmp_path / "it", session.search)
    with pytest.raises(LogError, match="is over"):
        copy.deepcopy(mind).resume_find(tmp_path / "it")


def test_by_default_every_search_has_a_new_folder(searching, dataset, make, tmp_path):
    learner = make.learner(dataset, "greedy", logs=tmp_path)
    sessions = [learner.begin_find("red", searching.CUPS) for _ in range(2)]
    folders = sorted(path for path in (tmp_path / "kitchen").iterdir())
    assert len(folders) == 2
    for session in sessions:
        searching.bury(session)
    with pytest.raises(LogError, match=r"2 searches that were broken off: red in .*resume_find"):
        learner.resume_find()
    with pytest.raises(LogError, match=r"no trial that was broken off.*resume_find\(\)"):
        learner.resume()
    searching.drive(learner.resume_find(folders[0]), searching.Table(0))
    searching.drive(learner.resume_find(), searching.Table(0))
