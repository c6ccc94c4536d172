"""Fig. 9: what the paper's solver promises by the published code's `ask`, with 5 s a query."""

from typing import NamedTuple

import numpy as np

from meal_bayes.agents import knowledge_without
from meal_bayes.arrays import Floats
from meal_bayes.datasets import load_percepts
from meal_bayes.evaluation import Estimate
from meal_bayes.experiments.offline import offline_tasks
from paper_repro.agents import AGENTS, ASK
from paper_repro.frame import Result, Setting, Table, paper_values
from paper_repro.items.fig9 import RELEVANT
from paper_repro.items.pomdpsol import program_version
from paper_repro.items.published_ask import ask_until_two_agree
from paper_repro.published import plotted_ispy32
from paper_repro.sarsop import Sarsop, problem_file, with_whole_answers
from paper_repro.statements import THEIRS, Evidence, above, below

ENDS = (0, 5)  # irrelevant attributes
QUESTIONS = 30  # at each end, of 5 s each and by either `ask`
NOTE = """Fig. 9's problems at its ends (as in [pomdpsol](pomdpsol.md)), each solved by SARSOP in 5
s: once where each attribute of a person's answer is right with .65 on its own, and once by the
published code's `ask`, whose whole answer is right with .65 and else any other with equal chances
(errata, 25). A value is what the solver's own plans promise at the start of a trial, a lower bound
of what they earn, discounted by .99 a step; the answer "I do not know" is worth 0. Questions and
objects are drawn, and are the units. So a bound above 25 decides that the curve does not end below
it; one below would decide nothing. The program: {version}. What is exact without a solver is in
[published_ask](published_ask.md)."""


class Values(NamedTuple):
    """Plan values of some questions, by each attribute's answer and by the whole one."""

    each: Floats
    whole: Floats


def run(setting: Setting) -> Result:
    """Solve the problems of both ends; raises `DownloadError` where no `pomdpsol` is."""
    version = program_version()
    values = {k: values_of(setting, k) for k in ENDS}
    right = paper_values("plotted")["ask_accuracy"]
    costs = paper_values("plotted")["ask_cost"], paper_values("offline_reward")
    rows = tuple(
        (
            k,
            len(both.each),
            drawn(both.each),
            drawn(both.whole),
            ask_until_two_agree(RELEVANT + k, right).reward(*costs),
        )
        for k, both in values.items()
    )
    first, last = (values[k] for k in ENDS)
    return Result(
        title="What the paper's solver promises at Fig. 9's ends by the published `ask`",
        sentence=f"""By the published code's `ask` SARSOP's plans of 5 s promise
        {first.whole.mean():.0f} without irrelevant attributes and {last.whole.mean():.0f} with
        {ENDS[-1]}, as means of lower bounds over drawn questions; where each attribute is right on
        its own {first.each.mean():.0f} and {last.each.mean():.0f}.""",
        tables=(
            Table(
                "values of plans",
                (
                    "irrelevant",
                    "questions",
                    "each attribute right",
                    "whole answer right",
                    "asking until two agree",
                ),
                rows,
            ),
        ),
        evidence={THEIRS: judge(drawn(first.whole), drawn(last.whole))},
        size=f"{len(first.each)} questions at each end.",
        notes=(NOTE.format(version=version),),
    )


def judge(first: Estimate, last: Estimate) -> dict[str, Evidence | None]:
    """Judge both ends by lower bounds: they can stand above a number, and not below it."""
    printed = paper_values("fig9")
    low = printed["last_reward_below"]
    rule = f"a lower bound of {last.estimate:.1f} leaves open whether it ends below {low:g}"
    ends = below(last, low, of="reward") if last.estimate > low else Evidence(rule=rule)
    start = printed["first_reward_above"]
    rule = f"a lower bound of {first.estimate:.1f} leaves open whether it starts above {start:g}"
    starts = above(first, start, of="reward") if first.estimate > start else Evidence(rule=rule)
    return {f"reward starts above {start:g}": starts, f"reward ends below {low:g}": ends}


def values_of(setting: Setting, irrelevant: int) -> Values:
    """Return what plans are worth at the start, of drawn questions."""
    table = load_percepts(plotted_ispy32(setting))
    count = setting.trials_of(QUESTIONS, 2)
    tasks = offline_tasks(table, RELEVANT + irrelevant, count, setting.seed)
    agent = AGENTS["sarsop"]
    solver = Sarsop()
    right = paper_values("plotted")["ask_accuracy"]
    report = setting.progress_in("questions")
    each = []
    whole = []
    for number, task in enumerate(tasks):
        knowledge = knowledge_without(table, task.object_index, object_level=False)
        momdp = agent.model(task.query, knowledge, reward=paper_values("offline_reward"))
        problem = problem_file(momdp)
        each.append(solver.solve_file(momdp, problem).lower_bound)
        asked = with_whole_answers(problem, ASK, right)
        whole.append(solver.solve_file(momdp, asked).lower_bound)
        if report is not None:
            report(number + 1, count)
    return Values(np.array(each), np.array(whole))


def drawn(values: Floats) -> Estimate:
    """Estimate the mean over questions, which are drawn."""
    se = float(values.std(ddof=1) / len(values) ** 0.5)
    return Estimate(
        float(values.mean()), se, len(values), cluster="trials", method="Student's t over trials"
    )
