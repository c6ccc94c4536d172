"""The problems of `planner.py`, by name.

- `A1` .. `A5`: the reference models (one to five attributes, noisy rates; `--reference DIR`).
- `clean1` .. `clean5`: the same questions, asked of our own ROC36 perception: shipped tables,
  learned without the first object; r+ = -r- = 500, uniform prior, Eq. 8.
- `A1-precision1` .. `A3-precision5`: A1 to A3 in worlds where every object has rows of its own
  (Dirichlet of precision 1, 3, 5).
- `random7-3`, `noisy7-3`: random problems (`planner_random.py`); not in `MODELS`.
- `ispy32-10`, `-20`, `-81`: ISPY32's first 10, 20 attributes that experiments ask, and all; tables
  as above; all but the first two are known before; nobody to ask.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from planner_random import attributes_of, random_momdp
from planner_reference import load_reference

from meal_bayes.domain import Domain, Query, load_domain
from meal_bayes.momdp import MOMDP, Objective, build_momdp

ASKED = ("heavy", "blue", "beans", "green", "glass")  # the first N of them, as in A1 .. A5
PRECISIONS = (1, 3, 5)
LARGE = (10, 20, 81)
RELEVANT = 2  # attributes of a large query that are not known before

NOISY = tuple(f"A{n}" for n in range(1, 6))
MODELS = (
    *NOISY,
    *(f"clean{n}" for n in range(1, 6)),
    *(f"A{n}-precision{s}" for n in range(1, 4) for s in PRECISIONS),
    *(f"ispy32-{n}" for n in LARGE),
)


@lru_cache(maxsize=1)
def momdp_of(model: str, reference: str | None) -> MOMDP:
    """Build a model's MOMDP by name."""
    if attributes_of(model) is not None:
        return random_momdp(model)
    kind, _, rest = model.partition("-")
    if kind == "ispy32":
        momdp = _learned("ispy32", _large_query(int(rest)))
        return replace(momdp, prior=np.where(np.arange(len(momdp.query)) < RELEVANT, 0.5, 0.0))
    if kind.startswith("clean"):
        return _learned("roc36", ASKED[: int(kind.removeprefix("clean"))])
    momdp = load_reference(reference)[kind]
    if rest:
        precision = float(rest.removeprefix("precision"))
        momdp = replace(momdp, precision=np.full_like(momdp.precision, precision))
    return momdp


def _learned(dataset: str, asked: Sequence[str]) -> MOMDP:
    """Make the paper's problem from shipped tables, learned without the first object."""
    from meal_bayes.agents import knowledge_without  # noqa: PLC0415  small processes plan without
    from meal_bayes.datasets import load_percepts  # noqa: PLC0415

    table = load_percepts(dataset)
    columns = table.domain.columns(asked)
    posterior = knowledge_without(table, 0, object_level=False).posterior
    confusion, precision = posterior.select(columns, exact=True)
    domain, query = _unasked(table.domain), Query(tuple(asked))
    kept = [table.domain.behavior_names.index(name) for name in domain.behavior_names]
    return build_momdp(
        domain, query, confusion[:, kept], precision[:, kept],
        objective=Objective(correct=500, incorrect=-500, abstain=True),
    )  # fmt: skip


def _unasked(domain: Domain) -> Domain:
    """Leave out behaviors that answer for themselves: one settles any additive query at once."""
    kept = tuple(behavior for behavior in domain.behaviors if behavior.answer_accuracy is None)
    names = {behavior.name for behavior in kept}
    effects = tuple(effect for effect in domain.diagram.effects if effect.behavior in names)
    diagram = replace(domain.diagram, effects=effects)
    sequence = tuple(name for name in domain.predefined if name in names)
    return replace(domain, behaviors=kept, diagram=diagram, predefined=sequence)


def _large_query(n: int) -> tuple[str, ...]:
    from meal_bayes.datasets import load_percepts  # noqa: PLC0415
    from meal_bayes.experiments import askable  # noqa: PLC0415

    names = load_domain("ispy32").attributes
    asked = askable(load_percepts("ispy32"))
    return (*asked, *(name for name in names if name not in asked))[:n]
