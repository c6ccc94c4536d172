"""Where runs lie: logs/<experiment>/<agent>/<unit>.mcap; a unit is done when its file is sound.

The name of a run has a digest of all that it depends on: the settings, the code of the package (its
files, so that every commit and every edit is another version), and the versions of the libraries.
Agents of the user's own count by their settings and by the `key` that the user gives: nobody can
see whether a user's code is the same as before. Without a key no trial of theirs is reused.
"""

import dataclasses
import logging
import uuid
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import joblib

from meal_bayes.agents import AGENTS, Agent
from meal_bayes.digests import digest_of
from meal_bayes.errors import LogError
from meal_bayes.experiments.parallel import environment
from meal_bayes.files import checked_path, file_name
from meal_bayes.trial_log import log_info

if TYPE_CHECKING:
    from meal_bayes.experiments.config import OfflineConfig, OnlineConfig

log = logging.getLogger("meal_bayes.experiments")

_LONGEST = 200  # bytes of a folder's name


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
    else's. Facts stand beside the settings; those to ignore are the ones that only say how much of
    the same is run. Shipped agents are no settings of it, as each has a folder of its own in it.
    """
    own = {agent.name: agent_digest(agent, config.key) for agent in config.agents}
    own = {name: digest for name, digest in own.items() if digest}
    ignored = {"key", *ignore}  # a key is in the digest of the agents that need one
    settings = {name: value for name, value in config.as_dict().items() if name not in ignored}
    digest = digest_of({**settings, "agents": own, **facts}, environment())
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


def agent_digest(agent: Agent, key: str) -> str:
    """Return what names an agent's trials beside its name: "" for an agent that ships.

    An agent of the package's own parts and plain values is named by its settings, any other by its
    settings and the key. Where there is no key, or the settings have no value that can be told
    again (a function in a function, an open file), the digest is another one at every call.
    """
    if agent == AGENTS.get(agent.name):
        return ""
    why = "its code may have changed; name the code by a key (--key, `key` of the config)"
    if key or _is_of_package(agent):
        try:
            return digest_of(joblib.hash(agent, "sha1"), key)
        except Exception as fault:  # whatever an object raises that has no value
            why = str(fault)
    log.warning(
        "a later run cannot recognize agent %r: this run gets a new folder, and no earlier trial "
        "is reused (%s)",
        agent.name,
        why,
    )
    return uuid.uuid4().hex


def _is_of_package(value: Any) -> bool:
    """Return whether a value consists of plain values and of what the package defines."""
    if value is None or type(value) in (bool, int, float, str):
        return True
    if type(value) is tuple:
        return all(map(_is_of_package, value))
    if type(value) is partial:
        return all(map(_is_of_package, (value.func, value.args, *value.keywords.values())))
    defined = value if hasattr(value, "__qualname__") else type(value)  # a function or class itself
    if not str(defined.__module__).startswith("meal_bayes."):
        return False
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return defined is value and "<" not in value.__qualname__  # as <locals> and <lambda>
    return all(_is_of_package(getattr(value, field.name)) for field in dataclasses.fields(value))
