"""What it brings that a group is one variable: paired reward against independent attributes.

python benchmarks/groups.py [--agent NAME] [--objects N] [--json]

Every object is asked for the value of each of ROC36's groups, and of groups of 2 to 6 values in
synthetic data with weak features: once as a group, once with attributes that are independent. `one
value` asks for the object's own value and for another one: alone, or by the answer to the group.
"""

from typing import Any

import numpy as np
from measuring import options_of, show

from meal_bayes import Learner, build_percept_table, load_percepts
from meal_bayes.datasets import PerceptTable, make_synthetic
from meal_bayes.domain import Query, load_domain
from meal_bayes.trials import Task

SIZES = range(2, 7)  # values of the synthetic groups


def synthetic(size: int, objects: int) -> PerceptTable:
    """Build the held-out percepts of objects with a group of so many values."""
    values = [f"value {number}" for number in range(size)]
    domain = load_domain(
        {"extends": "toy", "name": f"of_{size}", "attributes": values, "groups": {"kind": values}}
    )
    rng = np.random.default_rng(size)
    return build_percept_table(make_synthetic(domain, objects=objects, recordings=3, rng=rng))


def measure(table: PerceptTable, group: str, agent: str) -> dict[str, Any]:
    """Compare both ways to ask on every object; gains with 1.96 standard errors."""
    learner = Learner(table.domain, agent=agent, logs=None).fit(table)
    members = table.domain.groups[group]
    asked = Query(members, (tuple(range(len(members))),))
    gains = []
    single = []
    for o, name in enumerate(table.objects):
        trials = {
            query: learner.ask(Task(name, query, o, name, ("groups", group, name)), None)
            for query in (asked, Query(members), *(Query((member,)) for member in members))
        }
        coupled = trials[asked]
        gains.append((coupled.reward, trials[Query(members)].reward))
        value = table.labels[o, table.domain.columns(members)].argmax()
        for i in (value, (value + 1) % len(members)):  # true, and false
            right = coupled.report is not None and coupled.report[i] == coupled.truth[i]
            paid = 0.0 if coupled.report is None else table.domain.report_reward * (2 * right - 1)
            single.append((paid - coupled.cost, trials[Query((members[i],))].reward))
    row: dict[str, Any] = {"data": table.domain.name, "group": group, "values": len(members)}
    for key, pairs in (("value", np.array(gains)), ("one value", np.array(single))):
        gain = pairs[:, 0] - pairs[:, 1]
        row[key] = {
            "coupled": pairs[:, 0].mean(),
            "independent": pairs[:, 1].mean(),
            "gain": gain.mean(),
            "margin": 1.96 * gain.std(ddof=1) / np.sqrt(len(gain)),
        }
    return row


def main() -> None:
    """Measure all groups and print a table, or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("--agent", default="bayes")
    parser.add_argument("--objects", type=int, default=60, help="of the synthetic data")
    options = parser.parse_args()
    roc36 = load_percepts("roc36")
    rows = [measure(roc36, group, options.agent) for group in roc36.domain.groups]
    tables = (synthetic(size, options.objects) for size in SIZES)
    rows += [measure(table, "kind", options.agent) for table in tables]
    table = [
        {"data": row["data"], "group": row["group"], "asked": asked, **row[asked]}
        for row in rows
        for asked in ("value", "one value")
    ]
    show(table, rows if options.json else None)


if __name__ == "__main__":
    main()
