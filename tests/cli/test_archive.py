"""`archive`: one file of a study, with the checksum that two people compare."""

import hashlib
from pathlib import Path


def test_the_checksum_is_that_of_the_file(run, fails):
    run("run", "offline", "--trials", "4", "--agent", "prior", "--logs", "study")
    told = run("archive", "study", "out/study.zip")
    assert told.exit_code == 0
    assert hashlib.sha256(Path("out/study.zip").read_bytes()).hexdigest() in told.stdout
    assert "ends in .zip" in fails("archive", "study", "study.tar")
    Path("empty").mkdir()
    assert "no log" in fails("archive", "empty", "study.zip")
