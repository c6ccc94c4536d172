"""The reference models: query problems on ROC36 with noisy rates, which other solvers have solved.

Their transition diagram is their own: five x, loops that never fail, illegal behaviors end the
trial. They do not ship with the package; a folder holds `planner_reference.json`.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram
from meal_bayes.errors import DataError, DomainError, QueryError, SettingsError
from meal_bayes.momdp.build import Objective, build_momdp
from meal_bayes.momdp.model import MOMDP
from meal_bayes.untrusted import JSON_LIMIT, read_bytes, read_json

_FILE = "planner_reference.json"
_VARIABLE = "MEAL_BAYES_REFERENCE"
_NAMES = 1000  # models, or behaviors of one, at most
_READ_AS = {  # what the file says in words, and this module takes for granted
    "prior": "uniform, independent",
    "illegal": "ends the episode with the behavior's cost and no report",
    "failure": "x unchanged, no percept; x always observed",
}


def reference_folder(folder: str | Path | None = None) -> Path:
    """Find the folder of the reference models: the given one, or `MEAL_BAYES_REFERENCE`.

    Raises
    ------
    SettingsError : no folder is named, or it does not hold the models.
    """
    named = folder or os.environ.get(_VARIABLE)
    if not named:
        raise SettingsError(
            f"The reference models do not ship with the package; name the folder of {_FILE} "
            f"(--reference DIR, or the environment variable {_VARIABLE})."
        )
    if not (Path(named) / _FILE).is_file():
        raise SettingsError(f"No {_FILE} in {named}; name the folder that holds it.")
    return Path(named)


def load_reference(folder: str | Path | None = None) -> dict[str, MOMDP]:
    """Load the reference models by name, "A1" (one attribute) to "A5".

    Parameters
    ----------
    folder : of `planner_reference.json`; by default what `MEAL_BAYES_REFERENCE` says.

    Raises
    ------
    SettingsError : no such folder.
    DataError : a file that does not hold what its layout promises.
    """
    path = reference_folder(folder) / _FILE
    try:
        models = read_json(read_bytes(path, JSON_LIMIT))["models"]  # type: ignore[index]  # caught
        return {str(model["model"]): _model(model) for model in models[:_NAMES]}
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise DataError(f"{path} is not laid out as expected ({error!r}).") from error
    except (DomainError, QueryError, SettingsError) as error:
        raise DataError(f"{path}: {error}") from error


def _model(model: dict[str, Any]) -> MOMDP:
    for key, text in _READ_AS.items():
        if model[key] != text:
            raise DomainError(f"{key} is {model[key]!r}; expected {text!r}.")
    rows = model["behaviors"][:_NAMES]
    states = sorted({row[end] for row in rows for end in ("source", "target")})
    domain = Domain(
        name=model["model"],
        attributes=tuple(model["attributes"]),
        behaviors=tuple(
            Behavior(row["behavior"], float(row["cost_s"]), ("all",) if row["informative"] else ())
            for row in rows
        ),
        diagram=TransitionDiagram(
            states=(*states, "term"),
            start=states[0],
            effects=tuple(
                Effect(row["source"], row["behavior"], row["target"], float(row["success"]))
                for row in rows
            ),
        ),
    )
    n = len(domain.attributes)
    confusion = np.full((n, len(rows), 2, 2), 0.5)
    for e, row in enumerate(rows):
        if row["informative"]:
            yes = np.array([row["false_positive_rate"], row["true_positive_rate"]], dtype=float)
            confusion[:, e] = np.stack([1 - yes, yes], axis=-1).transpose(1, 0, 2)
    return build_momdp(
        domain,
        Query(domain.attributes),
        confusion,
        objective=Objective(
            correct=float(model["correct"]),
            incorrect=float(model["incorrect"]),
            discount=float(model["discount"]),
            abstain=True,
        ),
    )
