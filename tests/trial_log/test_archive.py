"""An archive holds a study whole, or is not written; equal inputs give equal bytes."""

import hashlib
import json
import zipfile

import pytest

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log import write_trials
from meal_bayes.trial_log.archive import MANIFEST, write_archive


@pytest.fixture
def study(make, tmp_path):
    folder = tmp_path / "study"
    write_trials(folder / "a" / "one.mcap", make.trials(3, 5), header={"seed": 1})
    write_trials(folder / "two.mcap", make.trials(2, 5), header={"seed": 2})
    (folder / "note.txt").write_text("by hand")
    return folder


def test_an_archive_holds_every_file_and_says_what_it_is(study, tmp_path):
    (tmp_path / "own.toml").write_text("name = 'own'")
    path = write_archive(study, tmp_path / "out" / "study.zip", [tmp_path / "own.toml"])
    with zipfile.ZipFile(path) as archive:
        manifest = json.loads(archive.read(MANIFEST))
        names = {"study/a/one.mcap", "study/two.mcap", "study/note.txt", "own.toml"}
        assert set(archive.namelist()) == names | {MANIFEST}
        for name, digest in manifest["files"].items():
            assert hashlib.sha256(archive.read(name)).hexdigest() == digest
        assert archive.read("study/two.mcap") == (study / "two.mcap").read_bytes()
    assert manifest["trials"] == {"study/a/one.mcap": 3, "study/two.mcap": 2}
    assert "numpy" in manifest["installed"]


def test_equal_inputs_give_equal_bytes(study, tmp_path):
    first = write_archive(study, tmp_path / "a.zip").read_bytes()
    assert first == write_archive(study, tmp_path / "b.zip").read_bytes()


def test_a_damaged_log_is_named_and_nothing_is_written(study, tmp_path):
    log = study / "two.mcap"
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 255
    log.write_bytes(data)
    with pytest.raises(LogCorruptError, match=r"two.mcap is damaged"):
        write_archive(study, tmp_path / "study.zip")
    assert not (tmp_path / "study.zip").exists()


def test_two_files_of_one_name_are_refused(study, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "own.toml").write_text(name)
    with pytest.raises(LogError, match=r"would both be own.toml"):
        write_archive(study, tmp_path / "s.zip", [tmp_path / n / "own.toml" for n in ("a", "b")])
    with pytest.raises(LogError, match="There is no"):
        write_archive(study, tmp_path / "s.zip", [tmp_path / "nothing"])
