"""The problems of `planner.py`, by name.

- `A1` .. `A5`: the reference models (one to five attributes, noisy rates), which other solvers have
  solved, from `tests/planners/planner_reference.json`, with what they reached.
  Their transition diagram is their own: five x, loops that never fail, illegal behaviors end the
  trial, at the behavior's cost. That is how other solvers abstain in them; here it costs nothing.
- `clean1` .. `clean5`: the same questions, asked of our own ROC36 perception: shipped tables,
  learned without the first object; r+ = -r- = 500, uniform prior, Eq. 8.
- `A1-precision1` .. `A3-precision5`: A1 to A3 in worlds where every object has rows of its own
  (Dirichlet of precision 1, 3, 5).
- `random7-3`, `noisy7-3`: random problems that nobody tuned for: seed 7, three attributes; not in
  `MODELS`. Each seed draws five problems (one to five attributes), each with a diagram, costs,
  success probabilities and rates of its own: a chain of x, loops that perceive, ways back. Percepts
  of `noisy7-3` say little, so that good plans are long.
- `ring7-10x30`: a problem drawn as in `costs.py`, of seed 7: ten attributes, thirty
  behaviors, six states; not in `MODELS`.
- `ispy32-10`, `-20`, `-81`: ISPY32's first 10, 20 attributes that experiments ask, and all; tables
  as above; all but the first two are known before; nobody to ask.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram, load_domain
from meal_bayes.momdp import MOMDP, Objective, build_momdp

REFERENCE = Path(__file__).resolve().parents[1] / "tests/planners/planner_reference.json"
ASKED = ("heavy", "blue", "beans", "green", "glass")  # the first N of them, as in A1 .. A5
PRECISIONS = (1, 3, 5)
LARGE = (10, 20, 81)
RING_STATES = 6
RELEVANT = 2  # attributes of a large query that are not known before

NOISY = tuple(f"A{n}" for n in range(1, 6))
MODELS = (
    *NOISY,
    *(f"clean{n}" for n in range(1, 6)),
    *(f"A{n}-precision{s}" for n in range(1, 4) for s in PRECISIONS),
    *(f"ispy32-{n}" for n in LARGE),
)


@lru_cache(maxsize=1)
def momdp_of(model: str) -> MOMDP:
    """Build a model's MOMDP by name."""
    ring = _RING.fullmatch(model)
    if ring is not None:
        from costs import problem  # noqa: PLC0415  small processes plan without

        seed, n, behaviors = map(int, ring.groups())
        drawn = problem(behaviors, RING_STATES, seed, attributes=n)
        return replace(drawn, abstain=True, discount=0.99)
    if attributes_of(model) is not None:
        return random_momdp(model)
    kind, _, rest = model.partition("-")
    if kind == "ispy32":
        momdp = _learned("ispy32", _large_query(int(rest)))
        return replace(momdp, prior=np.where(np.arange(len(momdp.query)) < RELEVANT, 0.5, 0.0))
    if kind.startswith("clean"):
        return _learned("roc36", ASKED[: int(kind.removeprefix("clean"))])
    momdp = load_reference()[kind]
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
    domain = _unasked(table.domain)
    query = Query(tuple(asked))
    behaviors = [table.domain.behavior_names.index(name) for name in domain.behavior_names]
    return build_momdp(
        domain,
        query,
        confusion[:, behaviors],
        precision[:, behaviors],
        objective=Objective(correct=500, incorrect=-500, abstain=True),
    )


def _unasked(domain: Domain) -> Domain:
    """Leave out behaviors that answer for themselves: one settles any additive query at once."""
    behaviors = tuple(behavior for behavior in domain.behaviors if behavior.answer_accuracy is None)
    names = {behavior.name for behavior in behaviors}
    effects = tuple(effect for effect in domain.diagram.effects if effect.behavior in names)
    diagram = replace(domain.diagram, effects=effects)
    sequence = tuple(name for name in domain.predefined if name in names)
    return replace(domain, behaviors=behaviors, diagram=diagram, predefined=sequence)


def _large_query(n: int) -> tuple[str, ...]:
    from meal_bayes.datasets import load_percepts  # noqa: PLC0415
    from meal_bayes.experiments import askable  # noqa: PLC0415

    names = load_domain("ispy32").attributes
    asked = askable(load_percepts("ispy32"))
    return (*asked, *(name for name in names if name not in asked))[:n]


