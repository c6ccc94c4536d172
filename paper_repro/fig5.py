"""Fig. 5: the transition diagrams of the three data sets, and the states of their MOMDPs."""

import numpy as np
from frame import Claim, Result, Setting, Table, main, paper_values

from meal_bayes import Query, build_momdp, load_domain
from meal_bayes.domain import Domain
from meal_bayes.evaluation.diagram_plots import transition_diagram

CHANCES = {0.95, 1.0}  # of success: Sect. 7.1, look never fails (and people always answer)


def run(setting: Setting) -> Result:
    """Draw the paper's diagrams and the published code's of ROC36; count states."""
    paper, rows, claims, figures = paper_values("fig5"), [], [], {}
    for name, printed in paper.items():
        domain = load_domain(name)
        figures[f"_{name}"] = transition_diagram(domain.diagram, title=f"{name}, the paper's")
        chances = {effect.probability for effect in domain.diagram.effects}
        for n, states in printed.items():
            found = states_of(domain, int(n))
            rows.append((name, int(n), states, found))
            claims.append(Claim(f"{name}: {states} states at {n} attributes", found == states))
        claims.append(Claim(f"{name}: behaviors succeed with .95, look always", chances <= CHANCES))
    code = load_domain("roc36_published").diagram
    figures["_roc36_published"] = transition_diagram(code, title="roc36, the published code's")
    return Result(
        item="fig5",
        title="Transition diagrams and the number of states",
        paper=", ".join(f"{row[0]} {row[2]}" for row in rows),
        ours=", ".join(f"{row[0]} {row[3]}" for row in rows),
        tables=(Table("states", ("data set", "attributes", "paper", "ours"), tuple(rows)),),
        claims=tuple(claims),
        notes=(
            "A state is an observed x and the attributes' values; `term` is one state. Behaviors "
            "that are not drawn at a state are illegal there and end the trial; in the published "
            "code's ROC36 they change nothing and cost nothing.",
        ),
        figures=figures,
    )


def states_of(domain: Domain, n: int) -> int:
    """Count the states of a query's MOMDP, which depend on its length alone."""
    even = np.full((n, len(domain.behaviors), 2, 2), 0.5)
    return build_momdp(domain, Query(domain.attributes[:n]), even).n_states


if __name__ == "__main__":
    main(run)
