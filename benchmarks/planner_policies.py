"""The policies of `planner.py`, by name: ours, baselines, and peers that are installed."""

import importlib.util
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from planner_models import NOISY, attributes_of

from meal_bayes.domain import load_domain
from meal_bayes.planners import POMCP, Greedy, Predefined, RandomLegal, Solver
from meal_bayes.planners.plans.policy import OpenLoop
from meal_bayes.planners.table.policy import Factored

TABLED = 3  # attributes up to which factored value iteration is near the optimum


class Planner(NamedTuple):
    """A policy of the table."""

    policy: str
    budget: str | None = None

    @property
    def name(self) -> str:
        """As `--policies` takes it."""
        return self.policy if self.budget is None else f"{self.policy}:{self.budget}"


SEARCHES = (
    *(Planner("pomcp", budget) for budget in ("1ms", "10ms", "1500 simulations")),
    Planner("pomcp-sampled", "1500 simulations"),
    Planner("pomcp-plans", "1ms"),  # without tables
)
BASELINES = (Planner("greedy"), Planner("predefined_plus"), Planner("random_legal"))
PEERS = {  # and the library of each
    "pomdp-py": "pomdp_py",
    "pymdp": "pymdp",
    "pomdpplanners-pomcp": "POMDPPlanners",
    "pomdpplanners-sparse-pft": "POMDPPlanners",
}
UNTABLED = {"pomdp-py", "pymdp"}  # peers that need no table of all values and percepts
PLANNERS = (  # those that others are compared with come first
    Planner("olfc"),
    Planner("factored"),
    *SEARCHES,
    *BASELINES,
    Planner("sarsop", "5s"),
    *(Planner(peer, "1500 simulations") for peer in PEERS if peer != "pymdp"),
    *(Planner("pymdp", f"{steps} steps") for steps in range(1, 6)),
    *(Planner("pomdp-py", f"{simulations} simulations") for simulations in (150, 15000)),
    Planner("pomdpplanners-pomcp", "15000 simulations"),
)


def planners_for(model: str) -> tuple[Planner, ...]:
    """List the planners that can be run on a model here."""
    absent = set()
    small = re.fullmatch(r"(?:(A|clean)|\w+-)([1-5])", model)
    if small is None or int(small[2]) > TABLED:
        absent |= {"factored", *PEERS} - UNTABLED
    if attributes_of(model) is not None:
        absent.add("predefined_plus")  # a random problem has behaviors of its own
    if small is None or shutil.which(os.environ.get("MEAL_BAYES_POMDPSOL", "pomdpsol")) is None:
        absent.add("sarsop")
    if model not in NOISY and attributes_of(model) is None:
        absent |= set(PEERS)
    absent |= {peer for peer, library in PEERS.items() if importlib.util.find_spec(library) is None}
    return tuple(planner for planner in PLANNERS if planner.policy not in absent)


def solver_of(planner: Planner, model: str) -> Solver:
    """Make the solver."""
    domain = load_domain("ispy32" if model.startswith("ispy32") else "roc36")
    sequence = tuple(name for name in domain.predefined if name != "ask")
    by_policy: dict[str, Callable[[], Solver]] = {
        "olfc": OpenLoop,
        "factored": Factored,
        "pomcp": lambda: _search(str(planner.budget)),
        "pomcp-sampled": lambda: replace(_search(str(planner.budget)), backup="sampled"),
        "pomcp-plans": lambda: replace(_search(str(planner.budget)), points=0),
        "greedy": Greedy,
        "predefined_plus": lambda: Predefined(sequence, persistent=True),
        "random_legal": lambda: RandomLegal(50.0),
        "sarsop": lambda: _sarsop(planner),
        "pomdp-py": lambda: _pomdp_py(planner),
        "pymdp": lambda: _pymdp(planner),
        "pomdpplanners-pomcp": lambda: _pomdpplanners(planner),
        "pomdpplanners-sparse-pft": lambda: _pomdpplanners(planner),
    }
    return by_policy[planner.policy]()


def _number(budget: str | None) -> int:
    return int(str(budget).split(maxsplit=1)[0])


def _search(budget: str) -> POMCP:
    if budget.endswith("ms"):
        return POMCP(milliseconds=float(budget.removesuffix("ms")))
    return POMCP(simulations=_number(budget))


def _sarsop(planner: Planner) -> Solver:
    from paper_repro.sarsop import Sarsop  # noqa: PLC0415  in a checkout of the whole repository

    return Sarsop(seconds=float(str(planner.budget).removesuffix("s")))


def _pomdp_py(planner: Planner) -> Solver:
    from pomdp_py_solver import PomdpPy  # noqa: PLC0415  not everyone has it

    return PomdpPy(_number(planner.budget))


def _pymdp(planner: Planner) -> Solver:
    from pymdp_solver import Pymdp  # noqa: PLC0415  not everyone has it

    return Pymdp(_number(planner.budget))


def _pomdpplanners(planner: Planner) -> Solver:
    from pomdpplanners_solver import PomdpPlanners  # noqa: PLC0415  not everyone has it

    name = planner.policy.removeprefix("pomdpplanners-")
    return PomdpPlanners(name, _number(planner.budget))
