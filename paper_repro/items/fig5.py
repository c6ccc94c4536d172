"""Fig. 5: the transition diagrams of the three data sets, and the states of their MOMDPs."""

import numpy as np

from meal_bayes import Query, build_momdp, load_domain
from meal_bayes.domain import Domain
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.statements import THEIRS, Evidence, constructed

NUMBERS = {"ispy32": (2, 3), "cy101": (1, 2), "roc36": (2, 3)}


def run(setting: Setting) -> Result:
    """Draw the paper's diagrams and the published code's; count states."""
    paper = paper_values("fig5")
    evidence: dict[str, Evidence | None] = {}
    rows: list[tuple[Cell, ...]] = []
    for name, numbers in NUMBERS.items():
        domain = load_domain(name)
        for n in numbers:
            printed = paper[name].get(str(n))
            states = states_of(domain, n)
            rows.append((name, n, printed, states))
            if printed is not None:
                text = f"{name}: {printed} states at {n} attributes"
                evidence[text] = constructed(f"our MOMDP has {states}")
        text = f"{name}: behaviors succeed with .95, look always"
        evidence[text] = constructed("the domain table holds the paper's number")
    return Result(
        title="Transition diagrams and the number of states",
        sentence="The MOMDPs have "
        + ", ".join(f"{row[3]} states ({row[0]}, {row[1]})" for row in rows if row[2])
        + ", as printed.",
        tables=(Table("states", ("data set", "attributes", "paper", "ours"), tuple(rows)),),
        evidence={THEIRS: evidence},
        notes=(
            "A state is an observed x and the attributes' values; `term` is one state. A dash: "
            "the text prints no number. Behaviors that are not drawn at a state are illegal "
            "there and end the trial; in the published code's ROC36 they change nothing.",
        ),
        shows="The paper draws the diagrams of the three data sets; the published code's, where "
        "success probabilities differ, are beside them.",
    )


def states_of(domain: Domain, n: int) -> int:
    """Count the states of a query's MOMDP, which depend on its length alone."""
    even = np.full((n, len(domain.behaviors), 2, 2), 0.5)
    return build_momdp(domain, Query(domain.attributes[:n]), even).n_states
