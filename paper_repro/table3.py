"""Table 3: cost and accuracy on ROC36, of Random, Predefined Plus and MORC."""

from math import sqrt
from typing import Any

from frame import HERE, Claim, Estimate, Result, Setting, Table, agrees, main, paper_values
from trials import Trials, paired_table, run_agents

EVERY, CODE = (str(HERE / f"{name}.toml") for name in ("every_behavior", "roc36_table3"))
PLUS, ALL = "predefined_plus", "predefined_plus, all eleven"  # through the diagram; the paper's
COLUMNS = ("attributes", "agent", "accuracy: paper", "published", "recorded", "cost, s: paper",
           "published", "recorded", "its sd: paper", "published", "recorded")  # fmt: skip
NOTE = """The paper's errors are those of 400 trials. Its Predefined Plus costs what all eleven
behaviors cost once: it is run so (every_behavior.toml), and through the diagram. Eleven percepts
leave little doubt; the paper has them less accurate than MORC, which stops earlier."""

Measures = tuple[Estimate, Estimate, float]  # accuracy, cost, sd of the cost


def run(setting: Setting) -> Result:
    """Run both protocols; Predefined Plus also as the paper's, with the diagram set aside."""
    rows, claims, paired, seconds = [], [], {}, 0.0
    for n in setting.of("table3", "attributes"):
        runs = {protocol: _agents(setting, protocol, n) for protocol in setting.protocols}
        for protocol, (some, every) in runs.items():
            paired[f"{protocol}, {n} attributes"] = some
            seconds += some.seconds + every.seconds
        for agent in ("random", ALL, PLUS, "morc", "bayes"):
            found = {protocol: _measures(*both, agent) for protocol, both in runs.items()}
            sides = [_printed(n, agent), found.get("published"), found.get("recorded")]
            rows.append((n, agent, *(side and side[m] for m in range(3) for side in sides)))
            if sides[0] is not None:
                claims += [_claim(n, agent, m, *sides) for m in (0, 1)]
    best, last = [row for row in rows if row[1] == "morc"], 3 if setting.as_published else 4
    return Result(
        item="table3",
        title="Cost and accuracy on ROC36; in half of the trials the object is as described",
        paper="MORC " + ", ".join(f"{row[2][0]:.3f} at {row[5][0]:.1f} s" for row in best),
        ours="MORC " + ", ".join(f"{row[last][0]:.3f} at {row[last + 3][0]:.1f} s" for row in best),
        tables=(
            Table("accuracy, cost", COLUMNS, tuple(rows)),
            paired_table(paired, ["random", PLUS, "bayes"]),
        ),
        claims=tuple(claims),
        notes=(NOTE.replace("\n", " "),),
        seconds=seconds,
    )


def _agents(setting: Setting, protocol: str, n: int) -> tuple[Trials, Trials]:
    count, fewer = setting.of("table3", "trials"), setting.of("table3", "ours")
    code = CODE if protocol == "published" else ""
    some = run_agents(setting, protocol, "roc36", n, ["random", PLUS, "morc"], count, domain=code)
    ours = run_agents(setting, protocol, "roc36", n, ["bayes"], fewer, domain=code)
    return some + ours, run_agents(setting, protocol, "roc36", n, [PLUS], count, domain=EVERY)


def _measures(some: Trials, every: Trials, agent: str) -> Measures:
    trials, name = (every, PLUS) if agent == ALL else (some, agent)
    return trials.mean(name, "success"), trials.mean(name, "cost"), trials.sd_of_cost(name)


def _printed(n: int, agent: str) -> Measures | None:
    paper = paper_values("table3")
    values, root = paper[str(n)].get({ALL: PLUS, PLUS: ""}.get(agent, agent)), sqrt(paper["trials"])
    if values is None:
        return None
    share, cost, sd = (values[key] for key in ("accuracy", "cost", "sd"))
    return Estimate(share, sqrt(share * (1 - share)) / root), Estimate(cost, sd / root), sd


def _claim(n: int, agent: str, m: int, paper: Any, *sides: Any) -> Claim:
    measure, digits = (("accuracy", 3), ("cost", 2))[m]
    code, own = (side and agrees(paper[m], side[m], printed=digits) for side in sides)
    return Claim(f"{agent}, {n} attributes: {measure} {paper[m].mean:.{digits}f}", own, code)


if __name__ == "__main__":
    main(run)