def load_reference() -> dict[str, MOMDP]:
    """Load the reference models by name, "A1" (one attribute) to "A5"."""
    models = json.loads(REFERENCE.read_text(encoding="utf-8"))["models"]
    return {str(model["model"]): build_model(model) for model in models}


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


ATTRIBUTES = 5
_NAME = re.compile(r"(random|noisy)(\d+)-([1-5])")
_RING = re.compile(r"ring(\d+)-(\d+)x(\d+)")


def names_of(seed: int, *, noisy: bool) -> list[str]:
    """Return the names of a seed's problems."""
    return [f"{'noisy' if noisy else 'random'}{seed}-{n}" for n in range(1, ATTRIBUTES + 1)]


def attributes_of(model: str) -> int | None:
    """Return how many attributes a random problem has; None for the name of any other."""
    match = _NAME.fullmatch(model)
    if match is not None:
        return int(match[3])
    ring = _RING.fullmatch(model)
    return None if ring is None else int(ring[2])


def random_momdp(model: str) -> MOMDP:
    """Build a random problem by name."""
    match = _NAME.fullmatch(model)
    if match is None:
        raise SystemExit(f"{model!r} names no random problem; write random7-3 or noisy7-3")
    return _drawn(int(match[2]), match[1] == "noisy")[int(match[3]) - 1]


@lru_cache(maxsize=1)
def _drawn(seed: int, noisy: bool) -> list[MOMDP]:
    rng = np.random.default_rng([seed, noisy])
    return [build_model(_problem(n, noisy, rng)) for n in range(1, ATTRIBUTES + 1)]


def _rates(n: int, noisy: bool, rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """Draw true and false positive rates (n,) of one behavior."""
    true = []
    false = []
    for _ in range(n):
        if rng.random() < 0.55:  # it says something of the attribute
            apart = rng.beta(1.2, 4.0 if noisy else 1.5)
            middle = rng.uniform(0.15, 0.85)
            true.append(min(0.97, middle + apart * (1 - middle)))
            false.append(max(0.03, middle - apart * middle))
        else:
            rate = rng.uniform(0.05, 0.3)
            true.append(min(0.97, rate * rng.uniform(0.9, 1.1)))
            false.append(rate)
    return true, false


def _problem(n: int, noisy: bool, rng: np.random.Generator) -> dict[str, Any]:
    """Draw one problem, in the words of the reference models."""
    size = int(rng.integers(4, 8))
    behaviors = list[dict[str, Any]]()
    even = np.full(n, 0.5).tolist()  # rates of a behavior that tells nothing

    def add(source: int, target: int, cost: float, success: float, senses: bool) -> None:
        true, false = _rates(n, noisy, rng) if senses else (even, even)
        behaviors.append(
            {
                "behavior": f"b{len(behaviors)}",
                "source": f"x{source}",
                "target": f"x{target}",
                "success": float(success),
                "cost_s": round(float(cost), 2),
                "informative": bool(senses),
                "true_positive_rate": true,
                "false_positive_rate": false,
            }
        )

    # A way from the first state to the last, loops that sense, ways back, and the way to the start.
    for i in range(size - 1):
        cost = rng.lognormal(1.0, 0.8)
        success = rng.choice([1.0, 0.95, 0.9, 0.8])
        add(i, i + 1, cost, success, rng.random() < 0.8)
    for i in range(size):
        for _ in range(int(rng.integers(0, 3))):
            add(i, i, rng.lognormal(1.2, 0.9), rng.choice([1.0, 0.95]), True)
    for i in range(2, size):
        if rng.random() < 0.5:
            target = int(rng.integers(0, i))
            cost = rng.lognormal(1.3, 0.8)
            add(i, target, cost, rng.choice([1.0, 0.95]), rng.random() < 0.5)
    add(size - 1, 0, rng.lognormal(1.3, 0.8), 1.0, False)
    return {
        "model": f"A{n}",
        "attributes": [f"q{i}" for i in range(n)],
        "discount": 0.99,
        "correct": 500,
        "incorrect": -500,
        "behaviors": behaviors,
    }
