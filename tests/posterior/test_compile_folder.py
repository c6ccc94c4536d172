"""Where PyTensor compiles: in the user's own cache, never in a folder that anybody can fill."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from meal_bayes import posterior

ROOT = Path(posterior.__file__).resolve().parents[2]
CODE = "import meal_bayes.posterior.hierarchical as h; print(h.config.base_compiledir)"


@pytest.mark.long
@pytest.mark.parametrize("home", ["cache", "/dev/null/none"])
def test_the_compile_folder_is_the_users_own(tmp_path, home):
    shared = tmp_path / "tmp"
    shared.mkdir()
    cache = tmp_path / home
    environment = {
        **os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(shared), "HOME": str(cache),
        "XDG_CACHE_HOME": str(cache), "XDG_CONFIG_HOME": str(tmp_path / "config"),
    }  # fmt: skip
    for name in ("PYTENSOR_FLAGS", "MEAL_BAYES_CACHE_WARNED"):
        environment.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    folder = Path(done.stdout.strip())
    if home == "cache":
        assert folder == cache / "meal_bayes" / "pytensor"
        assert folder.stat().st_mode & 0o777 == 0o700
    else:  # one of the process's own, with a name that nobody can guess
        assert folder.parent == shared
        assert folder.name.startswith("meal_bayes-pytensor-")
        assert not folder.exists()
