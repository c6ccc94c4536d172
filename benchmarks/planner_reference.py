"""The reference models: query problems on ROC36 with noisy rates, which other solvers have solved.

Their transition diagram is their own: five x, loops that never fail, illegal behaviors end the
trial, at the behavior's cost. That is how other solvers abstain in them; here it costs nothing. A
folder (`--reference`, or `MEAL_BAYES_REFERENCE`) holds `planner_reference.json`.
"""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram
from meal_bayes.momdp import MOMDP, Objective, build_momdp


def load_reference(folder: str | Path | None = None) -> dict[str, MOMDP]:
    """Load the reference models by name, "A1" (one attribute) to "A5"."""
    named = folder or os.environ.get("MEAL_BAYES_REFERENCE")
    if not named:
        raise SystemExit("name the folder of planner_reference.json: --reference DIR")
    text = (Path(named) / "planner_reference.json").read_text(encoding="utf-8")
    return {str(model["model"]): build_model(model) for model in json.loads(text)["models"]}


def build_model(model: dict[str, Any]) -> MOMDP:
    """Build the MOMDP of one model, as the file describes it."""
    rows = model["behaviors"]
    states = sorted({row[end] for row in rows for end in ("source", "target")})
    domain = Domain(
        name=model["model"],
        attributes=tuple(model["attributes"]),
        behaviors=tuple(
            Behavior(row["behavior"], row["cost_s"], ("all",) if row["informative"] else ())
            for row in rows
        ),
        diagram=TransitionDiagram(
            states=(*states, "term"),
            start=states[0],
            effects=tuple(
                Effect(row["source"], row["behavior"], row["target"], row["success"])
                for row in rows
            ),
        ),
    )
    confusion = np.full((len(domain.attributes), len(rows), 2, 2), 0.5)
    for e, row in enumerate(rows):
        if row["informative"]:
            yes = np.array([row["false_positive_rate"], row["true_positive_rate"]])  # (2,N)
            confusion[:, e] = np.stack([1 - yes, yes], axis=-1).transpose(1, 0, 2)
    objective = Objective(model["correct"], model["incorrect"], model["discount"], abstain=True)
    return build_momdp(domain, Query(domain.attributes), confusion, objective=objective)
