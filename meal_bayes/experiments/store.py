"""Where runs lie: logs/<experiment>/<agent>/<unit>.mcap; a unit is done when its file is sound.

The name of a run has a digest of all that it depends on: the settings, the code of the package (its
files, so that a changed working tree is another version), and the versions of the libraries. For an
agent that does not ship with the package, its settings and the files of the user's imported modules
count too. A trial is reused only where it is known to be the agent's own.
"""

import logging
import platform
import sys
import uuid
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import cloudpickle
import joblib

from meal_bayes.agents import AGENTS, Agent
from meal_bayes.digests import checksum_of, code_digest, digest_of
from meal_bayes.errors import LogError
from meal_bayes.files import checked_path, file_name
from meal_bayes.trial_log import log_info

if TYPE_CHECKING:
    from meal_bayes.experiments.config import OfflineConfig, OnlineConfig

log = logging.getLogger("meal_bayes.experiments")

_INSTALLED = {"site-packages", "dist-packages"}  # folders of pip's and of the system's
_LONGEST = 200  # bytes of a folder's name
_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn")  # whose versions may change a number


def run_folder(
    root: str | Path,
    name: str,
    config: "OfflineConfig | OnlineConfig",
    *,
    ignore: tuple[str, ...] = (),
    **facts: object,
) -> Path:
    """Name the folder of an experiment under `root` by any text, its settings and its code.

    It changes with either, so a run that is called again finds its own units, whole, and nobody
    else's. Agents name folders in it: of them the user's code counts alone. Facts stand beside the
    settings; those to ignore are the ones that only say how much of the same is run.
    """
    sources = {agent.name: own_agent_digest(agent) for agent in config.agents}
    sources = {name: digest for name, digest in sources.items() if digest}
    settings = {name: value for name, value in config.as_dict().items() if name not in ignore}
    digest = digest_of({**settings, "agents": sources, **facts}, environment())
    return checked_path("logs", root) / f"{file_name(name, _LONGEST)}-{digest[:8]}"


def agent_folder(folder: Path, agent: str) -> Path:
    """Return where the logs of an agent lie in the folder of a run."""
    return folder / file_name(agent, _LONGEST)


def is_finished(path: Path) -> bool:
    """Check a unit's log to its end; what is damaged is warned of."""
    try:
        return path.is_file() and log_info(path).whole
    except LogError as fault:
        log.warning("%s; it is made again", str(fault).partition(";")[0])
        return False


def environment() -> dict[str, str]:
    """Return what may change a number beside settings: the package's code, and versions."""
    versions = {name: metadata.version(name) for name in _LIBRARIES}
    python = {"python": platform.python_version(), "system": sys.platform}
    return {"meal_bayes": code_digest(), **python, **versions}


def is_own(module: ModuleType) -> bool:
    """Return whether a module is the user's: it has a file, and is neither installed nor ours."""
    file = getattr(module, "__file__", None)
    if file is None or module.__name__ not in sys.modules or _INSTALLED & {*Path(file).parts}:
        return False
    return module.__name__.partition(".")[0] not in {"meal_bayes", *sys.stdlib_module_names}


def own_modules() -> list[ModuleType]:
    """Return the imported modules that are the user's."""
    return [module for module in [*sys.modules.values()] if is_own(module)]


def own_agent_digest(agent: Agent) -> str:
    """Compute a digest of an agent's settings and of the user's code.

    The code is the files of all modules of the user's that are imported now, whether the agent
    needs them or not: an edit of any of them is another run. The digest is "" for an agent that
    ships with the package. It is different at every call for an agent that holds something without
    a name or value, such as a local function, a class of a notebook or an open file: then nobody
    can know whether the agent is the same as before, and no trial is reused. What a program assigns
    to a class or a module after the import is not seen. Use sets, not frozensets, in
    settings: the order of a frozenset of texts differs from process to process.
    """
    if agent == AGENTS.get(agent.name):
        return ""
    try:
        # The code of an interactive session is in no file; this pickle holds it by value.
        if not hasattr(sys.modules["__main__"], "__file__") and (
            b"__main__" in cloudpickle.dumps(agent)
        ):
            return _unrecognized(agent, "it is defined in an interactive session")
        settings = joblib.hash(agent, "sha1")
        code = sorted(checksum_of(Path(str(module.__file__))) for module in own_modules())
    except Exception as why:  # whatever an object raises that has no value
        return _unrecognized(agent, why)
    return digest_of(settings, code)[:16]


def _unrecognized(agent: Agent, why: object) -> str:
    """Return a digest that no other agent has."""
    log.warning(
        "agent %r cannot be recognized in a later run (%s): this run has a folder of its own, "
        "and no earlier trial is reused; define the agent in a module",
        agent.name,
        why,
    )
    return uuid.uuid4().hex
