"""A learner in one file: a zip of JSON and arrays, which nothing in it can make execute.

`learner.json` holds settings; the experience is an array a table of it. What agents made of it, or
the percept table that is replayed, is a tree of dataclasses and named tuples over arrays: each is
written as its name and its fields, and only the classes that are listed here are read back.
Classifiers of one's own could only be pickled: they are fitted again to what they were fitted to,
with equal results where they are deterministic.

A file has an id, and that of the file which its learner read or wrote before: whoever saves does
not write over what somebody else has saved there.
"""

import json
import secrets
import zipfile
from dataclasses import asdict, dataclass, fields
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from meal_bayes.agents import Agent, as_agent
from meal_bayes.agents.named import AGENTS
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import domain_from_table, domain_table
from meal_bayes.errors import DataError, MealBayesError, OutputError, SettingsError
from meal_bayes.files import alone_in, draft_of
from meal_bayes.learner.digest import agent_digest
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fit import training_agent
from meal_bayes.learner.online import Online
from meal_bayes.learner.packing import pack, unpack
from meal_bayes.learner.question import QuestionCounts
from meal_bayes.learner.saved_experience import (
    read_experience,
    read_features,
    write_experience,
    write_features,
)
from meal_bayes.learner.saved_fit import fit_of, state_of
from meal_bayes.learner.settings import LearnerSettings, check_data, own_posterior
from meal_bayes.untrusted import UNREADABLE, read_array, read_member, read_meta, write_array

_FORMAT = 15
_TEXT = "learner.json"


@dataclass(frozen=True, slots=True)
class SavedLearner:
    """All that a learner is: record, settings, and what agents in use made of the record."""

    agent: Agent
    settings: LearnerSettings
    experience: Experience
    table: PerceptTable | None
    fitted: list[Online]
    questions: QuestionCounts
    file: str  # id of the file


def write_learner(learner: SavedLearner, path: Path, *, overwrite: bool) -> str:
    """Write a learner; the file is there whole or not at all. Return its new id.

    `learner.file` is the id of the file that it read or wrote last: only that is written over.
    """
    settings = learner.settings
    experience = learner.experience
    file = secrets.token_hex(8)
    with (
        alone_in(path.parent),
        draft_of(path, expected=True) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        if not overwrite:
            _refuse_what_others_saved(path, learner.file)
        numbers = count()

        def keep(values: NDArray[Any]) -> str:
            name = f"fitted/{next(numbers)}"
            write_array(archive, name, values)
            return name

        classifier = settings.classifier
        written = {field.name: getattr(settings, field.name) for field in fields(settings)}
        fitted = [
            {
                "agent": fit.agent.name,
                "digest": agent_digest(fit.agent),
                "state": pack(state_of(fit, with_perception=classifier is None), keep),
            }
            for fit in learner.fitted
        ]
        meta: dict[str, Any] = {
            "format": _FORMAT,
            "file": file,
            "parent": learner.file,
            "domain": domain_table(experience.domain),
            "agent": learner.agent.name,
            "digest": agent_digest(learner.agent),
            "classifier": None if classifier is None else type(classifier).__name__,
            "settings": pack({**written, "classifier": None}, keep),
            "questions": asdict(learner.questions),
            "fitted": fitted,
            "table": pack(learner.table, keep),
            "features": write_features(experience, keep),
        }
        write_experience(archive, experience)
        # Last, as it names the arrays that were kept.
        archive.writestr(_TEXT, json.dumps(meta, allow_nan=False))
    return file


def read_learner(path: Path, *, agent: object, classifier: object) -> SavedLearner:
    """Read a learner; raise as `Learner.load` does."""
    if not path.is_file():
        raise DataError(f"No file {path}; give the path of a learner that save() wrote.")
    try:
        with zipfile.ZipFile(path) as archive:
            read = partial(read_array, archive)
            meta = read_meta(read_member(archive, _TEXT), _FORMAT)
            domain = domain_from_table(meta["domain"])
            settings = unpack(meta["settings"], read, domain)
            table = unpack(meta["table"], read, domain)
            chosen = _agent(meta, agent, classifier)
            own_posterior(settings["posterior"], domain, chosen)
            settings = LearnerSettings(**{**settings, "classifier": classifier})
            experience = read_experience(archive, domain)
            read_features(meta["features"], read, experience)
            if table is not None:
                check_data(table, domain)
            fitted = []
            for entry in meta["fitted"]:
                fit_agent = _known(entry, chosen)
                if fit_agent is not None:  # else it is made anew when it is asked
                    state = unpack(entry["state"], read, domain)
                    fitted.append(fit_of(experience, fit_agent, settings, state))
            return SavedLearner(
                agent=chosen,
                settings=settings,
                experience=experience,
                table=table,
                fitted=fitted,
                questions=QuestionCounts(**meta["questions"]),
                file=str(meta["file"]),
            )
    except SettingsError:
        raise
    except (*UNREADABLE, MealBayesError) as fault:
        raise DataError(
            f"{path} is not a whole learner ({fault}); save it again, or fit a new one."
        ) from fault
    except OSError as fault:
        raise DataError(f"{path} cannot be read: {fault}.") from fault


def _refuse_what_others_saved(path: Path, file: str) -> None:
    """Refuse to write over a file that this learner neither wrote nor read last."""
    if not path.exists():
        return
    content = "no learner"
    try:
        with zipfile.ZipFile(path) as archive:
            content = f"the learner {read_meta(read_member(archive, _TEXT), _FORMAT)['file']}"
    except (*UNREADABLE, OSError):
        pass
    if content != f"the learner {file}":
        history = f"read or wrote {file} last" if file else "has read and written no file"
        raise OutputError(
            f"{path} holds {content}, and this one {history}: somebody else has saved there. "
            "Load it and tell it what is missing, give another name, or save(path, overwrite=True)."
        )


def _agent(meta: dict[str, Any], agent: object, classifier: object) -> Agent:
    """Return who decides; raise where what the file does not hold was not given again."""
    if (classifier is None) != (meta["classifier"] is None):
        raise SettingsError(
            f"The learner perceives by {meta['classifier'] or 'our own classifiers'}; give the "
            "same as load(path, classifier=...)."
        )
    if agent is not None:
        return as_agent(agent)
    name = str(meta["agent"])
    if name not in AGENTS:
        raise SettingsError(
            f"The learner's agent {name!r} is not one of the shipped ones; give it as "
            "load(path, agent=...)."
        )
    if meta["digest"] != agent_digest(AGENTS[name]):
        raise SettingsError(
            f"The learner's agent {name!r} is not the shipped one of that name; give it as "
            "load(path, agent=...)."
        )
    return AGENTS[name]


def _known(entry: dict[str, Any], chosen: Agent) -> Agent | None:
    """Return the agent whose state an entry is, if it is known; it may be nobody's any more."""
    for agent in (chosen, training_agent(chosen), AGENTS.get(str(entry["agent"]))):
        if agent is not None and agent_digest(agent) == entry["digest"]:
            return agent
    return None
