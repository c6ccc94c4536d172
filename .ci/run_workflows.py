"""Run the steps of the published workflows here, as a runner would, from a bare clone.

python .ci/run_workflows.py                 jobs `build` (of the site) and `fast`, this Python
python .ci/run_workflows.py full            the whole CI (half an hour)

Each job has a clone of the last commit with nothing beside it, a home folder of its own and no
variables of this shell but those that find packages. Steps that only GitHub can do are named and
left out, as are those that need its network: `full` takes the recordings of MEAL_BAYES_DATA_URL.
"""

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
# What finds packages and programs; no settings of this shell.
KEPT = re.compile(r"PATH|LANG|TMPDIR|https?_proxy|SSL_CERT_FILE|PIP_(?!CONSTRAINT).*")
DONE_HERE = {
    "actions/checkout": "a clone of the last commit",
    "actions/setup-python": "a virtual environment of this Python",
    "actions/cache": "no cache is found",
}
HERE = f"{sys.version_info[0]}.{sys.version_info[1]}"


def say(text: str) -> None:
    """Print a line at once, between those of the steps."""
    sys.stdout.write(f"-- {text}\n")
    sys.stdout.flush()


def jobs() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the jobs of all workflows, by name."""
    for path in sorted((ROOT / ".github" / "workflows").glob("*.yml")):
        yield from yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].items()


def first_of(matrix: Mapping[str, Any]) -> dict[str, str]:
    """Return the values of a matrix for this Python; the first where it does not name it."""
    rows = matrix.get("include") or [{"python": version} for version in matrix["python"]]
    return next((row for row in rows if row["python"] == HERE), rows[0])


def filled(text: str, values: Mapping[str, str]) -> str:
    """Return a text with its expressions evaluated; an unknown one is a fault of the workflow."""
    return re.sub(r"\$\{\{ *(.+?) *\}\}", lambda match: values[match[1]], text)


def environment(job: Mapping[str, Any], folder: Path, values: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of a job: a runner's, and its own."""
    kept = {name: value for name, value in os.environ.items() if KEPT.fullmatch(name)}
    own = {name: filled(str(value), values) for name, value in job.get("env", {}).items()}
    python = folder / "python" / "bin"
    return {
        **kept,
        "PATH": f"{python}{os.pathsep}{kept['PATH']}",
        "HOME": str(folder / "home"),
        "CI": "true",
        "GITHUB_ACTIONS": "true",
        "RUNNER_TEMP": str(folder / "temporary"),
        **own,
    }


def why_not(command: str) -> str:
    """Return why a command cannot be run here; "" where it can."""
    if "data fetch" in command:
        return "it downloads the recordings"
    if command.startswith("sudo ") and os.environ.get("CI") != "true":
        return "it installs packages of the system"
    return ""


def run_job(name: str, job: Mapping[str, Any], folder: Path) -> bool:
    """Run a job's steps in order; return whether all that were run passed."""
    clone = folder / "work"
    subprocess.run(["git", "clone", "--quiet", "--no-local", ROOT, clone], check=True)
    subprocess.run([sys.executable, "-m", "venv", folder / "python"], check=True)
    for part in ("home", "temporary"):
        (folder / part).mkdir()
    matrix = first_of(job["strategy"]["matrix"]) if "strategy" in job else {}
    pinned = f"{clone}/constraints.txt"
    values = {
        "github.workspace": str(clone),
        "github.event_name != 'schedule' && format('{0}/constraints.txt', github.workspace) || ''":
            pinned,
        "runner.temp": str(folder / "temporary"),
        **{f"matrix.{key}": value for key, value in matrix.items()},
    }  # fmt: skip
    variables = environment(job, folder, values)
    if "MEAL_BAYES_DATA_URL" in os.environ:
        (folder / "home" / "recordings").symlink_to(os.environ["MEAL_BAYES_DATA_URL"])
    for step in job["steps"]:
        action = step.get("uses", "").partition("@")[0]
        if action:
            say(f"{name}: {action}: {DONE_HERE.get(action, 'left out, as GitHub alone has it')}")
            continue
        command = filled(step["run"], values).strip()
        if reason := why_not(command):
            say(f"{name}: left out, as {reason}: {command.splitlines()[0]}")
            continue
        say(f"{name}: {command}")
        own = {key: filled(str(value), values) for key, value in step.get("env", {}).items()}
        shell = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", command]
        if subprocess.run(shell, cwd=clone, env={**variables, **own}, check=False).returncode:
            say(f"{name}: failed: {command}")
            return False
    return True


def main() -> int:
    """Run the jobs that the command line names; return the exit code."""
    workflows = dict(jobs())
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("job", nargs="*", help=f"one of {', '.join(workflows)}")
    names = parser.parse_args().job or ["build", "fast"]
    if unknown := set(names) - workflows.keys():
        parser.error(f"no job {', '.join(unknown)}; there are {', '.join(workflows)}")
    passed = True
    for name in names:
        with TemporaryDirectory(prefix="workflow-") as folder:
            passed &= run_job(name, workflows[name], Path(folder))
    say("all passed" if passed else "failed")
    return not passed


if __name__ == "__main__":
    sys.exit(main())
