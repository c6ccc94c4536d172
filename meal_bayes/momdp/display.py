"""Decision problems and beliefs for a reader: a few lines, or a table for a notebook."""

from typing import TYPE_CHECKING

import numpy as np

from meal_bayes.display import bar_html, listed, table_html

if TYPE_CHECKING:
    from meal_bayes.momdp.belief import Belief
    from meal_bayes.momdp.model import MOMDP

Facts = tuple[str, dict[str, str]]


def momdp_facts(momdp: "MOMDP") -> Facts:
    """Return the title and the facts of a decision problem."""
    rates = momdp.rows[..., momdp.levels // 2 :].sum(axis=-1)  # (N,E,2)
    best = rates[..., 1] - rates[..., 0]
    largest = [
        f"{name} by {momdp.behavior_names[e]} ({difference:.2f})"
        for name, e, difference in zip(
            momdp.query.attributes, best.argmax(axis=1), best.max(axis=1), strict=True
        )
    ]
    paid = f"{momdp.correct:g} or {momdp.incorrect:g} for a report, discount {momdp.discount:g}"
    values = momdp.query.n_values if momdp.query.groups else f"2^{len(momdp.query)}"
    return f"MOMDP of {', '.join(momdp.query.attributes)}", {
        "states": f"{momdp.n_states}: {listed(momdp.x_names)} and {values} values",
        "actions": f"{momdp.n_actions}: {listed(momdp.behavior_names)} and the reports",
        "percepts": f"{momdp.levels} levels, {momdp.n_classes} latent classes",
        "largest TPR - FPR": listed(largest, 3),
        "rewards": f"{paid}, costs {np.min(momdp.cost):g} to {np.max(momdp.cost):g} s",
    }


def belief_facts(belief: "Belief") -> Facts:
    """Return the title and the facts of a belief."""
    percepts = int(belief.percept_counts[:1].sum())
    return f"Belief in state {belief.x}, after {percepts} percepts", {
        "Pr(true)": listed([f"{value:.3f}" for value in belief.positive], 10),
        "certainty": f"{belief.certainty:.3f}, entropy {belief.entropy:.2f} bits",
    }


def belief_html(belief: "Belief") -> str:
    """Return a belief as an HTML table, a bar an attribute."""
    rows = [(str(i), bar_html(value)) for i, value in enumerate(belief.positive.tolist())]
    return table_html(belief_facts(belief)[0], ("attribute", "Pr(true)"), rows)
